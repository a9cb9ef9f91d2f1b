"""One suite tests the results of all solvers, refused arguments, and stale factors."""

import warnings

import numpy as np
import pytest
from linear.problems import NAMES, indefinite, matrix_for, problem

from skfem_stvk.errors import StateError, StvkError
from skfem_stvk.linear import SOLVERS, BlockJacobiCg, Kind, Outcome, Petsc, Solution, SsorCg, SuperLU, Unknowns
from skfem_stvk.linear.pardiso import pardiso_is_installed


def is_missing(solver):
    """Return whether the package of an optional solver cannot be imported."""
    return {"pardiso": not pardiso_is_installed(), "petsc": not Petsc().available}.get(solver.name, False)


EVERY = [
    pytest.param(s, id=s.name, marks=pytest.mark.skipif(is_missing(s), reason="the package is missing"))
    for s in (*SOLVERS, Petsc())
] + [pytest.param(solver, id=f"{solver.name}, assembled") for solver in (BlockJacobiCg(assembled=True), SsorCg(assembled=True))]
all_solvers = pytest.mark.parametrize("solver", EVERY)
direct = pytest.mark.parametrize("solver", [p for p in EVERY if not p.values[0].iterative])
iterative = pytest.mark.parametrize("solver", [p for p in EVERY if p.values[0].iterative])
DEFINITE, SYMMETRIC, GENERAL = Kind.POSITIVE_DEFINITE, Kind.SYMMETRIC, Kind.GENERAL


def load(n, seed=3):
    return np.random.default_rng(seed).standard_normal(n)


def true_residual(K, x, b):
    return np.linalg.norm(b - K @ x) / np.linalg.norm(b)


def factorised(solver, K, unknowns, kind=SYMMETRIC):
    return solver.analyse(unknowns).factorise(matrix_for(solver, K, unknowns), kind)


@pytest.mark.few
@all_solvers
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("amount", [0.0, 0.2])
def test_the_residual_is_below_rtol_and_reported_correctly(solver, name, amount):
    K, unknowns = problem(name, amount)
    b = load(unknowns.n)
    factors = factorised(solver, K, unknowns)
    for rtol in (1e-3, 1e-9):
        solution = factors.solve(b, rtol)
        assert solution.outcome is Outcome.SOLVED, solution.outcome.value
        residual = true_residual(K, solution.x, b)
        assert residual <= rtol * (1 + 1e-6)
        assert abs(residual - solution.residual) <= 1e-10 + 1e-2 * residual


@all_solvers
def test_a_second_matrix_is_solved_with_the_same_analysis(solver):
    K, unknowns = problem()
    other, b = problem(amount=0.3)[0], load(unknowns.n)
    analysis = solver.analyse(unknowns)
    analysis.factorise(matrix_for(solver, K, unknowns), SYMMETRIC).solve(b)
    x = analysis.factorise(matrix_for(solver, other, unknowns), DEFINITE).solve(b, 1e-9).x
    assert true_residual(other, x, b) <= 1e-9 < 1e-3 < true_residual(K, x, b)


@all_solvers
def test_stale_factors_refuse_to_solve(solver):
    K, unknowns = problem()
    analysis = solver.analyse(unknowns)
    old = analysis.factorise(matrix_for(solver, K, unknowns), SYMMETRIC)
    new = analysis.factorise(matrix_for(solver, K, unknowns), SYMMETRIC)
    with pytest.raises(StvkError, match="stale"):
        old.solve(load(unknowns.n))
    assert new.solve(load(unknowns.n)).outcome is Outcome.SOLVED


@pytest.mark.parametrize("solver", [p for p in EVERY if not p.values[0].matrix_free])
def test_refilling_a_matrix_in_place_does_not_change_the_factors(solver):
    K, unknowns = problem()
    same, b = K.copy(), load(unknowns.n)
    factors = solver.analyse(unknowns).factorise(K, SYMMETRIC)
    K.data[:] = problem(amount=0.3)[0].data
    solution = factors.solve(b, 1e-9)
    assert solution.outcome is Outcome.SOLVED and true_residual(same, solution.x, b) <= 1e-9


@pytest.mark.few
@all_solvers
@pytest.mark.parametrize("size", [1e-60, 1e60])
def test_solutions_are_proportional_to_small_and_large_loads(solver, size):
    K, unknowns = problem()
    b = load(unknowns.n)
    factors = factorised(solver, K, unknowns)
    one, other = factors.solve(b, 1e-10).x, factors.solve(size * b, 1e-10).x
    assert np.abs(other / size - one).max() < 1e-6 * np.abs(one).max()


@pytest.mark.few
@all_solvers
@pytest.mark.parametrize("size", [1e-25, 1e25])
def test_units_of_stiffness_do_not_matter(solver, size):
    K, unknowns = problem()
    b = load(unknowns.n)
    solution = factorised(solver, size * K, unknowns).solve(b, 1e-9)
    assert true_residual(size * K, solution.x, b) <= 1e-9


@all_solvers
@pytest.mark.parametrize("bad", [0.0, np.nan, np.inf, 1e160, 1e308])
def test_loads_without_a_solution_are_outcomes_with_zeros_in_out(solver, bad):
    """A load whose norm overflows is not finite either, and NumPy gives no warning in addition to the outcome."""
    K, unknowns = problem()
    b, out = load(unknowns.n) * (bad != 0), np.full(unknowns.n, 7.0)
    b[5] = bad
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = factorised(solver, K, unknowns).solve(b, 1e-9, out, out)
    assert found.outcome is (Outcome.NOT_FINITE if bad else Outcome.SOLVED) and found.residual == bool(bad)
    assert found.x is out and not out.any()


@all_solvers
def test_a_matrix_that_is_not_finite_is_refused(solver):
    K, unknowns = problem()
    K.data[K.indptr[7] + np.flatnonzero(K.indices[K.indptr[7] : K.indptr[8]] == 7)] = np.nan
    with pytest.raises(StateError, match="not finite"):
        factorised(solver, K, unknowns)


@pytest.mark.parametrize("solver", [p for p in EVERY if not p.values[0].matrix_free])
def test_another_structure_than_analysed_is_refused(solver):
    K, unknowns = problem()
    analysis, dropped = solver.analyse(unknowns), K.copy()
    dropped.data[abs(dropped.data) < 0.1 * dropped.data.max()] = 0
    dropped.eliminate_zeros()
    for other, words in ((dropped, "another structure"), (K.tocoo(), "csr_matrix"), (K[:5, :5], "shape")):
        with pytest.raises(StvkError, match=words):
            analysis.factorise(other, SYMMETRIC)


@pytest.mark.parametrize("solver", [p for p in EVERY if p.values[0].takes < GENERAL])
def test_iterative_solvers_refuse_general_matrices_and_name_direct_solvers(solver):
    K, unknowns = problem()
    with pytest.raises(StvkError, match=r"general.*'superlu', 'pardiso'"):
        solver.analyse(unknowns).factorise(matrix_for(solver, K, unknowns), GENERAL)


@direct
def test_direct_solvers_solve_unsymmetric_matrices_before_and_after_symmetric_ones(solver):
    K, unknowns = problem()
    b, skewed = load(unknowns.n), K.copy()
    skewed.data *= 1 + 0.2 * np.random.default_rng(5).uniform(-1, 1, K.nnz)
    assert abs(skewed - skewed.T).max() > 0.1 * abs(K).max()
    analysis = solver.analyse(unknowns)
    for matrix, kind in ((K, SYMMETRIC), (skewed, GENERAL), (K, DEFINITE), (skewed, GENERAL)):
        factors = analysis.factorise(matrix, kind)
        assert true_residual(matrix, factors.solve(b, 1e-10).x, b) <= 1e-10
        assert factors.negative_pivots == (None if kind == GENERAL else 0)


@direct
@pytest.mark.parametrize("below", [1, 3])
def test_negative_pivots_count_negative_eigenvalues(solver, below):
    K, unknowns = problem("sheet")
    factors = solver.analyse(unknowns).factorise(indefinite(K, unknowns, below), SYMMETRIC)
    assert factors.negative_pivots == below
    b = load(unknowns.n)
    assert true_residual(indefinite(K, unknowns, below), factors.solve(b).x, b) <= 1e-10


@iterative
def test_negative_curvature_is_an_outcome_with_the_last_iterate(solver):
    K, unknowns = problem()
    b, matrix = load(unknowns.n), indefinite(K, unknowns)
    solution = factorised(solver, matrix, unknowns).solve(b, 1e-12)
    assert solution.outcome is Outcome.NEGATIVE_CURVATURE
    assert solution.iterations == 0 or b @ solution.x > 0
    assert abs(true_residual(matrix, solution.x, b) - solution.residual) < 1e-9


@iterative
def test_a_negative_definite_matrix_is_detected_before_any_iteration(solver):
    K, unknowns = problem()
    matrix = -K
    solution = factorised(solver, matrix, unknowns).solve(load(unknowns.n))
    assert solution.outcome is Outcome.NEGATIVE_CURVATURE and solution.iterations == 0


def singular(K):
    """Return K with the first unknown decoupled and zero on its diagonal."""
    matrix = K.copy()
    row = np.repeat(np.arange(K.shape[0]), np.diff(K.indptr))
    matrix.data[(row == 0) | (K.indices == 0)] = 0
    return matrix


@all_solvers
def test_a_singular_matrix_never_passes_as_solved_and_out_is_written(solver):
    K, unknowns = problem()
    out = np.full(unknowns.n, np.nan)
    solution = factorised(solver, singular(K), unknowns).solve(load(unknowns.n), out=out)
    assert solution.outcome in (Outcome.SINGULAR, Outcome.INACCURATE, Outcome.NEGATIVE_CURVATURE, Outcome.NOT_FINITE)
    assert solution.x is out and np.isfinite(out).all() and solution.residual > 1e-10


@pytest.mark.parametrize("words", ["Factor is exactly singular", "failed to factorize matrix at line 406 in file dpanel_bmod.c"])
def test_both_messages_of_superlu_mean_singular(words, monkeypatch):
    """The second message was raised for a flat membrane, whose matrix is exactly singular."""

    def refused(*_, **__):
        raise RuntimeError(words)

    monkeypatch.setattr("skfem_stvk.linear.superlu.splu", refused)
    K, unknowns = problem()
    solver = SuperLU()
    solution = factorised(solver, K, unknowns).solve(load(unknowns.n))
    assert solution.outcome is Outcome.SINGULAR and not solution.x.any()


@all_solvers
def test_a_residual_below_round_off_is_not_claimed(solver):
    K, unknowns = problem("soft and stiff")
    b = load(unknowns.n)
    solution = factorised(solver, K, unknowns).solve(b, 1e-18)
    assert solution.outcome in (Outcome.INACCURATE, Outcome.OUT_OF_ITERATIONS)
    assert 1e-18 < true_residual(K, solution.x, b) < 1e-9


@all_solvers
def test_solvers_and_solutions_are_frozen(solver):
    with pytest.raises(AttributeError):
        solver.name = "other"
    with pytest.raises(AttributeError):
        Solution(np.zeros(1), 0, 0.0, Outcome.SOLVED).x = 1


def test_all_assembled_solvers_need_the_structure():
    K, unknowns = problem()
    bare = Unknowns(unknowns.vertex, unknowns.component, near_null_space=unknowns.near_null_space)
    for solver in SOLVERS:
        if solver.matrix_free or (solver.name == "pardiso" and not pardiso_is_installed()):
            continue
        with pytest.raises(StvkError, match="indptr, indices = None; expected"):
            solver.analyse(bare).factorise(K, SYMMETRIC)


@all_solvers
def test_the_solution_does_not_depend_on_x0(solver):
    K, unknowns = problem()
    b, x0 = load(unknowns.n), 3 * load(unknowns.n, seed=4)
    factors = factorised(solver, K, unknowns)
    retained, cold, warm = x0.copy(), factors.solve(b, 1e-10), factors.solve(b, 1e-10, x0)
    assert warm.outcome is Outcome.SOLVED and true_residual(K, warm.x, b) <= 1e-10 * (1 + 1e-6)
    assert np.abs(warm.x - cold.x).max() < 1e-7 * np.abs(cold.x).max() and np.array_equal(x0, retained)


@iterative
def test_iterative_solvers_start_from_x0_and_report_its_residual(solver):
    K, unknowns = problem()
    b = load(unknowns.n)
    factors = factorised(solver, K, unknowns)
    cold = factors.solve(b, 1e-9)
    x0 = cold.x + 1e-5 * np.abs(cold.x).max() * load(unknowns.n, seed=4)
    warm, there = factors.solve(b, 1e-9, x0), factors.solve(b, 1e-8, cold.x)
    assert abs(cold.start - 1) < 1e-15 and abs(warm.start - true_residual(K, x0, b)) < 1e-12 + 1e-6 * warm.start
    part = 0.9 if solver.name == "ssor-cg" else 0.8  # it needs few iterations, so it can save few
    assert 0 < warm.iterations < part * cold.iterations
    assert there.iterations == 0 and np.array_equal(there.x, cold.x) and there.residual == there.start <= 1e-8


@all_solvers
def test_x_is_written_to_out_which_may_be_x0_or_the_load(solver):
    K, unknowns = problem()
    b = load(unknowns.n)
    factors = factorised(solver, K, unknowns)
    wanted = factors.solve(b, 1e-9).x
    for x0, out in ((None, np.full(unknowns.n, np.nan)), (x := b.copy(), x), (None, b)):
        found = factors.solve(b, 1e-9, x0, out)
        assert found.x is out and np.abs(out - wanted).max() < 1e-5 * np.abs(wanted).max()


@all_solvers
def test_wrong_lengths_are_refused(solver):
    K, unknowns = problem()
    factors = factorised(solver, K, unknowns)
    for name, arguments in (("b", (np.ones(3),)), ("x0", (load(unknowns.n), 1e-9, np.zeros(3)))):
        with pytest.raises(StvkError, match=rf"{name} has shape \(3,\); expected \({unknowns.n},\)"):
            factors.solve(*arguments)


@iterative
def test_an_infinite_start_is_an_outcome(solver):
    K, unknowns = problem()
    b = load(unknowns.n)
    factors = factorised(solver, K, unknowns)
    found = factors.solve(b, 1e-9, np.full(unknowns.n, np.inf))
    assert found.outcome is Outcome.NOT_FINITE and not found.x.any()
    assert factors.solve(b, 1e-9).outcome is Outcome.SOLVED
