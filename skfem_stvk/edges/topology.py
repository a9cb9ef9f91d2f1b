"""Edges of simplices in scikit-fem's order, the kernels' own order of simplices, and the shares of threads in them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import reverse_cuthill_mckee

from ..kernels.lanes import LANES, TRANSPOSED
from ..kernels.simplex_topology import OWN, lexicographic_order, numbers_by_first_use, stars
from ..kernels.threads import parts_of
from ..mesh.element import LOCAL_EDGES, Element
from ..mesh.facets import pairs_in

Ids = NDArray[np.int32]


def edge_topology(t: NDArray[np.int32]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the edges (2, ne) of simplices `t` (k + 1, nt), and the edges (m, nt) of each simplex.

    Edges are end vertices `a < b` in lexicographic order, as in scikit-fem's `mesh.edges` (`mesh.facets` for triangles). Each
    simplex has `m = k (k + 1)/2` edges in the order of `LOCAL_EDGES`, as in `mesh.t2e` (`mesh.t2f`).

    >>> edge_topology(np.array([[0, 1], [1, 2], [2, 3]]))
    (array([[0, 0, 1, 1, 2],
            [1, 2, 2, 3, 3]], dtype=int32), array([[0, 2],
           [2, 4],
           [1, 3]], dtype=int32))
    """
    return pairs_in(t, LOCAL_EDGES[t.shape[0] - 1], int(t.max(initial=-1)) + 1)


def pairs_of(t: NDArray[np.int32], element: Element) -> NDArray[np.int32]:
    """Return the pairs of nodes `a < b` (2, n) that share an element, in lexicographic order: for linear simplices their edges."""
    return pairs_in(t, element.pairs, int(t.max(initial=-1)) + 1)[0]


#: Front size in bytes of blocks above which another node order is tried; smaller fronts fit into a core's cache with all else.
SMALL_FRONT = 2**17
#: The mesh's own order is used unless its front is larger by this factor, since rows of K are then written one after the other.
GAIN = 1.5
#: A new order is also tried if more than this fraction of nodes precede all their neighbours, since SSOR sweeps then carry little.
ALONE = 0.05


def front(pairs: Ids, n: int) -> int:
    """Return the largest number of the `pairs` (2, m), `a < b` of `n` nodes, that one cut of their order separates."""
    return int(np.cumsum(np.bincount(pairs[0], minlength=n) - np.bincount(pairs[1], minlength=n)).max(initial=0))


def alone(pairs: Ids, n: int) -> float:
    """Return the fraction of `n` nodes that precede all of their neighbours in the `pairs` (2, m), `a < b`.

    They are few in the order of a generator's grid. After refinement they are a sixth, since the vertices of the coarse mesh come
    first. A sweep carries nothing into such a node from earlier ones, and SSOR takes up to a third more iterations.
    """
    comes_later = np.zeros(n, dtype=bool)
    comes_later[pairs[1]] = True
    return 1 - np.count_nonzero(comes_later) / max(n, 1)


class KernelOrder(NamedTuple):
    """Elements in an order that suits the caches and sweeps; users never see it.

    Only nodes of the elements are included. They are in the mesh's order if that is good, else in reverse Cuthill-McKee order. They
    ascend in each linear simplex, and elements are sorted by them. On 38 000 tetrahedra of Gmsh, K takes 61 ns per tetrahedron
    instead of 107 in the mesh's own order (`python -m validation kernels`).

    `vertices` (nv,) are nodes of the mesh, and `elements` (nt,) the positions of the elements in the user's order. `t` (n, nt) are
    their nodes in the new order, and `local` (n, nt) is the index of each in its element.
    """

    vertices: Ids
    elements: Ids
    t: Ids
    local: NDArray[np.int64]


def vertex_order(edges: Ids, n: int) -> Ids:
    """Return the nodes, out of `n`, of the pairs `edges` (2, ne), `a < b`. They are in their own order if that is good, else in
    that of `KernelOrder`.
    """
    used = np.zeros(n, dtype=bool)
    used[edges.ravel()] = True
    vertices = np.flatnonzero(used).astype(np.int32)
    number = np.empty(n, dtype=np.int32)
    number[vertices] = np.arange(len(vertices))
    pairs = number[edges]
    if len(vertices) and (9 * 8 * front(pairs, len(vertices)) > SMALL_FRONT or alone(pairs, len(vertices)) > ALONE):
        begin, others, _ = stars(pairs, len(vertices))
        graph = csr_matrix((np.ones(len(others), dtype=np.int8), others, begin.astype(np.int32)), shape=(len(vertices),) * 2)
        order = reverse_cuthill_mckee(graph, symmetric_mode=True)
        inverse = np.empty_like(order)
        inverse[order] = np.arange(len(order))
        if front(pairs, len(order)) > GAIN * front(np.sort(inverse[pairs], axis=0), len(order)):
            vertices = vertices[order]
    return vertices


def kernel_order(t: Ids, edges: Ids, ascending: bool = True) -> KernelOrder:
    """Return the order for elements `t` (n, nt) with the pairs of nodes `edges` (2, ne) in lexicographic order.

    `ascending`: whether the nodes of each element are sorted, too.
    """
    vertices = vertex_order(edges, int(t.max(initial=-1)) + 1)
    number = np.empty(int(t.max(initial=-1)) + 1, dtype=np.int32)
    number[vertices] = np.arange(len(vertices))
    corners = number[t.T]  # (nt, k + 1)
    local = np.argsort(corners, axis=1)
    sorted_corners = np.ascontiguousarray(np.take_along_axis(corners, local, axis=1).T)
    elements = lexicographic_order(sorted_corners[:4], len(vertices))
    if ascending:
        return KernelOrder(vertices, elements, sorted_corners[:, elements], local.T[:, elements])
    return KernelOrder(vertices, elements, np.ascontiguousarray(corners.T[:, elements]), np.indices(corners.T.shape)[0])


class KernelEdges(NamedTuple):
    """Pairs of nodes (ne, 2), `a < b`, in the order in which the elements first use them; for linear simplices their edges.

    `number` (ne,) are the indices in this order of the pairs in lexicographic order. `t2e` (blocks, m LANES) are the pairs of the
    elements. `marks` (blocks + 1,) is the number of pairs in use before each block. `transposed` (blocks, m LANES) has the bit
    `TRANSPOSED` where the first node of an element's pair has the higher number; it is empty if none has.
    """

    edges: Ids
    number: Ids
    t2e: NDArray[np.uint32]
    marks: NDArray[np.int64]
    transposed: NDArray[np.uint32] = np.empty((0, 0), dtype=np.uint32)

    @property
    def total(self) -> int:
        """Number of edges."""
        return len(self.edges)

    def stars(self, n: int) -> tuple[NDArray[np.int64], Ids, Ids]:
        """Return `begin`, others and entries as `kernels.topology.stars` of `n` nodes, with the indices of pairs in this order."""
        begin, others, entries = stars(np.ascontiguousarray(self.edges[self.number].T), n)
        number = self.number[np.where(entries >= 0, entries, -1 - entries) * (entries != OWN)]
        return begin, others, np.where(entries == OWN, OWN, np.where(entries >= 0, number, -1 - number)).astype(np.int32)


def kernel_edges(t: Ids, element: Element) -> KernelEdges:
    """Return the pairs of nodes of elements `t` (n, nt) in the kernels' order."""
    local = np.array(element.pairs)
    edges, t2e = pairs_in(t, local, int(t.max(initial=-1)) + 1)
    transposed = np.where(t[local[:, 0]] > t[local[:, 1]], TRANSPOSED, np.uint32(0)) if not element.is_linear_simplex else None
    blocks = in_lanes(t2e)
    number, marks = numbers_by_first_use(blocks, edges.shape[1])
    own = np.empty_like(edges.T, order="C")
    own[number] = edges.T
    own_pairs = KernelEdges(own, number, number[blocks].astype(np.uint32), marks)
    return own_pairs if transposed is None else own_pairs._replace(transposed=in_lanes(transposed))


def in_lanes(rows: NDArray[Any]) -> NDArray[Any]:
    """Return the columns of `rows` (m, n) as blocks (blocks, m LANES); unused lanes of the last block repeat the last column."""
    m, n = rows.shape
    blocks = -(-n // LANES)
    padded = np.pad(rows, ((0, 0), (0, blocks * LANES - n)), mode="edge")
    return np.ascontiguousarray(padded.reshape(m, blocks, LANES).transpose(1, 0, 2)).reshape(blocks, m * LANES)


def out_of_lanes(blocks: NDArray[Any], n: int) -> NDArray[Any]:
    """Return the rows (m, n) that `in_lanes` put into blocks."""
    m = blocks.shape[1] // LANES
    return blocks.reshape(-1, m, LANES).transpose(1, 0, 2).reshape(m, -1)[:, :n]


class Shares(NamedTuple):
    """Rows of targets for each part, from `parts` (n + 1,), and `slots` to which each adds its results, instead of the targets.

    A target belongs to the first part that has it. Other parts add to their own slots behind the targets, those of `extra`. These
    slots are then added to the targets in a fixed order. So there are no races, and results do not depend on the order in which
    threads finish.
    """

    parts: NDArray[np.int64]
    slots: NDArray[Any]
    extra: NDArray[np.int32]


def shares_of(targets: NDArray[Any], size: int, each: float, threads: int) -> Shares:
    """Return the shares of the rows of `targets` (n, m), which are 0 ... size - 1; a row is as much work as `each` simplices."""
    parts = parts_of(len(targets), each, threads)
    n = len(parts) - 1
    if n == 1:
        return Shares(parts, targets.ravel(), np.empty(0, dtype=np.int32))
    owner = np.empty(size, dtype=np.int32)
    for part in range(n - 1, -1, -1):
        owner[targets[parts[part] : parts[part + 1]].ravel()] = part
    index, extra = targets.copy(), np.empty(0, dtype=np.int32)
    for part in range(1, n):
        rows = index[parts[part] : parts[part + 1]]
        foreign = owner[rows] != part
        ids = np.unique(rows[foreign])
        rows[foreign] = size + len(extra) + np.searchsorted(ids, rows[foreign])
        extra = np.concatenate([extra, ids]).astype(np.int32)
    return Shares(parts, index.ravel(), extra)
