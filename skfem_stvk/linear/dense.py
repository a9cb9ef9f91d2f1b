"""Factors of small full matrices."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from scipy.linalg.lapack import dgetrf, dgetrs, dpotrf, dpotrs

from ..arguments import Array
from .solver import Outcome, Solution

#: Eigenvalues of a matrix that stands in for an indefinite one are at least this part of the largest one.
LEAST = 1e-8


class DenseSolver:
    """The name and the abilities of `DenseFactors`, as messages and problems ask a linear solver for them."""

    name: ClassVar[str] = "dense"
    iterative: ClassVar[bool] = False
    matrix_free: ClassVar[bool] = False


class DenseFactors:
    """Factors of a full matrix `K` (n, n), which is kept: Cholesky's, LU if it is not symmetric, else its eigenvalues.

    Only a symmetric matrix that is not positive definite needs eigenvalues. They are counted, and `turned` takes their absolute
    values, so that the solution is a direction in which the energy falls.

    >>> DenseFactors(np.array([[2.0, 1.0], [1.0, 1.0]])).solve(np.array([3.0, 2.0])).x
    array([1., 1.])
    >>> saddle = np.diag([2.0, -1.0])
    >>> DenseFactors(saddle).negative_pivots, DenseFactors(saddle, turned=True).solve(np.ones(2)).x
    (1, array([0.5, 1. ]))
    """

    def __init__(self, K: Array, symmetric: bool = True, turned: bool = False) -> None:
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
                self._values = np.maximum(np.abs(values), LEAST * np.abs(values).max(initial=0.0)) if turned else values
        else:
            self._factors, self._pivots, _ = dgetrf(K)

    def solve(self, b: Array, rtol: float = 1e-10, x0: Array | None = None, out: Array | None = None) -> Solution:
        """`x` with `K x = b`, as precise as the factors are: `rtol` and `x0` are of other solvers."""
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
