"""SuperLU of SciPy: direct, on one thread, for every matrix."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, ClassVar

import numpy as np
from scipy.sparse import csc_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from .checks import (
    LatestFactors,
    check_kind,
    checked_right,
    checked_unknowns,
    checked_values,
    latest_only,
    solve_checked,
    written_to,
)
from .solver import Kind, Outcome, Solution, Unknowns, Vector

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
        return SuperLUAnalysis(self, checked_unknowns(unknowns))


class SuperLUAnalysis:
    """Structure that matrices must have."""

    def __init__(self, solver: SuperLU, unknowns: Unknowns) -> None:
        self._solver, self._unknowns, self._latest = solver, unknowns, LatestFactors()

    def factorise(self, K: Any, kind: Kind) -> SuperLUFactors:
        """Factorise `K = L U`. The outcome of a solve reports a zero pivot."""
        check_kind(self._solver, kind)
        values = checked_values(K, self._unknowns).copy()
        matrix = csc_matrix((values, K.indices, K.indptr), shape=K.shape)  # of K', whose structure is that of K
        return SuperLUFactors(matrix, kind, self._latest)


class SuperLUFactors:
    """Factors `L U` of the transpose, because rows in CSR format are columns in SuperLU's."""

    def __init__(self, transpose: csc_matrix, kind: Kind, latest: LatestFactors) -> None:
        self._transpose, self._kind = transpose, kind
        self._latest, self._number = latest, latest.next()
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

    @latest_only
    def solve(self, b: Vector, rtol: float = 1e-10, x0: Vector | None = None, out: Vector | None = None) -> Solution:
        """Solve with the factors, and refine if the residual requires it. `x0` is ignored."""
        b, rtol, _ = checked_right(b, self._transpose.shape[0], rtol, x0, out)
        if self._lu is None:
            return written_to(Solution.none(b, Outcome.SINGULAR), out)
        lu, K = self._lu, self._transpose.T
        return written_to(solve_checked(K.__matmul__, partial(lu.solve, trans="T"), b, rtol), out)

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
