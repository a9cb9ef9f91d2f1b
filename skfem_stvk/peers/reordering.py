"""A sparse matrix in another order of the degrees of freedom, for the price of one indexing."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix


class Reordering:
    """Matrices of one pattern, brought to other rows and columns.

    Parameters
    ----------
    numbered : a sparse matrix of the pattern, with the values 1, 2, 3, ... as they lie in memory.
    dofs : the new degree of freedom of each row and column.
    ndofs : the number of new degrees of freedom.

    >>> two = csr_matrix(([1.0, 2.0, 3.0], [0, 0, 1], [0, 1, 3]))
    >>> two.toarray().tolist(), Reordering(two, np.array([1, 0]), 2)(np.array([7.0, 8.0, 9.0])).toarray().tolist()
    ([[1.0, 0.0], [2.0, 3.0]], [[9.0, 8.0], [0.0, 7.0]])
    """

    def __init__(self, numbered: Any, dofs: NDArray[np.intp], ndofs: int) -> None:
        entries = numbered.tocoo()
        self._pattern = coo_matrix((entries.data, (dofs[entries.row], dofs[entries.col])), shape=(ndofs, ndofs)).tocsr()
        self._order = self._pattern.data.astype(np.intp) - 1

    def __call__(self, data: NDArray[np.float64]) -> csr_matrix:
        """The matrix with these values, which it copies."""
        return csr_matrix((data[self._order], self._pattern.indices, self._pattern.indptr), shape=self._pattern.shape)
