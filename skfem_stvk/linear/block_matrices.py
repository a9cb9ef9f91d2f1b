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

#: Number of blocks whose product costs as much as a simplex.
BLOCKS = 4


@dataclass(frozen=True)
class BlockStructure:
    """Sparsity pattern of a matrix in the CSR format, counted in blocks, with sorted columns.

    It has `width` block columns. `parts` are the block rows of each thread.
    """

    rows: Ids
    columns: Ids
    width: int
    parts: NDArray[np.int64]

    @staticmethod
    def of(graph: csr_matrix, row: int = 1, column: int = 1) -> BlockStructure:
        """Return the structure in which each entry of a graph of nodes, with sorted columns, becomes `row` times `column` blocks.

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

    def empty_values(self, dtype: Any = np.float64) -> Reals:
        """Return an empty array for the values."""
        return np.empty(9 * len(self.columns), dtype)

    def block_rows(self) -> Ids:
        """Return the block row of each block (blocks,)."""
        return np.repeat(np.arange(self.n, dtype=np.int32), np.diff(self.rows))

    def diagonal(self) -> Ids:
        """Return the indices (n,) of the diagonal blocks."""
        return np.flatnonzero(self.block_rows() == self.columns)

    def transposed(self) -> tuple[BlockStructure, Ids]:
        """Return the structure of the transpose, and for each of its blocks the index of the block of which it is the transpose."""
        indices = np.arange(len(self.columns), dtype=np.int32)
        at = csr_matrix((indices, self.columns, self.rows), shape=(self.n, self.width)).T.tocsr()
        return _structure(at.indptr, at.indices, self.n), at.data

    def product(self, blocks: Reals, x: Reals, out: Reals, add: bool = False) -> Reals:
        """Write `A x` to `out`, or add it."""
        run(kernels.product, self.parts, self.rows, self.columns, blocks, x, add, out)
        return out

    def multiply(self, blocks: Reals, other: BlockStructure, others: Reals, structure: BlockStructure, out: Reals) -> Reals:
        """Write the values of the product of two matrices to `out`. `structure` must contain the pattern of the product."""
        arguments = self.rows, self.columns, blocks, other.rows, other.columns, others, structure.rows, structure.columns
        run(kernels.multiply_blocks, self.parts, *arguments, structure.width, out)
        return out

    def dense(self, blocks: Reals) -> NDArray[np.float64]:
        """Return the matrix as an array (3 n, 3 width)."""
        matrix = np.zeros((self.n, self.width, 3, 3))
        matrix[self.block_rows(), self.columns] = blocks.reshape(-1, 3, 3)
        return matrix.transpose(0, 2, 1, 3).reshape(3 * self.n, 3 * self.width)


def _structure(rows: Ids, columns: Ids, width: int) -> BlockStructure:
    n = len(rows) - 1
    parts = parts_of(n, rows[-1] / (BLOCKS * max(n, 1)), threads())
    return BlockStructure(rows.astype(np.int32), columns.astype(np.int32), width, parts)


class EdgeMidpoints(NamedTuple):
    """Block rows of vertices in the middle of an edge.

    Attributes
    ----------
    ends
        (n, 2) block rows of both ends of the edge; for a corner its own row twice; -1 if all of an end is constrained.
    known
        (n, 3) whether each component is an unknown.
    """

    ends: Ids
    known: NDArray[np.bool_]


class VertexRows:
    """K in blocks of vertices, always with three components, in the order of Cuthill and McKee.

    Constrained components are padded with a diagonal. The block rows have the `graph`, with the diagonal and sorted columns.
    `vertices` and `first` are the vertex and the first unknown of each block row. An unknown is a `component` of a block `row`, and
    `unknown_indices` are its indices `3 row + component`. A K without a full block for each pair of vertices that it couples is
    refused.
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
        self.unknown_indices = 3 * self.row.astype(np.int64) + self.component
        self.n, self._ends = unknowns.n, unknowns.ends
        self._indptr, self._indices = unknowns.indptr, unknowns.indices

    def fill(self, values: Reals, scale: float, blocks: Reals, single: Reals) -> None:
        """Write the CSR values of K as blocks, and `scale` times them in single precision."""
        own = self.structure.rows, self.structure.columns, self.diagonal, self.first, self.row, self.component
        run(kernels.fill_blocks, self.structure.parts, *own, self._indptr, self._indices, values, scale, blocks, single)

    def midpoints(self) -> EdgeMidpoints | None:
        """Return the block rows at the ends of the edge of each block row; None if no vertex is in the middle of an edge."""
        if self._ends is None:
            return None
        row_of = np.full(len(self._ends), -1, dtype=np.int32)
        row_of[self.vertices] = np.arange(len(self.vertices), dtype=np.int32)
        known = np.zeros((len(self.vertices), 3), dtype=bool)
        known.ravel()[self.unknown_indices] = True
        return EdgeMidpoints(row_of[self._ends[self.vertices]], known)

    def padded(self, x: Vector) -> Vector:
        """Return values of the unknowns (n, ...) as values of block rows (3 rows, ...), padded with zeros."""
        out = np.zeros((3 * self.structure.n, *x.shape[1:]))
        out[self.unknown_indices] = x
        return out

    def unpadded(self, x: Vector) -> Vector:
        """Return values of block rows (3 rows,) as values of the unknowns (n,)."""
        return x[self.unknown_indices]


def _graph(unknowns: Unknowns, starts: Ids, node: Ids) -> csr_matrix:
    """Return the graph of vertices that K couples, from the first row of each vertex."""
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
    first = np.diff(columns, prepend=-1) != 0  # in a symmetric structure, no row begins with the last column of the previous row
    rows = np.concatenate([[0], np.cumsum(first)])[begin]
    return csr_matrix((np.ones(rows[-1], dtype=np.int8), columns[first], rows), shape=(len(starts),) * 2)
