"""SuperLU of SciPy: direct, on one thread, for every matrix."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, ClassVar

import numpy as np
from scipy.sparse import csc_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from .solver import CheckedAnalysis, CheckedFactors, Kind, Outcome, Solution, Unknowns, Vector, latest_only, solve_checked

#: Threshold of pivoting: a diagonal entry is the pivot unless it is smaller than this part of the largest entry of its column.
PIVOT = {Kind.POSITIVE_DEFINITE: 0.0, Kind.SYMMETRIC: 1e-3, Kind.GENERAL: 0.1}


@dataclass(frozen=True)
class SuperLU:
    """Sparse LU with a minimum degree order on `K + K'`. No data are retained from one matrix to the next.

    >>> import numpy as np
    >>> from scipy.sparse import csr_matrix
    >>> K = csr_matrix(np.array([[2.0, -1, 0], [-1, -2, 1], [0, 1, 3]]))
    >>> unknowns = Unknowns(np.arange(3), np.zeros(3, dtype=int), K.indptr, K.indices)
    >>> factors = SuperLU().analyse(unknowns).factorise(K, Kind.SYMMETRIC)
    >>> solution = factors.solve(np.array([1.0, 0, 0]))
    >>> solution.x.round(3).tolist(), solution.outcome.value, factors.negative_pivots
    ([0.412, -0.176, 0.059], 'solved', 1)
    """

    name: ClassVar[str] = "superlu"
    takes: ClassVar[Kind] = Kind.GENERAL
    matrix_free: ClassVar[bool] = False
    iterative: ClassVar[bool] = False

    def analyse(self, unknowns: Unknowns) -> SuperLUAnalysis:
        """Store the structure. SuperLU has no separate analysis."""
        return SuperLUAnalysis(self, unknowns)


class SuperLUAnalysis(CheckedAnalysis):
    """Structure that matrices must have."""

    def factorise(self, K: Any, kind: Kind) -> SuperLUFactors:
        """Factorise `K = L U`. The outcome of a solve reports a zero pivot."""
        values = self.begin_with(K, kind).copy()
        matrix = csc_matrix((values, K.indices, K.indptr), shape=K.shape)  # of K', whose structure is that of K
        return SuperLUFactors(self, matrix, kind)


class SuperLUFactors(CheckedFactors):
    """Factors `L U` of the transpose, because rows in CSR format are columns in SuperLU's."""

    def __init__(self, analysis: SuperLUAnalysis, transpose: csc_matrix, kind: Kind) -> None:
        super().__init__(analysis)
        self._transpose, self._kind = transpose, kind
        self._lu = _factors(transpose, kind)

    @cached_property
    def negative_pivots(self) -> int | None:
        """Number of negative pivots on the diagonal of U. Without row exchanges, `U = D L'`. Reading it copies L and U.

        If rows were exchanged, a second factorisation uses diagonal pivots only. If one of them is zero, K is indefinite or
        singular. The result is then 1, which means at least one eigenvalue that is not positive.
        """
        if self._kind == Kind.GENERAL:
            return None
        lu = _factors(self._transpose, Kind.POSITIVE_DEFINITE) if _exchanged(self._lu) else self._lu
        return 1 if lu is None or _exchanged(lu) else int((lu.U.diagonal() < 0).sum())

    @property
    def nbytes(self) -> int:
        """Bytes of L and U."""
        return 0 if self._lu is None else 12 * int(self._lu.nnz)

    @property
    def negative_determinant(self) -> bool | None:
        """Whether the determinant is negative, from the diagonal of U and the exchanges; None if the matrix is singular."""
        lu = self._lu
        if lu is None:
            return None
        exchanges = sum(len(order) - _cycles(order) for order in (lu.perm_r, lu.perm_c))
        return bool((int((lu.U.diagonal() < 0).sum()) + exchanges) % 2)

    def _solve(self, b: Vector, rtol: float, x0: Vector | None, out: Vector | None) -> Solution:
        """Solve with the factors, and refine if the residual requires it. `x0` is ignored."""
        if self._lu is None:
            return Solution.none(b, Outcome.SINGULAR)
        return solve_checked(self._transpose.T.__matmul__, partial(self._lu.solve, trans="T"), b, rtol)

    @latest_only
    def solve_many(self, B: Vector) -> Vector:
        """Return the solutions (n, m) for the columns of B (n, m), not refined; NaN if K is singular."""
        return np.full(B.shape, np.nan) if self._lu is None else np.asarray(self._lu.solve(B, trans="T"))


def _exchanged(lu: Any) -> bool:
    """Return whether rows were exchanged, or there are no factors."""
    return lu is None or not np.array_equal(lu.perm_r, lu.perm_c)


def _cycles(order: Any) -> int:
    """Return the number of cycles of a permutation."""
    n = len(order)
    graph = csr_matrix((np.ones(n), (np.arange(n), order)), shape=(n, n))
    return int(connected_components(graph, directed=False)[0])


def _factors(transpose: csc_matrix, kind: Kind) -> Any:
    try:
        return splu(transpose, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=PIVOT[kind], options={"SymmetricMode": True})
    except RuntimeError as error:  # for some singular matrices the message is only "failed to factorize matrix at line ..."
        if "singular" in str(error) or "failed to factorize" in str(error):
            return None
        raise
