"""Matrices of 3 x 3 blocks: their structure, and what is done with their values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ..kernels import sparse as kernels
from ..kernels.threads import parts_of, run, threads

Ids = NDArray[np.integer[Any]]
Reals = NDArray[np.floating[Any]]

#: Of a product, so many blocks are as much work as a simplex.
BLOCKS = 4


@dataclass(frozen=True)
class BlockStructure:
    """Which blocks there are, in the CSR format.

    Attributes
    ----------
    rows, columns : int32 arrays, counted in blocks; columns sorted.
    width : number of block columns.
    parts : the block rows of each thread.
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
        """Block rows."""
        return len(self.rows) - 1

    def room(self, dtype: Any = np.float64) -> Reals:
        """Room for the values."""
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
        """`A x`, written to `out` or added to it."""
        run(kernels.product, self.parts, self.rows, self.columns, blocks, x, add, out)
        return out

    def multiply(self, blocks: Reals, other: BlockStructure, others: Reals, structure: BlockStructure, out: Reals) -> Reals:
        """The values of the product of two matrices to `out`, of a structure that holds it."""
        arguments = self.rows, self.columns, blocks, other.rows, other.columns, others, structure.rows, structure.columns
        run(kernels.multiply_blocks, self.parts, *arguments, structure.width, out)
        return out

    def dense(self, blocks: Reals) -> NDArray[np.float64]:
        """(3 n, 3 width) all entries."""
        matrix = np.zeros((self.n, self.width, 3, 3))
        matrix[self.row_of_each(), self.columns] = blocks.reshape(-1, 3, 3)
        return matrix.transpose(0, 2, 1, 3).reshape(3 * self.n, 3 * self.width)


def _structure(rows: Ids, columns: Ids, width: int) -> BlockStructure:
    n = len(rows) - 1
    parts = parts_of(n, rows[-1] / (BLOCKS * max(n, 1)), threads())
    return BlockStructure(rows.astype(np.int32), columns.astype(np.int32), width, parts)
