"""The unknowns as block rows, one a vertex."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import reverse_cuthill_mckee

from ..errors import StvkError, name_ids
from ..kernels import sparse as kernels
from ..kernels.threads import run
from .blocks import BlockStructure, Ids, Reals
from .solver import Unknowns, Vector


class VertexRows:
    """K in blocks of vertices: three components always, those that are held padded with a diagonal, in the order of Cuthill and McKee.

    Attributes
    ----------
    graph : of the block rows, with the diagonal, columns sorted.
    structure, diagonal : of K in blocks.
    vertices : (rows,) vertex of each block row.
    first, row, component : first unknown of each block row; block row and component of each unknown.
    places : (n,) `3 row + component`.
    n : number of unknowns.

    Raises
    ------
    StvkError
        if not every pair of vertices that K couples has a full block.
    """

    def __init__(self, unknowns: Unknowns) -> None:
        new = np.diff(unknowns.vertex, prepend=-1) != 0
        starts, node = np.flatnonzero(new), np.cumsum(new) - 1
        graph = _graph(unknowns, starts, node)
        order = reverse_cuthill_mckee(graph, symmetric_mode=True)
        number = np.empty(len(starts), np.int32)
        number[order] = np.arange(len(starts), dtype=np.int32)
        self.graph = graph[order][:, order]
        self.graph.sort_indices()
        self.structure = BlockStructure.of(self.graph)
        self.diagonal = self.structure.diagonal()
        self.vertices = unknowns.vertex[starts[order]]
        self.first, self.row, self.component = starts[order], number[node], unknowns.component.astype(np.int32)
        self.places = 3 * self.row.astype(np.int64) + self.component
        self.n = unknowns.n
        self._indptr, self._indices = unknowns.indptr, unknowns.indices

    def fill(self, values: Reals, scale: float, blocks: Reals, single: Reals) -> None:
        """The CSR values of K as blocks, and `scale` times them."""
        own = self.structure.rows, self.structure.columns, self.diagonal, self.first, self.row, self.component
        run(kernels.fill_blocks, self.structure.parts, *own, self._indptr, self._indices, values, scale, blocks, single)

    def padded(self, x: Vector) -> Vector:
        """(3 rows, ...) values of the unknowns (n, ...) in block rows."""
        out = np.zeros((3 * self.structure.n, *x.shape[1:]))
        out[self.places] = x
        return out

    def taken(self, x: Vector) -> Vector:
        """(n,) back from block rows."""
        return x[self.places]


def _graph(unknowns: Unknowns, starts: Ids, node: Ids) -> csr_matrix:
    """Vertices that K couples, from the first row of each."""
    indptr, indices = unknowns.indptr, unknowns.indices
    if indptr is None or indices is None:
        raise StvkError("The unknowns have no indptr and indices; expected the structure of K over the free degrees of freedom.")
    counts = np.diff(indptr)
    uneven = np.flatnonzero(counts != counts[starts][node])
    if len(uneven):
        raise StvkError(
            f"K has no full block for each pair of vertices: {name_ids(uneven, 'row')} and others of the same vertex have different "
            "numbers of values. Keep the zeros of K, as System.tangent and FreeDofs.matrix do."
        )
    begin = np.concatenate([[0], np.cumsum(counts[starts])])
    columns = node[indices[np.arange(begin[-1]) + np.repeat(indptr[starts] - begin[:-1], counts[starts])]]
    first = np.diff(columns, prepend=-1) != 0  # in a symmetric structure no row begins with what the one before ends with
    rows = np.concatenate([[0], np.cumsum(first)])[begin]
    return csr_matrix((np.ones(rows[-1], dtype=np.int8), columns[first], rows), shape=(len(starts),) * 2)
