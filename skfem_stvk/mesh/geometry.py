"""Volumes and shape-function gradients of simplices; base vectors, sizes and shapes of all elements."""

from __future__ import annotations

from math import factorial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .facets import MeshArrays
from .mesh import ElementMesh
from .points import base_vectors_at, extremes, rule_of


class Geometry:
    """Rest geometry of `nt` simplices of dimension `k` in a space of dimension `d`.

    The gradients have `k` components, in an orthonormal basis of each simplex's own plane or line. For `k = d` that basis is the
    global one.

    Attributes
    ----------
    volume
        (nt,) length, area or volume, positive for both orientations [m^k].
    gradients
        (nt, k + 1, k) gradients `g_a` of the barycentric coordinates [1/m].
    axes
        (nt, d, k) basis of each element, as columns.
    """

    def __init__(self, p: NDArray[np.float64], t: NDArray[np.int32]) -> None:
        x = p.T[t.T]
        self.axes, within = _axes(np.swapaxes(x[:, 1:] - x[:, :1], 1, 2))
        inner = np.linalg.inv(within)
        self.volume: NDArray[np.float64] = np.abs(np.linalg.det(within)) / factorial(len(t) - 1)
        self.gradients: NDArray[np.float64] = np.concatenate([-inner.sum(axis=1, keepdims=True), inner], axis=1)

    @property
    def gram(self) -> NDArray[np.float64]:
        """Gram matrix `G_ab = g_a . g_b` (nt, k + 1, k + 1) [1/m^2]."""
        return self.gradients @ np.swapaxes(self.gradients, 1, 2)


class PointGeometry(NamedTuple):
    """Rest geometry of `nt` elements at one point of a rule; `Geometry` is that of linear simplices.

    Attributes
    ----------
    volume
        (nt,) weight times length, area or volume at the point [m^k].
    gradients
        (nt, n, k) gradients of the shape functions in the axes there [1/m].
    axes
        (nt, d, k) an orthonormal basis of the element's own plane or line there, as columns.
    """

    volume: NDArray[np.float64]
    gradients: NDArray[np.float64]
    axes: NDArray[np.float64]


def geometries(mesh: ElementMesh, kind: str = "usual") -> list[Geometry | PointGeometry]:
    """Return the rest geometry at each point of the rule of a kind; boxes with one point have their mean gradients."""
    if mesh.element.is_linear_simplex:
        return [Geometry(mesh.p, mesh.t)]
    if kind == "one-point" and mesh.element.shape.one_point:
        points = geometries(mesh)
        volume = np.sum([point.volume for point in points], axis=0)
        means = np.sum([point.volume[:, None, None] * point.gradients for point in points], axis=0) / volume[:, None, None]
        return [PointGeometry(volume, means, points[0].axes)]
    found: list[Geometry | PointGeometry] = []
    for xi, weight in zip(*rule_of(mesh.element, kind), strict=True):
        base_vectors = np.ascontiguousarray(base_vectors_at(mesh.p, mesh.t, mesh.element, xi[None])[:, 0])
        axes, within = _axes(np.swapaxes(base_vectors, 1, 2))
        gradients = mesh.element.derivatives(xi[None])[0] @ np.linalg.inv(within)
        found.append(PointGeometry(weight * np.abs(np.linalg.det(within)), gradients, axes))
    return found


def _axes(base_vectors: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return an orthonormal basis (nt, d, k) of base vectors (nt, d, k), as columns, and these vectors in that basis (nt, k, k)."""
    d, k = base_vectors.shape[1:]
    return (np.broadcast_to(np.eye(d), base_vectors.shape), base_vectors) if d == k else np.linalg.qr(base_vectors)


def edge_differences(mesh: MeshArrays, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the differences (d, m, nt) of a field `x` (d, nv) between the ends of `element.edges` of each element."""
    a, b = np.transpose(mesh.element.edges)
    corners = x[:, mesh.corners]
    return corners[:, a] - corners[:, b]


def edge_lengths(mesh: MeshArrays) -> NDArray[np.float64]:
    """Return the lengths (m, nt) of the edges of the elements, from end to end [m]."""
    return np.linalg.norm(edge_differences(mesh, mesh.p), axis=0)


def aspect_ratios(mesh: MeshArrays) -> NDArray[np.float64]:
    """Return longest edge over smallest height (nt,): 1.22 for a regular tetrahedron, 1 for a segment, a square or a cube.

    For elements with several points, the worst of their usual points counts. At each point the element is taken as the simplex, or
    the box, of its base vectors. The ratio is infinite for zero height.
    """
    if mesh.k == 1:
        return np.ones(mesh.nt)
    base_vectors = base_vectors_at(mesh.p, mesh.t, mesh.element, rule_of(mesh.element, "usual").points)
    longest, steepest = extremes(base_vectors, mesh.element.is_simplex)
    aspect = np.asarray((longest * steepest).max(axis=1))
    return np.where(np.isnan(aspect), np.inf, aspect)
