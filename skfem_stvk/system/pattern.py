"""The pattern of K: which blocks there are, and where their values stand."""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray
from scipy.sparse import csr_matrix

from ..errors import StvkError, name_ids
from ..kernels.topology import expand, first_places, lexicographic_order, stars
from ..mesh.simplices import check_index_range


class Structure:
    """Rows and columns of a CSR matrix.

    Attributes
    ----------
    indptr, indices : int32 arrays of scipy's CSR format, columns sorted; read only.
    shape : (rows, columns).
    nnz : number of values.
    """

    def __init__(self, indptr: NDArray[np.int32], indices: NDArray[np.int32], shape: tuple[int, int]) -> None:
        self.indptr, self.indices, self.shape, self.nnz = indptr, indices, shape, len(indices)
        self.indptr.flags.writeable = self.indices.flags.writeable = False
        self._known: tuple[Any, Any, Any] = _nothing, None, None

    def matrix(self, data: NDArray[Any]) -> csr_matrix:
        """A CSR matrix around the values `data` (nnz,), which it does not copy.

        Its index arrays are copies, so that changing the matrix in place cannot harm the structure.
        """
        return csr_matrix((data, self.indices.copy(), self.indptr.copy()), shape=self.shape)

    def fits(self, matrix: Any, dtype: DTypeLike) -> bool:
        """Whether this is a CSR matrix of this type that still has this structure, and room for its values.

        The matrix that was found to fit last is not looked through again as long as it holds the same index arrays: edit those in place and
        this goes unnoticed.
        """
        if not isinstance(matrix, csr_matrix) or matrix.dtype != dtype or matrix.shape != self.shape or matrix.nnz != self.nnz:
            return False
        if matrix.data.shape != (self.nnz,) or not matrix.data.flags.c_contiguous or not matrix.data.flags.writeable:
            return False
        if self._known[0]() is matrix and self._known[1] is matrix.indices and self._known[2] is matrix.indptr:
            return True
        fits: bool = np.array_equal(matrix.indptr, self.indptr) and np.array_equal(matrix.indices, self.indices)
        if fits:
            self._known = weakref.ref(matrix), matrix.indices, matrix.indptr
        return fits

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_known": (_nothing, None, None)}


class Pattern(Structure):
    """The full block pattern of a matrix with a `d x d` block for each vertex and each pair of vertices on an edge.

    Zeros are kept, so the pattern does not depend on the state, and a symbolic factorisation can be reused.

    Parameters
    ----------
    edges : of each term, (2, ne) vertices `a < b` in lexicographic order.

    Attributes
    ----------
    indptr, indices : int32 arrays of scipy's CSR format, columns sorted; read only.
    shape : (ndofs, ndofs).
    nnz : number of values.
    strides : (nv,) values from a row of a vertex to its next.

    Raises
    ------
    MeshError
        if there are more values than 32-bit indices can count.
    """

    def __init__(self, nv: int, d: int, edges: Sequence[NDArray[np.int32]]) -> None:
        self._d = d
        self._begin, self._columns, _ = stars(edges[0] if len(edges) == 1 else _union(edges, nv), nv)
        check_index_range(d * d * len(self._columns), "values of K")
        self.strides = (d * np.diff(self._begin)).astype(np.int32)
        super().__init__(*expand(self._begin, self._columns, d), (d * nv, d * nv))

    def places(self, a: NDArray[np.int32], b: NDArray[np.int32]) -> NDArray[np.int32]:
        """(n,) place in the CSR values of the first value of each block `(a, b)`; its next rows follow after `strides[a]`.

        Raises
        ------
        StvkError
            if a block is not in the pattern.
        """
        places = first_places(self._begin, self._columns, self._d, a, b)
        missing = np.flatnonzero(places < 0)
        if len(missing):
            pairs = [(int(a[i]), int(b[i])) for i in missing[:5]]
            raise StvkError(
                f"{name_ids(missing, 'block')}: not in the pattern of K, vertices {pairs}: no edge joins them. The pattern is made "
                "from the edges of the terms; a term must name all the pairs it writes to."
            )
        return places.astype(np.int32)

    def memory(self) -> int:
        """Bytes of its arrays."""
        return sum(array.nbytes for array in (self._begin, self._columns, self.strides, self.indptr, self.indices))


def _nothing() -> None:
    """A reference to nothing."""


def _union(edges: Sequence[NDArray[np.int32]], nv: int) -> NDArray[np.int32]:
    """The edges of all terms, each once."""
    every = np.ascontiguousarray(np.concatenate(edges, axis=1))
    every = every[:, lexicographic_order(every, nv)]
    first = np.ones(every.shape[1], dtype=bool)
    first[1:] = (every[:, 1:] != every[:, :-1]).any(axis=0)
    return np.ascontiguousarray(every[:, first])
