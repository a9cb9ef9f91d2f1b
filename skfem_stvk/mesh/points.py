"""Elements and facets at points of the reference element: where these are, the spokes there, and what they span.

At a reference point `xi` an element has the spokes `P_i = sum_a dN_a/dxi_i X_a`, the columns of the Jacobian matrix: those of a
linear simplex are `X_i - X_0` everywhere.
"""

from __future__ import annotations

from math import factorial
from typing import Any

import numpy as np

from ..arguments import Array
from ..elements import Element, rule_of
from ..kernels.geometry import measures

#: Elements at a time whose spokes at all points stay in the cache: a tenth of the time.
CHUNK = 2048
#: How far nodes of straight elements may be from where they belong, relative to the largest coordinate: a middle is rounded once,
#: the sum of corners that it is compared with three times, and the corners of a box that was turned as often. Where more was lost
#: elements count as curved, which costs time and no digits; what counts as straight moves by no more than coordinates are rounded.
ROUNDED = 8 * float(np.finfo(float).eps)


def spokes_at(x: Array, t: Any, element: Element, xi: Array) -> Array:
    """Return the spokes `sum_a dN_a/dxi_i x_a` (nt, nq, k, d) at reference points `xi` (nq, k) of elements `t` (n, nt).

    `x` (d, nv) are coordinates, or displacements, whose differences along the spokes these are then. The result is a view in which
    elements are next to each other: what is done to one component of all is fast.

    >>> from skfem_stvk.elements import ELEMENTS
    >>> x, t = np.array([[0.0, 2, 0], [0, 0, 3]]), np.array([[0], [1], [2]])
    >>> spokes_at(x, t, ELEMENTS["triangles"], np.array([[0.2, 0.2]]))[0, 0]
    array([[2., 0.],
           [0., 3.]])
    """
    nt, d, nq = t.shape[1], len(x), len(xi)
    derivatives = element.derivatives(xi).transpose(0, 2, 1)  # one product for each point: none so large that BLAS starts threads
    differences = _by_node(x, t[1:]) - _by_node(x, t[:1])  # far from the origin no digits are lost
    return (derivatives[:, :, 1:] @ differences).reshape(nq, element.k, d, nt).transpose(3, 0, 1, 2)


def are_straight(p: Array, t: Any, element: Element) -> Any:
    """Return whether the spokes of each element (nt,) are the same everywhere, to within `ROUNDED` of its coordinates.

    Simplices are straight if each middle is in the middle, quadrilaterals and hexahedra if they are parallelograms and
    parallelepipeds.
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

    Their sums are the sizes: exact for all but curved lines and surfaces in a space of more dimensions.
    """
    points, weights = rule_of(element, kind)
    sizes = np.empty((len(weights), t.shape[1]))
    for begin in range(0, t.shape[1], CHUNK):
        some = slice(begin, begin + CHUNK)
        sizes[:, some] = measures_of(spokes_at(p, t[:, some], element, points)).T
    sizes *= weights[:, None]
    return sizes


def sizes_of(p: Array, t: Any, element: Element, kind: str = "mass") -> Array:
    """Return lengths, areas or volumes (n,) of elements or facets `t` (m, n) by the rule of a kind [m^k]; 1 for points."""
    if element.k == 0:
        return np.ones(t.shape[1])
    if element.is_linear_simplex:
        return np.asarray(measures(p, np.ascontiguousarray(t))[0] / factorial(element.k))
    return np.asarray(sizes_at_points(p, t, element, kind).sum(axis=0))


def determinants(spokes: Array) -> Array:
    """Return the determinants (...,) of spokes (..., d, d), which are negative for inverted elements."""
    p = np.moveaxis(spokes, (-2, -1), (0, 1))
    if len(p) == 1:
        return np.asarray(p[0, 0])
    if len(p) == 2:
        return np.asarray(p[0, 0] * p[1, 1] - p[0, 1] * p[1, 0])
    return np.asarray(_dot(_cross(p[0], p[1]), p[2]))


def orientations(p: Array, t: Any, element: Element) -> Array:
    """Return the Jacobian determinants (nt,) at the centres of elements that fill their space, negative for inverted ones."""
    return np.asarray(determinants(spokes_at(p, t, element, rule_of(element, "one-point").points))[:, 0])


def signed(spokes: Array, centre: Array) -> Array:
    """Return determinants (nt, nq) of spokes (nt, nq, k, d); for k < d sizes, negative where inverted against those at `centre`.

    Turned over means by more than a right angle: `det P P_c'` of the spokes P and those at the `centre` P_c is negative.
    """
    if spokes.shape[-2] == spokes.shape[-1]:
        return determinants(spokes)
    turn = determinants(np.einsum("tqid,tqjd->tqij", spokes, np.broadcast_to(centre, spokes.shape)))
    return measures_of(spokes) * np.sign(turn)


def measures_of(spokes: Array) -> Array:
    """Return length, area or volume (...,) of the parallelepiped that spokes (..., k, d) span; 1 for k = 0.

    >>> float(measures_of(np.array([[3.0, 0, 4]]))), float(measures_of(np.array([[2.0, 0, 0], [1, 0, 3]])))
    (5.0, 6.0)
    """
    k, d = spokes.shape[-2:]
    if k == 0:
        return np.ones(spokes.shape[:-2])
    if k == d:
        return np.abs(determinants(spokes))
    p = np.moveaxis(spokes, (-2, -1), (0, 1))
    return np.sqrt(_squared(p[0] if k == 1 else _cross(p[0], p[1])))


def normals_of(spokes: Array) -> Array:
    """Return normals (..., d) of facets from their spokes (..., d - 1, d), as long as the parallelogram is large.

    They look outwards for facets in the order of `mesh.surface`.

    >>> normals_of(np.array([[0.0, 2.0]])), normals_of(np.array([[1.0, 0, 0], [0, 2, 0]]))
    (array([ 2., -0.]), array([0., 0., 2.]))
    """
    p = np.moveaxis(spokes, (-2, -1), (0, 1))
    if spokes.shape[-1] == 2:
        return np.stack([p[0, 1], -p[0, 0]], axis=-1)
    return np.stack(_cross(p[0], p[1]), axis=-1)


def extremes(spokes: Array, simplex: bool) -> tuple[Array, Array]:
    """Return longest edge and inverse smallest height (...,) of the simplex or parallelepiped of spokes (..., k, d)."""
    p = np.moveaxis(spokes, (-2, -1), (0, 1))
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
