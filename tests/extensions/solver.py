"""A toy linear solver: LAPACK on a dense matrix."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from skfem_stvk.linear import Kind, Outcome, Solution


@dataclass(frozen=True)
class Dense:
    """Solver that stores all entries of K, zeros included."""

    name: ClassVar[str] = "dense"
    takes: ClassVar[Kind] = Kind.GENERAL
    matrix_free: ClassVar[bool] = False
    iterative: ClassVar[bool] = False

    def analyse(self, unknowns):
        return self

    def factorise(self, K, kind):
        return DenseFactors(K.toarray())


class DenseFactors:
    """Dense matrix that is factorised at each solve."""

    def __init__(self, K):
        self.K, self.solves = K, 0

    @property
    def negative_pivots(self):
        return int((np.linalg.eigvalsh(self.K) < 0).sum())

    def solve(self, b, rtol=1e-10, x0=None, out=None):
        x = np.linalg.solve(self.K, b)
        if out is not None:
            out[:] = x
        residual = float(np.linalg.norm(b - self.K @ x) / max(np.linalg.norm(b), 1e-300))
        return Solution(x if out is None else out, 0, residual, Outcome.SOLVED)
