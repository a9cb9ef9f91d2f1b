"""PARDISO analyses once, releases its memory, and reports perturbed and singular matrices."""

import numpy as np
import pytest
from linear.problems import indefinite, problem

from skfem_stvk.errors import StvkError
from skfem_stvk.linear import Kind, Outcome, Pardiso, Unknowns

pytest.importorskip("pypardiso")


def test_the_elimination_order_is_computed_once(monkeypatch):
    from pypardiso.pardiso_wrapper import PyPardisoSolver

    phases, call = [], PyPardisoSolver._call_pardiso
    monkeypatch.setattr(PyPardisoSolver, "_call_pardiso", lambda self, A, b: phases.append(self.phase) or call(self, A, b))
    K, unknowns = problem()
    analysis = Pardiso().analyse(unknowns)
    for _ in range(3):
        analysis.factorise(K, Kind.SYMMETRIC).solve(np.ones(unknowns.n), 1e-6)
    assert phases == [11, 22, 33, 22, 33, 22, 33]


def test_memory_is_released_with_the_analysis(monkeypatch):
    from pypardiso.pardiso_wrapper import PyPardisoSolver

    freed, free = [], PyPardisoSolver.free_memory
    monkeypatch.setattr(PyPardisoSolver, "free_memory", lambda self, everything: freed.append(everything) or free(self, everything))
    K, unknowns = problem()
    analysis = Pardiso().analyse(unknowns)
    factors = analysis.factorise(K, Kind.SYMMETRIC)
    del analysis
    assert not freed and factors.negative_pivots == 0
    del factors
    assert freed == [True]


def test_perturbed_pivots_are_counted_and_their_inertia_is_not_claimed():
    K, unknowns = problem("sheet")
    values = np.linalg.eigvalsh(K.toarray())
    row = np.repeat(np.arange(unknowns.n), np.diff(K.indptr))
    shifted = K.copy()
    shifted.data[row == K.indices] -= values[0] * (1 + 1e-15)
    factors = Pardiso().analyse(unknowns).factorise(shifted, Kind.SYMMETRIC)
    assert factors.perturbed_pivots == 1 and factors.negative_pivots is None
    assert Pardiso().analyse(unknowns).factorise(indefinite(K, unknowns), Kind.SYMMETRIC).perturbed_pivots == 0


def test_errors_during_a_solve_are_distinguished(monkeypatch):
    """MKL up to 2023 reports a singular matrix only during the solve."""
    from pypardiso.pardiso_wrapper import PyPardisoError, PyPardisoSolver

    K, unknowns = problem()
    factors = Pardiso().analyse(unknowns).factorise(K, Kind.SYMMETRIC)
    codes = iter([-4, -7, -2])

    def refused(self, A, b):
        raise PyPardisoError(next(codes))

    with monkeypatch.context() as patch:
        patch.setattr(PyPardisoSolver, "_call_pardiso", refused)
        for _ in range(2):
            solution = factors.solve(np.ones(unknowns.n))
            assert solution.outcome is Outcome.SINGULAR and not solution.x.any()
        with pytest.raises(StvkError, match="error -2, not enough memory"):
            factors.solve(np.ones(unknowns.n))
    assert factors.solve(np.ones(unknowns.n), 1e-6).outcome is Outcome.SOLVED


def test_out_is_written_if_the_factorisation_is_singular(monkeypatch):
    from pypardiso.pardiso_wrapper import PyPardisoError, PyPardisoSolver

    K, unknowns = problem()
    analysis, call = Pardiso().analyse(unknowns), PyPardisoSolver._call_pardiso

    def refused(self, A, b):
        if self.phase == 22:
            raise PyPardisoError(-4)
        return call(self, A, b)

    monkeypatch.setattr(PyPardisoSolver, "_call_pardiso", refused)
    out = np.full(unknowns.n, 7.0)
    solution = analysis.factorise(K, Kind.SYMMETRIC).solve(np.ones(unknowns.n), out=out)
    assert solution.outcome is Outcome.SINGULAR and solution.x is out and not out.any()


def test_a_missing_diagonal_is_refused_before_pardiso_is_called():
    K, unknowns = problem()
    row = np.repeat(np.arange(unknowns.n), np.diff(K.indptr))
    K.data[(row == 4) & (K.indices == 4)] = 0
    K.eliminate_zeros()
    with pytest.raises(StvkError, match=r"no diagonal entry in 1 row \(4\)"):
        Pardiso().analyse(Unknowns(unknowns.vertex, unknowns.component, K.indptr, K.indices))
