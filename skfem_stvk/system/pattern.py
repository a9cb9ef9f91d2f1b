"""The pattern of K: which blocks there are, and where their values stand."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ..edges import Places
from ..errors import StvkError, name_ids
from ..mesh.simplices import check_index_range


class Pattern:
    """The full block pattern of a matrix with a `d x d` block for each vertex and each pair of vertices on an edge.

    Zeros are kept, so the pattern does not depend on the state, and a symbolic factorisation can be reused.

    Attributes
    ----------
    indptr, indices : int32 arrays of scipy's CSR format, columns sorted; read only.
    shape : (ndofs, ndofs).
    nnz : number of values.

    Raises
    ------
    MeshError
        if there are more values than 32-bit indices can count.
    """

    def __init__(self, nv: int, d: int, edges: Iterable[NDArray[np.int32]]) -> None:
        ends = np.concatenate([np.empty((2, 0), dtype=np.int64), *edges], axis=1).astype(np.int64)
        own = np.arange(nv, dtype=np.int64)
        self._keys = np.unique(np.concatenate([own * nv + own, ends[0] * nv + ends[1], ends[1] * nv + ends[0]]))
        self._nv, self._d = nv, d
        self.nnz = d * d * len(self._keys)
        check_index_range(self.nnz, "values of K")
        self.shape = (d * nv, d * nv)
        rows, columns = self._keys // nv, self._keys % nv
        self._begin = np.searchsorted(rows, np.arange(nv + 1))  # first block of each block row
        per_row = np.diff(self._begin)
        self.indptr = np.concatenate([[0], np.cumsum(np.repeat(d * per_row, d))]).astype(np.int32)
        self.indices = np.empty(self.nnz, dtype=np.int32)
        at = self.values_at(rows, columns)
        self.indices[at] = (d * columns[:, None] + np.arange(d))[:, None, :]
        self.indptr.flags.writeable = self.indices.flags.writeable = False

    def values_at(self, a: NDArray[np.integer[Any]], b: NDArray[np.integer[Any]]) -> NDArray[np.int32]:
        """(n, d, d) places of the values of the blocks `(a, b)` in the CSR data.

        Raises
        ------
        StvkError
            if a block is not in the pattern.
        """
        nv, d = self._nv, self._d
        keys = np.asarray(a, dtype=np.int64) * nv + b
        block = np.minimum(np.searchsorted(self._keys, keys), len(self._keys) - 1)
        missing = np.flatnonzero(self._keys[block] != keys)
        if len(missing):
            pairs = [(int(keys[i] // nv), int(keys[i] % nv)) for i in missing[:5]]
            raise StvkError(
                f"{name_ids(missing, 'block')}: not in the pattern of K, vertices {pairs}: no edge joins them. The pattern is made "
                "from the edges of the terms; a term must name all the pairs it writes to."
            )
        begin, count = self._begin[keys // nv], np.diff(self._begin)[keys // nv]
        first = d * d * begin + d * (block - begin)
        places = first[:, None, None] + (d * count)[:, None, None] * np.arange(d)[:, None] + np.arange(d)
        return places.astype(np.int32)

    def places(self, edges: NDArray[np.int32]) -> Places:
        """Where the blocks of these edges (2, ne) and of all vertices stand."""
        own = np.arange(self._nv)
        return Places(self.values_at(edges[0], edges[1]), self.values_at(edges[1], edges[0]), self.values_at(own, own))

    def matrix(self, data: NDArray[np.float64]) -> csr_matrix:
        """A CSR matrix of this pattern around the values `data` (nnz,), which it does not copy.

        Its index arrays are copies, so that changing the matrix in place cannot harm the pattern.
        """
        return csr_matrix((data, self.indices.copy(), self.indptr.copy()), shape=self.shape)

    def fits(self, matrix: Any) -> bool:
        """Whether this is a CSR matrix of doubles that still has this pattern."""
        return (
            isinstance(matrix, csr_matrix)
            and matrix.dtype == np.float64
            and matrix.shape == self.shape
            and np.array_equal(matrix.indptr, self.indptr)
            and np.array_equal(matrix.indices, self.indices)
        )
