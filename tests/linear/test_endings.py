"""When conjugate gradients end, whatever loop they are."""

import numpy as np
import pytest

from skfem_stvk.linear import Outcome
from skfem_stvk.linear.cg import solve_by


class Drifting:
    """A loop whose residual is smaller than that of x: every run reaches what is asked, in truth `off` times as much."""

    def __init__(self, off):
        self.size = self.norm = 1.0
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


def test_a_residual_that_is_true_ends_it():
    search, found = solved([1.0])
    assert search.asked == [1e-6] and found.outcome is Outcome.SOLVED and found.residual == 1e-6 and found.iterations == 5


def test_where_the_residual_was_too_small_the_loop_starts_again_and_goes_further():
    search, found = solved([1.5, 1.5])
    assert search.asked == [1e-6, 5e-7] and found.outcome is Outcome.SOLVED and found.residual == pytest.approx(7.5e-7)
    assert found.iterations == 10


def test_what_is_too_large_once_more_is_not_claimed():
    search, found = solved([3.0, 3.0])
    assert len(search.asked) == 2 and found.outcome is Outcome.INACCURATE and found.residual == pytest.approx(1.5e-6)
