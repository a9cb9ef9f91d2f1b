"""Factors of small dense matrices."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from scipy.linalg.lapack import dgetrf, dgetrs, dpotrf, dpotrs

from ..arguments import Array
from .solver import Outcome, Solution

#: Smallest eigenvalue of the substitute for an indefinite matrix, as a part of the largest one.
LEAST = 1e-8


class DenseSolver:
    """Name and properties of `DenseFactors`, for messages and problems that read them from a linear solver."""

    name: ClassVar[str] = "dense"
    iterative: ClassVar[bool] = False
    matrix_free: ClassVar[bool] = False


class DenseFactors:
    """Factors of a dense matrix `K` (n, n), which is not copied: Cholesky's, LU if K is not symmetric, otherwise its eigenvalues.

    Only a symmetric matrix that is not positive definite needs eigenvalues. The negative ones are counted. With `absolute`, their
    absolute values are used, so that the energy decreases along the solution.

    >>> DenseFactors(np.array([[2.0, 1.0], [1.0, 1.0]])).solve(np.array([3.0, 2.0])).x
    array([1., 1.])
    >>> saddle = np.diag([2.0, -1.0])
    >>> DenseFactors(saddle).negative_pivots, DenseFactors(saddle, absolute=True).solve(np.ones(2)).x
    (1, array([0.5, 1. ]))
    """

    def __init__(self, K: Array, symmetric: bool = True, absolute: bool = False) -> None:
        self._K, self._symmetric = K, symmetric
        self._values: Array | None = None
        self._vectors = K
        self.negative_pivots: int | None = None
        if symmetric:
            self._factors, failed = dpotrf(K, lower=1, clean=0)
            if not failed:
                self.negative_pivots = 0
            elif np.isfinite(K).all():
                values, self._vectors = np.linalg.eigh(K)
                self.negative_pivots = int((values < 0).sum())
                self._values = np.maximum(np.abs(values), LEAST * np.abs(values).max(initial=0.0)) if absolute else values
        else:
            self._factors, self._pivots, _ = dgetrf(K)

    def solve(self, b: Array, rtol: float = 1e-10, x0: Array | None = None, out: Array | None = None) -> Solution:
        """Solve `K x = b` to the precision of the factors. `rtol` and `x0` are ignored; other solvers use them."""
        if self._values is not None:
            if not self._values.all():
                return Solution.none(b, Outcome.SINGULAR)
            x = self._vectors @ ((b @ self._vectors) / self._values)
        elif self._symmetric:
            x = dpotrs(self._factors, b, lower=1)[0]
        else:
            x = dgetrs(self._factors, self._pivots, b)[0]
        if not np.isfinite(x @ x):
            return Solution.none(b, Outcome.SINGULAR if np.isfinite(b).all() else Outcome.NOT_FINITE)
        if out is not None:
            out[:] = x
            x = out
        return Solution(x, 0, 0.0, Outcome.SOLVED)
