"""The facets of simplices: which are shared, where given ones stand among them, and which side of a surface is which."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property
from math import factorial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..arguments import frozen
from ..elements import Element
from ..kernels.geometry import measures
from ..kernels.topology import lexicographic_order

Ids = NDArray[np.int32]


class MeshArrays:
    """Elements of dimension `k` in a space of dimension `d`, as bare arrays."""

    p: NDArray[np.float64]  # (d, nv) coordinates of the nodes [m]
    t: Ids  # (n, nt) nodes of the elements
    element: Element

    @property
    def k(self) -> int:
        """Dimension of the elements."""
        return self.element.k

    @property
    def corners(self) -> Ids:
        """(m, nt) corners of the elements: of quadratic ones without the middles of edges."""
        return self.t[: self.element.corners]

    @property
    def d(self) -> int:
        """Dimension of the space."""
        return self.p.shape[0]

    @property
    def nv(self) -> int:
        """Number of nodes: of vertices, and of middles of edges that quadratic elements have."""
        return self.p.shape[1]

    @property
    def nt(self) -> int:
        """Number of elements."""
        return self.t.shape[1]

    @cached_property
    def surface(self) -> Ids:
        """(k, n) vertices of the boundary facets, turned outwards (`facets.boundary_facets`); found when first asked for."""
        facets = boundary_facets(self)
        facets.flags.writeable = False
        return facets


def facets_of(t: Ids, nv: int) -> tuple[Ids, Ids]:
    """Facets (k, nf) of simplices `t`, scikit-fem's `mesh.facets`, and the facet (k + 1, nt) opposite to each of their vertices.

    Each facet stands once, its vertices ascending, all in lexicographic order.

    >>> facets_of(np.array([[0, 1], [1, 2]]), 3)
    (array([[0, 1, 2]], dtype=int32), array([[1, 2],
           [0, 1]], dtype=int32))
    """
    corner = np.argsort(t, axis=0)
    facets = _opposite(np.take_along_axis(t, corner, axis=0))
    order, new = _grouped(facets, nv)
    ids = np.empty(len(order), dtype=np.int32)
    ids[order] = np.cumsum(new) - 1
    t2f = np.empty(t.shape, dtype=np.int32)
    np.put_along_axis(t2f, corner, ids.reshape(t.shape), axis=0)
    return facets[:, order[new]], t2f


def facet_ids(mesh: MeshArrays) -> Ids:
    """The number (k + 1, nt) of the facet opposite to each vertex of each simplex; simplices that share a facet share it."""
    return facets_of(mesh.t, mesh.nv)[1]


def boundary_facets(mesh: MeshArrays) -> Ids:
    """(k, n) vertices of the facets that belong to one simplex only, turned outwards where the simplices fill the space.

    Those of tetrahedra are counterclockwise when seen from outside; those of triangles in the plane have the body on their left.
    `mesh.surface` keeps them.

    >>> from skfem_stvk import ElementMesh
    >>> boundary_facets(ElementMesh(p=[[0, 1, 0], [0, 0, 1]], t=[[0], [2], [1]]))
    array([[0, 2, 1],
           [1, 0, 2]], dtype=int32)
    """
    ordered = np.sort(mesh.t, axis=0)
    every = _opposite(ordered)
    order, new = _grouped(every, mesh.nv)
    alone = order[new & np.append(new[1:], True)]
    facets = every[:, alone]
    if mesh.k == mesh.d > 1:
        corner, element = np.divmod(alone, mesh.nt)
        x = mesh.p[:, [*facets, ordered[corner, element]]]
        inside = np.linalg.det((x[:, 1:] - x[:, :1]).transpose(2, 0, 1)) * (-1) ** mesh.k > 0
        facets[:2, ~inside] = facets[1::-1, ~inside]
    return facets


def find_facets(wanted: Ids, facets: Ids, nv: int) -> NDArray[np.int64]:
    """(n,) where the `wanted` facets (k, n) stand among `facets`, whatever the order of their vertices; -1 if they do not.

    >>> find_facets(np.array([[2, 1], [0, 3]]), np.array([[0, 0], [1, 2]]), 4)
    array([ 1, -1])
    """
    count = facets.shape[1]
    order, new = _grouped(np.sort(np.concatenate([facets, wanted], axis=1), axis=0), nv)
    first = np.empty(len(order), dtype=np.int64)
    first[order] = order[new][np.cumsum(new) - 1]
    return np.where(first[count:] < count, first[count:], -1)


def facet_sizes(p: NDArray[np.float64], facets: Ids) -> NDArray[np.float64]:
    """(n,) areas or lengths of facets (k, n) [m^(k-1)]; 1 for points."""
    k = len(facets)
    if k == 1:
        return np.ones(facets.shape[1])
    return measures(p, np.ascontiguousarray(facets))[0] / factorial(k - 1)


def _opposite(ordered: NDArray[Any]) -> Ids:
    """(k, (k + 1) nt) the facets opposite to the first, second, ... vertex of simplices with ascending vertices."""
    return np.concatenate([np.delete(ordered, i, axis=0) for i in range(len(ordered))], axis=1).astype(np.int32, copy=False)


def _grouped(facets: Ids, nv: int) -> tuple[Ids, NDArray[np.bool_]]:
    """The lexicographic order of facets, stable, and whether each differs from the one before it in that order."""
    order = lexicographic_order(facets, nv)
    facets = facets[:, order]
    new = np.ones(len(order), dtype=bool)
    new[1:] = (facets[:, 1:] != facets[:, :-1]).any(axis=0)
    return order, new


class NamedFacets(Mapping[str, NDArray[np.int32]]):
    """Facets (k, n) by name, from their numbers in scikit-fem's order; the first look at one finds all facets of the mesh."""

    def __init__(self, t: NDArray[np.int32], nv: int, ids: Mapping[str, Any]) -> None:
        self._t, self._nv, self._ids = t, nv, frozen(ids)

    def __getitem__(self, name: str) -> NDArray[np.int32]:
        return self._facets[:, np.asarray(self._ids[name])]

    def __iter__(self) -> Iterator[str]:
        return iter(self._ids)

    def __len__(self) -> int:
        return len(self._ids)

    def __contains__(self, name: object) -> bool:
        return name in self._ids

    @cached_property
    def _facets(self) -> NDArray[np.int32]:
        return facets_of(self._t, self._nv)[0]

    def __repr__(self) -> str:
        return f"NamedFacets: {', '.join(self._ids)}"


def turned_alike(t: NDArray[np.int32], nv: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which triangles to turn so that all neighbours look to the same side, that of the first one of their connected piece.

    Neighbours are two triangles at an edge of no other: they look to the same side if they go along it in opposite directions.
    The second array says whether the piece of each has two sides, unlike a Moebius strip.

    >>> turned_alike(np.array([[0, 1], [1, 2], [2, 3]]), 4)
    (array([False,  True]), array([ True,  True]))
    """
    n = t.shape[1]
    one, other, against = _neighbours(t, nv)
    front, back = np.arange(n), np.arange(n, 2 * n)  # the two sides of each triangle, linked to those of its neighbours
    rows = np.concatenate([front[one], back[one]])
    columns = np.concatenate([np.where(against, front[other], back[other]), np.where(against, back[other], front[other])])
    graph = coo_matrix((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(2 * n, 2 * n))
    side = connected_components(graph, directed=False)[1]
    _, first, piece = np.unique(np.minimum(side[:n], side[n:]), return_index=True, return_inverse=True)
    return side[:n] != side[first][piece], side[:n] != side[n:]


def _neighbours(t: NDArray[np.int32], nv: int) -> tuple[NDArray[Any], NDArray[Any], NDArray[np.bool_]]:
    """Pairs of triangles at edges that only they have, and whether they go along it in opposite directions."""
    ends = np.concatenate([t[[0, 1]], t[[1, 2]], t[[2, 0]]], axis=1).astype(np.int32)
    both = np.sort(ends, axis=0)
    order = lexicographic_order(both, nv)
    same = (both[:, order[1:]] == both[:, order[:-1]]).all(axis=0)
    pair = np.flatnonzero(same & ~np.append(False, same[:-1]) & ~np.append(same[1:], False))
    one, other = order[pair], order[pair + 1]
    return one % t.shape[1], other % t.shape[1], ends[0, one] != ends[0, other]
