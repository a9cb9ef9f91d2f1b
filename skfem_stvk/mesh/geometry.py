"""Volumes and shape-function gradients of simplices."""

from __future__ import annotations

from itertools import combinations
from math import factorial

import numpy as np
from numpy.typing import NDArray

from .mesh import ElementMesh


class Geometry:
    """Rest geometry of `nt` simplices of dimension `k` in a space of dimension `d`.

    The gradients are held in an orthonormal basis of each simplex's own plane or line, where they have `k` components; for `k = d`
    that basis is the global one.

    Attributes
    ----------
    volume : (nt,) length, area or volume, positive for both orientations [m^k].
    gradients : (nt, k + 1, k) gradients `g_a` of the barycentric coordinates [1/m].
    axes : (nt, d, k) the basis as columns.
    """

    def __init__(self, p: NDArray[np.float64], t: NDArray[np.int32]) -> None:
        d, k = p.shape[0], t.shape[0] - 1
        x = p.T[t.T]
        spokes = np.swapaxes(x[:, 1:] - x[:, :1], 1, 2)  # (nt, d, k), column i = X_(i+1) - X_0
        if k == d:
            self.axes = np.broadcast_to(np.eye(d), spokes.shape)
        else:
            self.axes, spokes = np.linalg.qr(spokes)
        inner = np.linalg.inv(spokes)
        self.volume: NDArray[np.float64] = np.abs(np.linalg.det(spokes)) / factorial(k)
        self.gradients: NDArray[np.float64] = np.concatenate([-inner.sum(axis=1, keepdims=True), inner], axis=1)

    @property
    def gram(self) -> NDArray[np.float64]:
        """(nt, k + 1, k + 1) Gram matrix `G_ab = g_a . g_b` [1/m^2]."""
        return self.gradients @ np.swapaxes(self.gradients, 1, 2)


def edge_differences(mesh: ElementMesh, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """(d, m, nt) differences of a field `x` (d, nv) along the edges of the simplices."""
    a, b = np.array(list(combinations(range(mesh.k + 1), 2))).T
    corners = x[:, mesh.t]
    return corners[:, a] - corners[:, b]


def edge_lengths(mesh: ElementMesh) -> NDArray[np.float64]:
    """(m, nt) lengths of the edges of the simplices [m]."""
    return np.linalg.norm(edge_differences(mesh, mesh.p), axis=0)


def vertex_sizes(mesh: ElementMesh) -> NDArray[np.float64]:
    """(nv,) shortest edge of the simplices around each vertex [m]."""
    size = np.full(mesh.nv, np.inf)
    np.minimum.at(size, mesh.t.ravel(), np.tile(edge_lengths(mesh).min(axis=0), mesh.k + 1))
    return size


def aspect_ratios(mesh: ElementMesh) -> NDArray[np.float64]:
    """(nt,) longest edge over smallest height of the simplices; 1.22 for a regular tetrahedron, 1 for a segment."""
    longest = edge_lengths(mesh).max(axis=0)
    steepest = np.linalg.norm(Geometry(mesh.p, mesh.t).gradients, axis=2).max(axis=1)
    return longest * steepest
