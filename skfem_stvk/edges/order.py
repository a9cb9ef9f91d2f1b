"""The kernels' own order of vertices, elements and edges: neighbours in space are neighbours in memory."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import reverse_cuthill_mckee

from ..kernels.topology import lexicographic_order, numbers_by_first_use, stars
from .lanes import in_lanes
from .topology import edge_topology

Ids = NDArray[np.int32]


class OwnOrder(NamedTuple):
    """Simplices in an order that the caches like; users never see it.

    Vertices in reverse Cuthill-McKee order (only those that the simplices have), ascending in each simplex, simplices sorted by them.
    On 38 000 tetrahedra of Gmsh, K takes 61 ns a tetrahedron instead of 107 in the mesh's own order (`python -m validation kernels`).

    Attributes
    ----------
    vertices : (nv,) vertex of the mesh.
    elements : (nt,) position of the simplex in what came.
    t : (k + 1, nt) vertices of the simplices, in this order.
    local : (k + 1, nt) which vertex of the simplex each of them was.
    """

    vertices: Ids
    elements: Ids
    t: Ids
    local: NDArray[np.int64]


def own_order(t: Ids, edges: Ids) -> OwnOrder:
    """The order for simplices `t` (k + 1, nt) with these `edges` (2, ne) in lexicographic order."""
    used = np.zeros(int(t.max()) + 1, dtype=bool)
    used[t.ravel()] = True
    vertices = np.flatnonzero(used).astype(np.int32)
    number = np.empty(len(used), dtype=np.int32)
    number[vertices] = np.arange(len(vertices))
    begin, others, _ = stars(number[edges], len(vertices))
    graph = csr_matrix((np.ones(len(others), dtype=np.int8), others, begin.astype(np.int32)), shape=(len(vertices),) * 2)
    vertices = vertices[reverse_cuthill_mckee(graph, symmetric_mode=True)]
    number[vertices] = np.arange(len(vertices))
    corners = number[t.T]  # (nt, k + 1)
    local = np.argsort(corners, axis=1)
    corners = np.ascontiguousarray(np.take_along_axis(corners, local, axis=1).T)
    elements = lexicographic_order(corners, len(vertices))
    return OwnOrder(vertices, elements, corners[:, elements], local.T[:, elements])


class OwnEdges(NamedTuple):
    """Edges in the order in which the simplices first use them.

    Attributes
    ----------
    edges : (ne, 2) vertices `a < b`.
    number : (ne,) place in this order of the edges in lexicographic order.
    t2e : (blocks, m LANES) edges of the simplices.
    marks : (blocks + 1,) edges that the blocks before use.
    """

    edges: Ids
    number: Ids
    t2e: NDArray[np.uint32]
    marks: NDArray[np.int64]

    @property
    def total(self) -> int:
        """Number of edges."""
        return len(self.edges)


def own_edges(t: Ids) -> OwnEdges:
    """The edges of simplices `t` (k + 1, nt) in their own order."""
    edges, t2e = edge_topology(t)
    blocks = in_lanes(t2e)
    number, marks = numbers_by_first_use(blocks, edges.shape[1])
    own = np.empty_like(edges.T, order="C")
    own[number] = edges.T
    return OwnEdges(own, number, number[blocks].astype(np.uint32), marks)
