"""One suite for all solvers: what they answer, what they refuse, and that nothing stale is used."""

import warnings

import numpy as np
import pytest
from linear.problems import NAMES, given, indefinite, problem

from skfem_stvk.errors import StateError, StvkError
from skfem_stvk.linear import SOLVERS, BlockJacobiCg, Kind, Outcome, Solution, SsorCg, SuperLU, Unknowns
from skfem_stvk.linear.pardiso import pardiso_is_installed

EVERY = [
    pytest.param(
        s, id=s.name, marks=pytest.mark.skipif(s.name == "pardiso" and not pardiso_is_installed(), reason="pypardiso is missing")
    )
    for s in SOLVERS
] + [pytest.param(solver, id=f"{solver.name}, assembled") for solver in (BlockJacobiCg(assembled=True), SsorCg(assembled=True))]
all_solvers = pytest.mark.parametrize("solver", EVERY)
direct = pytest.mark.parametrize("solver", [p for p in EVERY if not p.values[0].iterative])
iterative = pytest.mark.parametrize("solver", [p for p in EVERY if p.values[0].iterative])
DEFINITE, SYMMETRIC, GENERAL = Kind.POSITIVE_DEFINITE, Kind.SYMMETRIC, Kind.GENERAL


def load(n, seed=3):
    return np.random.default_rng(seed).standard_normal(n)


def true_residual(K, x, b):
    return np.linalg.norm(b - K @ x) / np.linalg.norm(b)


@all_solvers
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("amount", [0.0, 0.2])
def test_the_residual_is_below_rtol_and_is_what_the_solution_says(solver, name, amount):
    K, unknowns = problem(name, amount)
    b = load(unknowns.n)
    factors = solver.analyse(unknowns).factorise(given(solver, K, unknowns), SYMMETRIC)
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
    analysis.factorise(given(solver, K, unknowns), SYMMETRIC).solve(b)
    x = analysis.factorise(given(solver, other, unknowns), DEFINITE).solve(b, 1e-9).x
    assert true_residual(other, x, b) <= 1e-9 < 1e-3 < true_residual(K, x, b)


@all_solvers
def test_stale_factors_refuse_to_solve(solver):
    K, unknowns = problem()
    analysis = solver.analyse(unknowns)
    old = analysis.factorise(given(solver, K, unknowns), SYMMETRIC)
    new = analysis.factorise(given(solver, K, unknowns), SYMMETRIC)
    with pytest.raises(StvkError, match="stale"):
        old.solve(load(unknowns.n))
    assert new.solve(load(unknowns.n)).outcome is Outcome.SOLVED


@pytest.mark.parametrize("solver", [p for p in EVERY if not p.values[0].matrix_free])
def test_a_matrix_that_is_filled_anew_in_place_does_not_change_the_factors(solver):
    K, unknowns = problem()
    same, b = K.copy(), load(unknowns.n)
    factors = solver.analyse(unknowns).factorise(K, SYMMETRIC)
    K.data[:] = problem(amount=0.3)[0].data
    solution = factors.solve(b, 1e-9)
    assert solution.outcome is Outcome.SOLVED and true_residual(same, solution.x, b) <= 1e-9


@all_solvers
def test_no_load_gives_no_displacement(solver):
    K, unknowns = problem()
    solution = solver.analyse(unknowns).factorise(given(solver, K, unknowns), SYMMETRIC).solve(np.zeros(unknowns.n))
    assert (solution.x == 0).all() and solution.residual == 0 and solution.outcome is Outcome.SOLVED


@all_solvers
@pytest.mark.parametrize("size", [1e-60, 1e60])
def test_solutions_are_proportional_to_the_load_however_small_or_large(solver, size):
    K, unknowns = problem()
    b = load(unknowns.n)
    factors = solver.analyse(unknowns).factorise(given(solver, K, unknowns), SYMMETRIC)
    one, other = factors.solve(b, 1e-10).x, factors.solve(size * b, 1e-10).x
    assert np.abs(other / size - one).max() < 1e-6 * np.abs(one).max()


@all_solvers
@pytest.mark.parametrize("size", [1e-25, 1e25])
def test_units_of_stiffness_do_not_matter(solver, size):
    K, unknowns = problem()
    b = load(unknowns.n)
    solution = solver.analyse(unknowns).factorise(given(solver, size * K, unknowns), SYMMETRIC).solve(b, 1e-9)
    assert true_residual(size * K, solution.x, b) <= 1e-9


@all_solvers
@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e160, 1e308])
def test_a_load_that_is_not_finite_is_an_outcome_and_the_answer_is_finite(solver, bad):
    """A load whose norm overflows counts as not finite, too, and no warning of NumPy's comes beside the outcome."""
    K, unknowns = problem()
    b = load(unknowns.n)
    b[5] = bad
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        solution = solver.analyse(unknowns).factorise(given(solver, K, unknowns), SYMMETRIC).solve(b)
    assert solution.outcome is Outcome.NOT_FINITE and np.isfinite(solution.x).all()


@all_solvers
def test_a_matrix_that_is_not_finite_is_refused_with_places(solver):
    K, unknowns = problem()
    K.data[K.indptr[7] + np.flatnonzero(K.indices[K.indptr[7] : K.indptr[8]] == 7)] = np.nan
    with pytest.raises(StateError, match="not finite"):
        solver.analyse(unknowns).factorise(given(solver, K, unknowns), SYMMETRIC)


@all_solvers
def test_wrong_lengths_are_refused(solver):
    K, unknowns = problem()
    factors = solver.analyse(unknowns).factorise(given(solver, K, unknowns), SYMMETRIC)
    with pytest.raises(StvkError, match=rf"b has shape \(3,\); expected \({unknowns.n},\)"):
        factors.solve(np.ones(3))


@pytest.mark.parametrize("solver", [p for p in EVERY if not p.values[0].matrix_free])
def test_another_structure_than_analysed_is_refused(solver):
    K, unknowns = problem()
    analysis, dropped = solver.analyse(unknowns), K.copy()
    dropped.data[abs(dropped.data) < 0.1 * dropped.data.max()] = 0
    dropped.eliminate_zeros()
    for other, words in ((dropped, "another structure"), (K.tocoo(), "csr_matrix"), (K[:5, :5], "shape")):
        with pytest.raises(StvkError, match=words):
            analysis.factorise(other, SYMMETRIC)


@iterative
def test_iterative_solvers_refuse_general_matrices_and_name_those_that_take_them(solver):
    K, unknowns = problem()
    with pytest.raises(StvkError, match=r"general.*'superlu', 'pardiso'"):
        solver.analyse(unknowns).factorise(given(solver, K, unknowns), GENERAL)


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
def test_negative_curvature_is_an_outcome_with_what_was_found_before(solver):
    K, unknowns = problem()
    b, matrix = load(unknowns.n), indefinite(K, unknowns)
    solution = solver.analyse(unknowns).factorise(given(solver, matrix, unknowns), SYMMETRIC).solve(b, 1e-12)
    assert solution.outcome is Outcome.NEGATIVE_CURVATURE
    assert solution.iterations == 0 or b @ solution.x > 0
    assert abs(true_residual(matrix, solution.x, b) - solution.residual) < 1e-9


@iterative
def test_a_matrix_that_is_negative_everywhere_is_noticed_at_once(solver):
    K, unknowns = problem()
    matrix = -K
    solution = solver.analyse(unknowns).factorise(given(solver, matrix, unknowns), SYMMETRIC).solve(load(unknowns.n))
    assert solution.outcome is Outcome.NEGATIVE_CURVATURE and solution.iterations == 0


def singular(K):
    """Without its supports: the first unknown decoupled, with nothing on its diagonal."""
    matrix = K.copy()
    row = np.repeat(np.arange(K.shape[0]), np.diff(K.indptr))
    matrix.data[(row == 0) | (K.indices == 0)] = 0
    return matrix


@all_solvers
def test_a_singular_matrix_never_passes_as_solved(solver):
    K, unknowns = problem()
    solution = solver.analyse(unknowns).factorise(given(solver, singular(K), unknowns), SYMMETRIC).solve(load(unknowns.n))
    assert solution.outcome in (Outcome.SINGULAR, Outcome.INACCURATE, Outcome.NEGATIVE_CURVATURE, Outcome.NOT_FINITE)
    assert np.isfinite(solution.x).all() and solution.residual > 1e-10


@pytest.mark.parametrize("words", ["Factor is exactly singular", "failed to factorize matrix at line 406 in file dpanel_bmod.c"])
def test_superlu_has_two_ways_to_say_singular(words, monkeypatch):
    """The second one came from a flat membrane, whose matrix is exactly singular."""

    def refused(*_, **__):
        raise RuntimeError(words)

    monkeypatch.setattr("skfem_stvk.linear.superlu.splu", refused)
    K, unknowns = problem()
    solver = SuperLU()
    solution = solver.analyse(unknowns).factorise(given(solver, K, unknowns), SYMMETRIC).solve(load(unknowns.n))
    assert solution.outcome is Outcome.SINGULAR and not solution.x.any()


@all_solvers
def test_what_round_off_does_not_allow_is_not_claimed(solver):
    K, unknowns = problem("soft and stiff")
    b = load(unknowns.n)
    solution = solver.analyse(unknowns).factorise(given(solver, K, unknowns), SYMMETRIC).solve(b, 1e-18)
    assert solution.outcome in (Outcome.INACCURATE, Outcome.OUT_OF_ITERATIONS)
    assert 1e-18 < true_residual(K, solution.x, b) < 1e-9


@all_solvers
def test_solvers_are_frozen_and_results_too(solver):
    with pytest.raises(AttributeError):
        solver.name = "other"
    with pytest.raises(AttributeError):
        Solution(np.zeros(1), 0, 0.0, Outcome.SOLVED).x = 1


def test_the_structure_is_needed_by_all_that_form_a_matrix():
    K, unknowns = problem()
    bare = Unknowns(unknowns.vertex, unknowns.component, near_null_space=unknowns.near_null_space)
    for solver in SOLVERS:
        if solver.matrix_free or (solver.name == "pardiso" and not pardiso_is_installed()):
            continue
        with pytest.raises(StvkError, match="indptr and indices"):
            solver.analyse(bare).factorise(K, SYMMETRIC)


@all_solvers
def test_from_anywhere_the_answer_is_the_same(solver):
    K, unknowns = problem()
    b, x0 = load(unknowns.n), 3 * load(unknowns.n, seed=4)
    factors = solver.analyse(unknowns).factorise(given(solver, K, unknowns), SYMMETRIC)
    kept, cold, warm = x0.copy(), factors.solve(b, 1e-10), factors.solve(b, 1e-10, x0)
    assert warm.outcome is Outcome.SOLVED and true_residual(K, warm.x, b) <= 1e-10 * (1 + 1e-6)
    assert np.abs(warm.x - cold.x).max() < 1e-7 * np.abs(cold.x).max() and np.array_equal(x0, kept)


@iterative
def test_iterative_solvers_start_from_x0_and_say_how_far_off_it_is(solver):
    K, unknowns = problem()
    b = load(unknowns.n)
    factors = solver.analyse(unknowns).factorise(given(solver, K, unknowns), SYMMETRIC)
    cold = factors.solve(b, 1e-9)
    x0 = cold.x + 1e-5 * np.abs(cold.x).max() * load(unknowns.n, seed=4)
    warm, there = factors.solve(b, 1e-9, x0), factors.solve(b, 1e-8, cold.x)
    assert abs(cold.start - 1) < 1e-15 and abs(warm.start - true_residual(K, x0, b)) < 1e-12 + 1e-6 * warm.start
    part = 0.9 if solver.name == "ssor-cg" else 0.8  # it has few to save
    assert 0 < warm.iterations < part * cold.iterations
    assert there.iterations == 0 and np.array_equal(there.x, cold.x) and there.residual == there.start <= 1e-8


@all_solvers
def test_x_is_written_to_out_which_may_be_where_the_solve_started_or_the_load(solver):
    K, unknowns = problem()
    b = load(unknowns.n)
    factors = solver.analyse(unknowns).factorise(given(solver, K, unknowns), SYMMETRIC)
    wanted = factors.solve(b, 1e-9).x
    for x0, out in ((None, np.full(unknowns.n, np.nan)), (x := b.copy(), x), (None, b)):
        found = factors.solve(b, 1e-9, x0, out)
        assert found.x is out and np.abs(out - wanted).max() < 1e-5 * np.abs(wanted).max()


@all_solvers
def test_out_is_written_to_where_there_is_no_solution_too(solver):
    K, unknowns = problem()
    factors = solver.analyse(unknowns).factorise(given(solver, K, unknowns), SYMMETRIC)
    for b in (np.zeros(unknowns.n), np.full(unknowns.n, np.nan)):
        out = np.full(unknowns.n, 7.0)
        assert factors.solve(b, 1e-9, out, out).x is out and not out.any()


@iterative
def test_a_start_that_is_not_finite_is_an_outcome_and_of_another_length_refused(solver):
    K, unknowns = problem()
    b = load(unknowns.n)
    factors = solver.analyse(unknowns).factorise(given(solver, K, unknowns), SYMMETRIC)
    found = factors.solve(b, 1e-9, np.full(unknowns.n, np.inf))
    assert found.outcome is Outcome.NOT_FINITE and not found.x.any()
    assert factors.solve(b, 1e-9).outcome is Outcome.SOLVED
    with pytest.raises(StvkError, match=rf"x0 has shape \(3,\); expected \({unknowns.n},\)"):
        factors.solve(b, 1e-9, np.zeros(3))


@all_solvers
def test_out_is_written_to_of_singular_matrices_too(solver):
    K, unknowns = problem()
    out = np.full(unknowns.n, np.nan)
    solution = solver.analyse(unknowns).factorise(given(solver, singular(K), unknowns), SYMMETRIC).solve(load(unknowns.n), out=out)
    assert solution.outcome is not Outcome.SOLVED and solution.x is out and np.isfinite(out).all()
