"""Facets of simplices: shared facets, the indices of listed facets, and the sides of a surface."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..arguments import check_index_range, frozen
from ..kernels.simplex_topology import edges_of_simplices, lexicographic_order
from .element import Element, linear_simplex, named
from .points import normals_of, orientations

Ids = NDArray[np.int32]


class MeshArrays:
    """Elements of dimension `k` in a space of dimension `d`, as bare arrays."""

    p: NDArray[np.float64]  # (d, nv) coordinates of the nodes [m]
    t: Ids  # (n, nt) nodes of the elements
    element: Element

    @cached_property
    def k(self) -> int:
        """Dimension of the elements."""
        return self.element.k

    @property
    def corners(self) -> Ids:
        """Corners (m, nt) of the elements: for quadratic elements without the edge midpoints."""
        return self.t[: self.element.corners]

    @property
    def facet(self) -> Element:
        """Element of the facets; arrays of facets (m, n) have its nodes."""
        return named(self.element.facet)

    @cached_property
    def d(self) -> int:
        """Dimension of the space."""
        return self.p.shape[0]

    @cached_property
    def nv(self) -> int:
        """Number of nodes: vertices, and edge midpoints of quadratic elements."""
        return self.p.shape[1]

    @property
    def nvertices(self) -> int:
        """Number of vertices, which are the first nodes."""
        return self.nv if self.element.degree == 1 else int(self.t[self.element.corners :].min())

    @cached_property
    def nt(self) -> int:
        """Number of elements."""
        return self.t.shape[1]

    @cached_property
    def word(self) -> str:
        """Word for a node in messages: "vertex" if there are no other nodes."""
        return "vertex" if self.element.degree == 1 else "node"

    @property
    def words(self) -> str:
        """Word for nodes in messages."""
        return "vertices" if self.element.degree == 1 else "nodes"

    @cached_property
    def bounds(self) -> NDArray[np.float64]:
        """Smallest and largest coordinates (d, 2) of the whole body [m]."""
        return np.stack([self.p.min(axis=1), self.p.max(axis=1)], axis=1)

    @property
    def extent(self) -> NDArray[np.float64]:
        """Lengths (d,) of the whole body along the axes [m]."""
        return self.bounds[:, 1] - self.bounds[:, 0]

    @cached_property
    def surface(self) -> Ids:
        """Nodes (m, n) of the boundary facets, oriented outwards (`facets.boundary_facets`); computed at first use."""
        facets = boundary_facets(self)
        facets.flags.writeable = False
        return facets


class Cells(MeshArrays):
    """Elements as bare arrays, which need not use all nodes."""

    def __init__(self, p: NDArray[np.float64], t: Ids, element: Element) -> None:
        self.p, self.t, self.element = p, t, element


def facets_of(t: Ids, nv: int, element: Element | None = None) -> tuple[Ids, Ids]:
    """Return all facets (m, nf) of elements `t` in scikit-fem's order, and the facets of each element (f, nt).

    Each facet occurs once, with all its nodes in the order of `named(element.facet)`. Corners of simplices and of edges of
    quadrilaterals ascend; those of hexahedra go around the facet. For simplices, the second array is the facet opposite to each
    vertex; for other elements, each of `element.facets`. By default the elements are linear simplices.

    >>> facets_of(np.array([[0, 1], [1, 2]]), 3)
    (array([[0, 1, 2]], dtype=int32), array([[1, 2],
           [0, 1]], dtype=int32))
    """
    element, t = element or linear_simplex(len(t) - 1), t.astype(np.int32, copy=False)
    check_index_range(len(element.facets) * t.shape[1], "facets of elements")
    if element.is_simplex:
        t, corner = _ascending(t, element)
    every, ordered = _listed(t, element)
    if element.k == 2:
        every[:2].sort(axis=0)
    index, first = _numbered(ordered, nv)
    t2f = index.reshape(len(element.facets), -1)
    if element.is_simplex:
        opposite = [min(set(range(element.corners)) - set(ids)) for ids in element.cell.facets]
        of_ascending, t2f = t2f, np.empty_like(t2f)
        np.put_along_axis(t2f, corner[opposite], of_ascending, axis=0)
    return every[:, first], t2f


def facet_ids(mesh: MeshArrays) -> Ids:
    """Return the number (f, nt) of each facet of each element, as in `facets_of`; elements that share a facet share it."""
    return facets_of(mesh.t, mesh.nv, mesh.element)[1]


def boundary_facets(mesh: MeshArrays) -> Ids:
    """Return the facets (m, n) of one element only, with outward orientation where the elements fill the space.

    Facets of tetrahedra and hexahedra are counterclockwise when seen from outside. Facets of triangles and quadrilaterals in the
    plane have the body on their left. Midside nodes follow the corners. `mesh.surface` caches the result.

    >>> from skfem_stvk import ElementMesh
    >>> boundary_facets(ElementMesh(p=[[0, 1, 0], [0, 0, 1]], t=[[0], [2], [1]]))
    array([[0, 2, 1],
           [1, 0, 2]], dtype=int32)
    """
    return outer_facets(mesh)[0]


def outer_facets(mesh: MeshArrays) -> tuple[Ids, NDArray[np.integer]]:
    """Return the boundary facets (m, n) as `boundary_facets` does, and the element (n,) of each."""
    element, t = mesh.element, mesh.t
    check_index_range(len(element.facets) * t.shape[1], "facets of elements")
    if element.is_simplex:
        t, _ = _ascending(t, element)
    every, ordered = _listed(t, element)
    alone = _alone(ordered, mesh.nv)
    facets, (local, elements) = every[:, alone], np.divmod(alone, mesh.nt)
    if mesh.k == mesh.d > 1:
        positive = orientations(mesh.p, t[:, elements], element) > 0
        _reverse(facets, positive != _outwards(element)[local], mesh)
    return facets, elements


def find_facets(wanted: Ids, facets: Ids, nv: int) -> NDArray[np.int64]:
    """Return the indices (n,) of `wanted` facets (m, n) among `facets`, in any order of their nodes; -1 if absent.

    >>> find_facets(np.array([[2, 1], [0, 3]]), np.array([[0, 0], [1, 2]]), 4)
    array([ 1, -1])
    """
    count = facets.shape[1]
    order, new = grouped(np.sort(np.concatenate([facets, wanted], axis=1), axis=0), nv)
    first = np.empty(len(order), dtype=np.int64)
    first[order] = order[new][np.cumsum(new) - 1]
    return np.where(first[count:] < count, first[count:], -1)


def edges_of(corners: Ids, element: Element, nv: int) -> tuple[Ids, Ids]:
    """Return the edges (2, ne) of elements with `corners` (n, nt) in scikit-fem's order, and the edges of each element (m, nt).

    The ends of each edge ascend, and edges are in lexicographic order; segments are their own edges.
    """
    if element.k == 1:
        return corners, np.arange(corners.shape[1], dtype=np.int32)[None]
    return pairs_in(corners, element.edges, nv)


def pairs_in(t: Ids, local: ArrayLike, nv: int) -> tuple[Ids, Ids]:
    """Return the pairs of nodes `a < b` (2, n), in lexicographic order, and the pairs (m, nt) of each element.

    `t` (n, nt) are the nodes of the elements, `local` (m, 2) the pairs in an element.

    Raises
    ------
    MeshError
        if 32-bit indices cannot count the pairs of all elements.
    """
    pairs = np.asarray(local)
    check_index_range(len(pairs) * t.shape[1], "pairs of nodes of elements")
    return edges_of_simplices(np.ascontiguousarray(t, dtype=np.int32), pairs, nv)


def further_nodes(corners: Ids, element: Element, nv: int) -> tuple[list[Ids], Ids]:
    """Return the further nodes of elements with these `corners` (m, nt) among `nv` vertices, in scikit-fem's order.

    The first result has the corners between which these nodes lie: arrays (m, n) for edges, faces and cells, where the `element`
    has nodes. The second result has the further nodes of each element, (n, nt), counted from 0 through these arrays.
    """
    groups, numbers, begin = [], [], 0
    for size in sorted({len(ids) for ids in element.means}):
        if size == element.corners:
            group, own = corners, np.arange(corners.shape[1], dtype=np.int32)[None]
        elif size == 2:
            group, own = edges_of(corners, element, nv)
        else:
            group, own = facets_of(corners, nv, element.linear)
        groups.append(group)
        numbers.append(begin + own)
        begin += group.shape[1]
    return groups, np.concatenate([np.empty((0, corners.shape[1]), dtype=np.int32), *numbers])


def with_midpoints(facets: Ids, facet: Element, between: Sequence[Ids], nv: int) -> Ids:
    """Return facets (m, n) with all their nodes, from their corners among `nv` vertices; the order of the corners is unchanged.

    The further nodes, from `nv` on, lie `between` corners as `further_nodes` lists them; -1 marks a missing node.

    >>> with_midpoints(np.array([[2, 1], [1, 0]]), named("quadratic segments"), [np.array([[0, 0, 1], [1, 2, 2]])], 3)
    array([[2, 1],
           [1, 0],
           [5, 3]], dtype=int32)
    """
    further, begin, there = [], nv, np.zeros(nv, dtype=bool)
    there[facets] = True
    for group in between:
        own = [list(ids) for ids in facet.means if len(ids) == len(group)]
        if own:
            near = np.flatnonzero(there[group].all(axis=0))
            index = find_facets(np.concatenate([facets[ids] for ids in own], axis=1), group[:, near], nv).reshape(len(own), -1)
            further.append(np.where(index >= 0, begin + np.append(near, 0)[index], -1))
        begin += group.shape[1]
    return np.concatenate([facets, *further]).astype(np.int32)


def _ascending(t: Ids, element: Element) -> tuple[Ids, NDArray[np.integer]]:
    """Return simplices with their corners in ascending order and their edge midpoints accordingly, and the local numbers of
    corners.
    """
    corner = nodes = np.argsort(t[: element.corners], axis=0)
    if element.means:
        a, b = np.transpose(element.means)
        middle = np.zeros((element.corners, element.corners), dtype=np.int64)
        middle[a, b] = middle[b, a] = element.corners + np.arange(len(a))
        nodes = np.concatenate([corner, middle[corner[a], corner[b]]])
    return np.take_along_axis(t, nodes, axis=0), corner


def _listed(t: Ids, element: Element) -> tuple[Ids, Ids]:
    """Return the first, second, ... facets (m, f nt) of elements, as `element.facets` lists them, and their corners, ascending."""
    every = np.concatenate([t[list(facet)] for facet in element.facets], axis=1)
    corners = every[: named(element.facet).corners]
    return every, corners if element.is_simplex else np.sort(corners, axis=0)  # facets of ascending simplices ascend


def _numbered(ordered: Ids, nv: int) -> tuple[Ids, NDArray[Any]]:
    """Return the number of each facet in lexicographic order, and where each number first occurs; vertices of facets ascend."""
    order, new = grouped(ordered, nv)
    index = np.empty(len(order), dtype=np.int32)
    index[order] = np.cumsum(new) - 1
    return index, order[new]


def _alone(ordered: Ids, nv: int) -> NDArray[Any]:
    """Return columns of the facets that only one element has; each facet has ascending vertices."""
    order, new = grouped(ordered, nv)
    return order[new & np.append(new[1:], True)]


def _outwards(element: Element) -> NDArray[np.bool_]:
    """Return whether each facet has its normal outwards on the reference element, in the order of `element.facets`."""
    x, centre = element.cell.corners, element.cell.corners.mean(axis=0)
    facets = [x[list(facet)] for facet in element.cell.facets]
    base_vectors = [f[[1, -1]] - f[0] if element.k == 3 else f[1:] - f[0] for f in facets]
    return np.array([normals_of(p) @ (f.mean(axis=0) - centre) > 0 for p, f in zip(base_vectors, facets, strict=True)])


def _reverse(facets: Ids, which: NDArray[np.bool_], mesh: MeshArrays) -> None:
    """Reverse the orientation of some facets in place."""
    facets[:, which] = facets[mesh.facet.reversed][:, which]


def grouped(facets: Ids, nv: int) -> tuple[Ids, NDArray[np.bool_]]:
    """Return the lexicographic order of columns, stable, and whether each differs from the one before it in that order."""
    order = lexicographic_order(facets, nv)
    facets = facets[:, order]
    new = np.ones(len(order), dtype=bool)
    new[1:] = (facets[:, 1:] != facets[:, :-1]).any(axis=0)
    return order, new


class NamedFacets(Mapping[str, NDArray[np.int32]]):
    """Facets (m, n) by name, from their numbers in scikit-fem's order; the first access computes all facets of the mesh."""

    def __init__(self, t: Ids, nv: int, element: Element, ids: Mapping[str, Any]) -> None:
        self._t, self._nv, self._element, self._ids = t, nv, element, frozen(ids)

    def __getitem__(self, name: str) -> NDArray[np.int32]:
        return self._facets[:, np.asarray(self._ids[name])]

    def __iter__(self) -> Iterator[str]:
        return iter(self._ids)

    def __len__(self) -> int:
        return len(self._ids)

    def __contains__(self, name: object) -> bool:
        return name in self._ids

    def on(self, t: Ids, nv: int, element: Element) -> NamedFacets:
        """Return the facets of these names on the same elements with another degree."""
        return NamedFacets(t, nv, element, self._ids)

    @cached_property
    def _facets(self) -> NDArray[np.int32]:
        return facets_of(self._t, self._nv, self._element)[0]

    def __repr__(self) -> str:
        return f"NamedFacets: {', '.join(self._ids)}"


def faces_to_reverse(t: NDArray[np.int32], nv: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return the faces to reverse, so that all neighbours have the orientation of the first face of their piece.

    `t` (m, n) are the corners of the faces. Neighbours are two faces at an edge without a third; a piece is connected by such
    edges. Neighbours have the same orientation if they run along their edge in opposite directions. The second array says whether
    the piece of each face has two sides, unlike a Moebius strip.

    >>> faces_to_reverse(np.array([[0, 1], [1, 2], [2, 3]]), 4)
    (array([False,  True]), array([ True,  True]))
    """
    n = t.shape[1]
    one, other, against = _neighbours(t, nv)
    front, back = np.arange(n), np.arange(n, 2 * n)  # the two sides of each triangle, linked to those of its neighbours
    rows = np.concatenate([front[one], back[one]])
    columns = np.concatenate([np.where(against, front[other], back[other]), np.where(against, back[other], front[other])])
    side = linked(rows, columns, 2 * n)
    _, first, piece = np.unique(np.minimum(side[:n], side[n:]), return_index=True, return_inverse=True)
    return side[:n] != side[first][piece], side[:n] != side[n:]


def linked(a: NDArray[Any], b: NDArray[Any], n: int) -> NDArray[np.int32]:
    """Return the number (n,) of the connected part of each of `n` items; links join each item of `a` to that of `b`.

    >>> linked(np.array([0, 3]), np.array([1, 4]), 5)
    array([0, 0, 1, 2, 2], dtype=int32)
    """
    links = coo_matrix((np.ones(len(a), dtype=np.int8), (a, b)), shape=(n, n))
    return np.asarray(connected_components(links, directed=False)[1])


def _neighbours(t: NDArray[np.int32], nv: int) -> tuple[NDArray[Any], NDArray[Any], NDArray[np.bool_]]:
    """Return pairs of faces at edges that no other face has, and whether both run along the edge in opposite directions."""
    ends = np.concatenate([t[[i, (i + 1) % len(t)]] for i in range(len(t))], axis=1).astype(np.int32)
    order, new = grouped(np.sort(ends, axis=0), nv)
    starts = np.flatnonzero(new)
    pair = starts[np.diff(starts, append=len(order)) == 2]
    one, other = order[pair], order[pair + 1]
    return one % t.shape[1], other % t.shape[1], ends[0, one] != ends[0, other]
