"""Conjugate gradients end in the same way with either loop."""

import numpy as np
import pytest

from skfem_stvk.linear import Outcome
from skfem_stvk.linear.cg import solve_by


class Drifting:
    """Loop that reports a smaller residual than that of x.

    Every run reaches the requested residual; the true residual is the next number of `off` times as large.
    """

    def __init__(self, off):
        self.size, self.norm, self.curvature = 1.0, 1.0, np.nan
        self.iterations, self.off, self.asked = 0, list(off), []

    def run(self, enough, most):
        self.iterations, self.norm = self.iterations + 5, enough
        self.asked.append(enough)
        return Outcome.SOLVED

    def true_residual(self):
        self.norm *= self.off.pop(0)
        return self.norm

    def x(self):
        return np.ones(3)


def solved(off, rtol=1e-6):
    search = Drifting(off)
    return search, solve_by(search, np.ones(3), rtol, 100)


def test_a_true_residual_ends_the_loop():
    search, found = solved([1.0])
    assert search.asked == [1e-6] and found.outcome is Outcome.SOLVED and found.residual == 1e-6 and found.iterations == 5


def test_a_wrong_residual_restarts_the_loop_with_a_smaller_target():
    search, found = solved([1.5, 1.5])
    assert search.asked == [1e-6, 5e-7] and found.outcome is Outcome.SOLVED and found.residual == pytest.approx(7.5e-7)
    assert found.iterations == 10


def test_a_residual_too_large_after_the_restart_is_inaccurate():
    search, found = solved([3.0, 3.0])
    assert len(search.asked) == 2 and found.outcome is Outcome.INACCURATE and found.residual == pytest.approx(1.5e-6)
