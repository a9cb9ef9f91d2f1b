"""Integration points of elements and facets: rules on the reference elements, base vectors, and the sizes that these span.

At a reference point `xi` an element has the base vectors `P_i = sum_a dN_a/dxi_i X_a`, the columns of the Jacobian matrix. For a
linear simplex they are `X_i - X_0` everywhere.

No weight of a rule is negative: with one, a barrier or any law that is not a polynomial could gain energy instead of resisting.
scikit-fem's rules of order 3 and 4 for tetrahedra have such a weight. Therefore the rules are those of order 2, 5 (14 points, exact
to degree 4) and 6 (15 points, exact to degree 5).
"""

from __future__ import annotations

from functools import cache
from math import factorial
from typing import Any, NamedTuple

import numpy as np
from skfem.quadrature import get_quadrature

from ..arguments import Array
from ..errors import StvkError
from ..kernels.simplex_geometry import measures
from .element import Element

#: Number of elements at a time: their base vectors at all points stay in the cache. This takes a tenth of the time.
CHUNK = 2048
#: Tolerance for nodes of straight elements, relative to the largest coordinate. A midpoint is rounded once, the sum of corners that
#: it is compared with three times, and the corners of a rotated box as often. Elements with larger errors count as curved, which
#: costs time but no accuracy. Elements within the tolerance move by no more than the rounding of coordinates.
ROUNDED = 8 * float(np.finfo(float).eps)
KINDS = ("usual", "exact", "mass", "one-point")
#: Default coefficient of the hourglass stiffness of boxes with one point.
HOURGLASS = 0.05


class Rule(NamedTuple):
    """Points of a reference element, and their weights.

    Attributes
    ----------
    points
        (nq, k) reference coordinates.
    weights
        (nq,) weights, all positive; their sum is the size of the reference element.
    """

    points: Array
    weights: Array


@cache
def rule_of(element: Element, kind: str = "usual") -> Rule:
    """Return the rule of a kind for an element.

        usual        1 point of linear simplices; 2, 3, 4 of quadratic segments, triangles, tetrahedra; 2^k of boxes
        exact        integrates W, a quartic in the gradient, exactly on elements with straight edges: 1; 3, 6, 14; 3^k points
        mass         integrates N_a N_b exactly on such elements; of curved ones the volume and the centre of mass
        one-point    the centre

    Source: `skfem.quadrature`.

    Raises
    ------
    StvkError
        if the kind is unknown.

    Examples
    --------
    >>> from skfem_stvk.mesh.element import ELEMENTS
    >>> [len(rule_of(ELEMENTS["quadratic tetrahedra"], kind).weights) for kind in ("usual", "exact")]
    [4, 14]
    """
    if kind not in KINDS:
        raise StvkError(f"kind = {kind!r}; expected one of {', '.join(KINDS)}.")
    if element.k == 0:
        return Rule(np.zeros((1, 0)), np.ones(1))
    if kind == "one-point" or (element.is_linear_simplex and kind != "mass"):
        return Rule(element.cell.corners.mean(axis=0)[None], get_quadrature(element.cell.reference, 1)[1].sum(keepdims=True))
    points, weights = get_quadrature(element.cell.reference, element.orders[KINDS.index(kind)])
    return Rule(np.ascontiguousarray(points.T), np.asarray(weights))


def base_vectors_at(x: Array, t: Any, element: Element, xi: Array) -> Array:
    """Return the base vectors `sum_a dN_a/dxi_i x_a` (nt, nq, k, d) at reference points `xi` (nq, k) of elements `t` (n, nt).

    `x` (d, nv) are coordinates. If `x` are displacements, the results are their differences along the base vectors. The result is a
    view with adjacent elements, so that operations on one component of all elements are fast.

    >>> from skfem_stvk.mesh.element import ELEMENTS
    >>> x, t = np.array([[0.0, 2, 0], [0, 0, 3]]), np.array([[0], [1], [2]])
    >>> base_vectors_at(x, t, ELEMENTS["triangles"], np.array([[0.2, 0.2]]))[0, 0]
    array([[2., 0.],
           [0., 3.]])
    """
    nt, d, nq = t.shape[1], len(x), len(xi)
    derivatives = element.derivatives(xi).transpose(0, 2, 1)  # one small product for each point: BLAS starts no threads
    differences = _by_node(x, t[1:]) - _by_node(x, t[:1])  # differences lose no digits far from the origin
    return (derivatives[:, :, 1:] @ differences).reshape(nq, element.k, d, nt).transpose(3, 0, 1, 2)


def are_straight(p: Array, t: Any, element: Element) -> Any:
    """Return whether the base vectors of each element (nt,) are the same everywhere, to within `ROUNDED` of its coordinates.

    Simplices are straight if each edge midpoint is in the middle. Quadrilaterals and hexahedra are straight if they are
    parallelograms and parallelepipeds.
    """
    xi = element.nodes
    origin = np.flatnonzero((xi == 0).all(axis=1))[0]
    ends = [np.flatnonzero((xi == row).all(axis=1))[0] for row in np.eye(element.k)]
    x = p[:, t]
    affine = x[:, origin][:, None] + np.einsum("ai,dit->dat", xi, x[:, ends] - x[:, [origin]])
    return (np.abs(x - affine) <= ROUNDED * np.abs(x).max(axis=(0, 1))).all(axis=(0, 1))


def _by_node(x: Array, t: Any) -> Array:
    """Return components (n, d nt) of a field `x` (d, nv) at the nodes of elements `t` (n, nt), elements next to each other."""
    return x[:, t].transpose(1, 0, 2).reshape(len(t), -1)


def sizes_at_points(p: Array, t: Any, element: Element, kind: str = "mass") -> Array:
    """Return weight times length, area or volume [m^k] of elements or facets `t` (m, n) at each point of a rule, (nq, n).

    Their sums are the sizes: exact except for curved lines and surfaces in a space of more dimensions.
    """
    points, weights = rule_of(element, kind)
    sizes = np.empty((len(weights), t.shape[1]))
    for begin in range(0, t.shape[1], CHUNK):
        some = slice(begin, begin + CHUNK)
        sizes[:, some] = measures_of(base_vectors_at(p, t[:, some], element, points)).T
    sizes *= weights[:, None]
    return sizes


def sizes_of(p: Array, t: Any, element: Element, kind: str = "mass") -> Array:
    """Return lengths, areas or volumes (n,) of elements or facets `t` (m, n) by the rule of a kind [m^k]; 1 for points."""
    if element.k == 0:
        return np.ones(t.shape[1])
    if element.is_linear_simplex:
        return np.asarray(measures(p, np.ascontiguousarray(t))[0] / factorial(element.k))
    return np.asarray(sizes_at_points(p, t, element, kind).sum(axis=0))


def determinants(base_vectors: Array) -> Array:
    """Return the determinants (...,) of base vectors (..., d, d), which are negative for inverted elements."""
    p = np.moveaxis(base_vectors, (-2, -1), (0, 1))
    if len(p) == 1:
        return np.asarray(p[0, 0])
    if len(p) == 2:
        return np.asarray(p[0, 0] * p[1, 1] - p[0, 1] * p[1, 0])
    return np.asarray(_dot(_cross(p[0], p[1]), p[2]))


def orientations(p: Array, t: Any, element: Element) -> Array:
    """Return the Jacobian determinants (nt,) at the centres of elements that fill their space, negative for inverted ones."""
    return np.asarray(determinants(base_vectors_at(p, t, element, rule_of(element, "one-point").points))[:, 0])


def signed(base_vectors: Array, centre: Array) -> Array:
    """Return determinants (nt, nq) of base vectors (nt, nq, k, d); for k < d sizes, negative where inverted against those at
    `centre`.

    Inverted means rotated by more than a right angle: `det P P_c'` of the base vectors P and those at the `centre` P_c is negative.
    """
    if base_vectors.shape[-2] == base_vectors.shape[-1]:
        return determinants(base_vectors)
    orientation = determinants(np.einsum("tqid,tqjd->tqij", base_vectors, np.broadcast_to(centre, base_vectors.shape)))
    return measures_of(base_vectors) * np.sign(orientation)


def measures_of(base_vectors: Array) -> Array:
    """Return length, area or volume (...,) of the parallelepiped that base vectors (..., k, d) span; 1 for k = 0.

    >>> float(measures_of(np.array([[3.0, 0, 4]]))), float(measures_of(np.array([[2.0, 0, 0], [1, 0, 3]])))
    (5.0, 6.0)
    """
    k, d = base_vectors.shape[-2:]
    if k == 0:
        return np.ones(base_vectors.shape[:-2])
    if k == d:
        return np.abs(determinants(base_vectors))
    p = np.moveaxis(base_vectors, (-2, -1), (0, 1))
    return np.sqrt(_squared(p[0] if k == 1 else _cross(p[0], p[1])))


def normals_of(base_vectors: Array) -> Array:
    """Return normals (..., d) of facets from their base vectors (..., d - 1, d), with the area of the parallelogram as their
    length.

    They point outwards for facets in the order of `mesh.surface`.

    >>> normals_of(np.array([[0.0, 2.0]])), normals_of(np.array([[1.0, 0, 0], [0, 2, 0]]))
    (array([ 2., -0.]), array([0., 0., 2.]))
    """
    p = np.moveaxis(base_vectors, (-2, -1), (0, 1))
    if base_vectors.shape[-1] == 2:
        return np.stack([p[0, 1], -p[0, 0]], axis=-1)
    return np.stack(_cross(p[0], p[1]), axis=-1)


def extremes(base_vectors: Array, simplex: bool) -> tuple[Array, Array]:
    """Return longest edge and inverse smallest height (...,) of the simplex or parallelepiped of base vectors (..., k, d)."""
    p = np.moveaxis(base_vectors, (-2, -1), (0, 1))
    k = len(p)
    edges = [*p, *(p[i] - p[j] for i in range(k) for j in range(i))] if simplex else [*p]
    longest = np.sqrt(np.max([_squared(edge) for edge in edges], axis=0))
    if k == 1:
        with np.errstate(divide="ignore"):
            return longest, 1 / longest
    pad = p if p.shape[1] == 3 else np.concatenate([p, np.zeros((k, 1, *p.shape[2:]))], axis=1)
    if k == 2:
        facets, size = [_squared(edge) for edge in edges], np.sqrt(_squared(_cross(pad[0], pad[1])))
    else:
        sides = [(pad[0], pad[1]), (pad[1], pad[2]), (pad[2], pad[0])] + ([(edges[3], edges[4])] if simplex else [])
        facets, size = [_squared(_cross(a, b)) for a, b in sides], np.abs(_dot(_cross(pad[0], pad[1]), pad[2]))
    with np.errstate(divide="ignore", invalid="ignore"):
        return longest, np.sqrt(np.max(facets, axis=0)) / size


def _cross(a: Any, b: Any) -> tuple[Array, Array, Array]:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _dot(a: Any, b: Any) -> Any:
    return sum(x * y for x, y in zip(a, b, strict=True))


def _squared(a: Any) -> Any:
    return _dot(a, a)
