"""Matrices of 3 x 3 blocks: their structure, operations on their values, and the unknowns as block rows, one per vertex."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import reverse_cuthill_mckee

from ..errors import StvkError, name_ids
from ..kernels import sparse as kernels
from ..kernels.compiled import Ids, Reals
from ..kernels.threads import parts_of, run, threads
from .solver import Unknowns, Vector, structure_of

#: Of a product, so many blocks are as much work as a simplex.
BLOCKS = 4


@dataclass(frozen=True)
class BlockStructure:
    """The sparsity pattern of a matrix in the CSR format, counted in blocks, columns sorted.

    It has `width` block columns; `parts` are the block rows of each thread.
    """

    rows: Ids
    columns: Ids
    width: int
    parts: NDArray[np.int64]

    @staticmethod
    def of(graph: csr_matrix, row: int = 1, column: int = 1) -> BlockStructure:
        """Each entry of a graph of nodes, columns sorted, as `row` times `column` blocks.

        >>> two = BlockStructure.of(csr_matrix([[1, 1], [0, 1]]), row=2)
        >>> two.rows.tolist(), two.columns.tolist()
        ([0, 2, 4, 5, 6], [0, 1, 0, 1, 1, 1])
        """
        counts = np.repeat(column * np.diff(graph.indptr), row)
        rows = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
        columns = (column * graph.indices[:, None] + np.arange(column)).ravel().astype(np.int32)
        if row > 1:
            back = np.repeat(column * graph.indptr[:-1], row) - rows[:-1]
            columns = columns[np.repeat(back, counts) + np.arange(rows[-1])]
        return _structure(rows, columns, column * graph.shape[1])

    @property
    def n(self) -> int:
        """Number of block rows."""
        return len(self.rows) - 1

    def room(self, dtype: Any = np.float64) -> Reals:
        """An empty array for the values."""
        return np.empty(9 * len(self.columns), dtype)

    def row_of_each(self) -> Ids:
        """(blocks,) the block row of each block."""
        return np.repeat(np.arange(self.n, dtype=np.int32), np.diff(self.rows))

    def diagonal(self) -> Ids:
        """(n,) places of the diagonal blocks."""
        return np.flatnonzero(self.row_of_each() == self.columns)

    def transposed(self) -> tuple[BlockStructure, Ids]:
        """The structure of the transpose, and which block each of its blocks is the transpose of."""
        places = np.arange(len(self.columns), dtype=np.int32)
        at = csr_matrix((places, self.columns, self.rows), shape=(self.n, self.width)).T.tocsr()
        return _structure(at.indptr, at.indices, self.n), at.data

    def product(self, blocks: Reals, x: Reals, out: Reals, add: bool = False) -> Reals:
        """Write `A x` to `out`, or add it."""
        run(kernels.product, self.parts, self.rows, self.columns, blocks, x, add, out)
        return out

    def multiply(self, blocks: Reals, other: BlockStructure, others: Reals, structure: BlockStructure, out: Reals) -> Reals:
        """Write the values of the product of two matrices to `out`, whose structure holds it."""
        arguments = self.rows, self.columns, blocks, other.rows, other.columns, others, structure.rows, structure.columns
        run(kernels.multiply_blocks, self.parts, *arguments, structure.width, out)
        return out

    def dense(self, blocks: Reals) -> NDArray[np.float64]:
        """The matrix as an array (3 n, 3 width)."""
        matrix = np.zeros((self.n, self.width, 3, 3))
        matrix[self.row_of_each(), self.columns] = blocks.reshape(-1, 3, 3)
        return matrix.transpose(0, 2, 1, 3).reshape(3 * self.n, 3 * self.width)


def _structure(rows: Ids, columns: Ids, width: int) -> BlockStructure:
    n = len(rows) - 1
    parts = parts_of(n, rows[-1] / (BLOCKS * max(n, 1)), threads())
    return BlockStructure(rows.astype(np.int32), columns.astype(np.int32), width, parts)


class Middles(NamedTuple):
    """Block rows that are in the middle of an edge.

    Attributes
    ----------
    ends : (n, 2) the block rows of both ends, of a corner itself twice, -1 where all of an end is held.
    known : (n, 3) which components are unknowns.
    """

    ends: Ids
    known: NDArray[np.bool_]


class VertexRows:
    """K in blocks of vertices, three components always, in the order of Cuthill and McKee.

    Components that are held are padded with a diagonal. The block rows have the `graph`, with the diagonal and columns sorted;
    `vertices` and `first` are the vertex and the first unknown of each. Unknowns are a `component` of a block `row`, at `places` 3
    row + component. A K without a full block for each pair of vertices that it couples is refused.
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
        self.n, self._ends = unknowns.n, unknowns.ends
        self._indptr, self._indices = unknowns.indptr, unknowns.indices

    def fill(self, values: Reals, scale: float, blocks: Reals, single: Reals) -> None:
        """Write the CSR values of K as blocks, and `scale` times them in single precision."""
        own = self.structure.rows, self.structure.columns, self.diagonal, self.first, self.row, self.component
        run(kernels.fill_blocks, self.structure.parts, *own, self._indptr, self._indices, values, scale, blocks, single)

    def middles(self) -> Middles | None:
        """Which block rows are in the middle of which; None where no vertex is."""
        if self._ends is None:
            return None
        row_of = np.full(len(self._ends), -1, dtype=np.int32)
        row_of[self.vertices] = np.arange(len(self.vertices), dtype=np.int32)
        known = np.zeros((len(self.vertices), 3), dtype=bool)
        known.ravel()[self.places] = True
        return Middles(row_of[self._ends[self.vertices]], known)

    def padded(self, x: Vector) -> Vector:
        """Values of the unknowns (n, ...) in block rows (3 rows, ...)."""
        out = np.zeros((3 * self.structure.n, *x.shape[1:]))
        out[self.places] = x
        return out

    def taken(self, x: Vector) -> Vector:
        """Values of block rows (3 rows,) back as those of the unknowns (n,)."""
        return x[self.places]


def _graph(unknowns: Unknowns, starts: Ids, node: Ids) -> csr_matrix:
    """Vertices that K couples, from the first row of each."""
    indptr, indices = structure_of(unknowns)
    counts = np.diff(indptr)
    uneven = np.flatnonzero(counts != counts[starts][node])
    if len(uneven):
        raise StvkError(
            f"K has no full block for each pair of vertices: {name_ids(uneven, 'row')} and others of the same vertex have "
            "different numbers of values. Keep the zeros of K, as System.tangent and FreeDofs.matrix do."
        )
    begin = np.concatenate([[0], np.cumsum(counts[starts])])
    columns = node[indices[np.arange(begin[-1]) + np.repeat(indptr[starts] - begin[:-1], counts[starts])]]
    first = np.diff(columns, prepend=-1) != 0  # in a symmetric structure no row begins with what the one before ends with
    rows = np.concatenate([[0], np.cumsum(first)])[begin]
    return csr_matrix((np.ones(rows[-1], dtype=np.int8), columns[first], rows), shape=(len(starts),) * 2)
