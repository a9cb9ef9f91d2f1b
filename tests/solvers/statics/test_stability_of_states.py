"""Stability of states: under follower loads, where CG reaches its round-off, and where signs of pivots are unreliable."""

from dataclasses import replace

import numpy as np
import pytest
import skfem
from beams import CRITICAL, column, tangent
from scipy.sparse import block_diag, csc_matrix, csr_matrix
from scipy.sparse.linalg import eigsh

from skfem_stvk import ElementMesh, Pressure, Stop, StVK, System, Traction, solve_static
from skfem_stvk.linear import AmgCg, Outcome, Pardiso, SuperLU, Unknowns
from skfem_stvk.linear.choose import Inertia, inertia, shifted
from skfem_stvk.linear.pardiso import PardisoFactors
from skfem_stvk.solvers.newton import stability
from skfem_stvk.solvers.newton.stability import lowest_mode, real_eigenvalues, stability_of
from skfem_stvk.solvers.newton.stopwatch import Stopwatch
from skfem_stvk.solvers.statics import Status
from skfem_stvk.solvers.statics.equilibrium import Equilibrium

OPTIONS = {"quiet": True, "raise_on_failure": False}


def pressed_column(load, supported_head):
    """Return a column, with or without a lateral support at its head.

    A Pressure rotates with the head; a Traction does not.
    """
    mesh = skfem.MeshQuad.init_tensor(np.linspace(0, 20, 41), np.linspace(-0.5, 0.5, 3)).to_meshtri(style="x")
    fixed = {lambda x: x[0] < 0.01: "xy"} | ({head: "y"} if supported_head else {})
    return System(mesh, [StVK(young=1e4, poisson=0.3), load], fixed=fixed)


def head(x):
    return x[0] > 19.9


def arch():
    """Return a deep arch of 215 degrees with clamped ends under external pressure; its bifurcation is near 370."""
    mesh = skfem.MeshTri.init_tensor(np.linspace(0, 1, 81), np.linspace(-0.5, 0.5, 3))
    angle, radius = (mesh.p[0] - 0.5) * 2 * np.radians(107.5), 1 + 0.02 * mesh.p[1]
    outside = mesh.facets[:, mesh.facets_satisfying(lambda x: np.isclose(x[1], 0.5))]
    ends = mesh.facets[:, mesh.facets_satisfying(lambda x: np.isclose(x[0] * (1 - x[0]), 0))]
    bent = ElementMesh(radius * [np.sin(angle), np.cos(angle)], mesh.t, boundaries={"outside": outside, "ends": ends})
    return System(bent, [StVK(young=1e7, poisson=0.0), Pressure("outside", 480.0)], fixed={"ends": "xy"})


def shallow_arch(load):
    """Return a shallow arch with pressure on the middle of its upper side.

    The rim of the loaded surface is free, so that K is not symmetric.
    """
    mesh = skfem.MeshQuad.init_tensor(np.linspace(-1, 1, 41), np.linspace(-0.01, 0.01, 3)).to_meshtri()
    top = mesh.facets[:, mesh.facets_satisfying(lambda x: (x[1] == 0.01) & (np.abs(x[0]) < 0.5))]
    p = mesh.p + [[0], [0.12]] * (1 - mesh.p[:1] ** 2)
    terms = [StVK(young=1e4, poisson=0.3), Pressure("top", load)]
    return System(ElementMesh(p, mesh.t, boundaries={"top": top}), terms, fixed={lambda x: np.abs(x[0]) == 1: "xy"})


def slender(n=200):
    """Return a cantilever of L/h = 1000 in tetrahedra, on which CG with multigrid does not converge."""
    lines = np.linspace(0, 100, n + 1), np.linspace(0, 0.1, 2), np.linspace(0, 0.1, 2)
    terms = [StVK(young=1.2e6, poisson=0.3), Traction(lambda x: x[0] == 100, (0, 0, -0.3))]
    return System(skfem.MeshTet.init_tensor(*lines), terms, fixed={lambda x: x[0] == 0: "xyz"})


@pytest.fixture(scope="module")
def bent():
    return solve_static(slender(), steps=4, solver="superlu", quiet=True)


@pytest.mark.parametrize("solver", ["superlu", "pardiso"])
@pytest.mark.parametrize("stability_checked", [False, True])
def test_a_column_under_pressure_on_its_supported_head_is_unstable_as_under_a_dead_load(solver, stability_checked):
    options = OPTIONS | {"steps": 4, "solver": solver, "stability": stability_checked}
    dead = solve_static(pressed_column(Traction(head, (-117.0, 0)), True), **options)
    follows = solve_static(pressed_column(Pressure(head, 117.0), True), **options)
    K = tangent(follows.system, follows.u, follows.t)
    assert np.abs(K - K.T).max() < 1e-15 * np.abs(K).max() and (np.linalg.eigvalsh(K) < 0).sum() == 1
    assert dead.status is follows.status is Status.UNSTABLE
    assert [step.negative for step in follows.history] == [step.negative for step in dead.history] == [0, 1, 1]
    assert follows.critical_points[0].t == pytest.approx(dead.critical_points[0].t, rel=1e-6)


def test_a_pressed_arch_beyond_its_bifurcation_is_unstable():
    result = solve_static(arch(), steps=10, solver="superlu", **OPTIONS)
    assert result.status is Status.UNSTABLE and result.history[-1].negative == 1
    assert [step.negative for step in result.history if step.t * 480 < 360] == [0, 0, 0]


@pytest.mark.parametrize("times", [1.1, 6.0])
def test_a_column_with_a_follower_load_does_not_diverge_and_flutter_is_not_checked(times):
    """Beck's column is reported not to diverge, without a statement on flutter.

    The column has no other equilibrium, but flutters beyond 8 times the load of Euler. K is not symmetric. The symmetric part of K
    is indefinite at much lower loads.
    """
    result = solve_static(
        pressed_column(Pressure(head, times * CRITICAL), False), steps=3, stability=True, solver="superlu", **OPTIONS
    )
    K = tangent(result.system, result.u, result.t)
    assert (np.linalg.eigvalsh((K + K.T) / 2)[0] > 0) == (times < 4)
    values = np.linalg.eigvals(K)
    assert values.real[values.imag == 0].min() > 0
    assert result.success and "does not diverge; flutter not checked" in result.message
    assert [step.negative for step in result.history] == [0] * len(result.history)


def test_a_column_with_a_follower_load_and_an_indefinite_symmetric_part():
    """A column with a follower load is judged correctly although its symmetric part is indefinite.

    With many unknowns, not all eigenvalues are computed.
    """
    result = solve_static(pressed_column(Pressure(head, 50.0), False), steps=3, solver="superlu", **OPTIONS)
    K = tangent(result.system, result.u, result.t)
    assert len(K) > stability.DENSE and np.linalg.eigvalsh((K + K.T) / 2)[0] < 0
    assert result.success and "does not diverge" in result.message


def test_a_state_that_diverges_with_an_unsymmetric_tangent_is_unstable():
    system = shallow_arch(2.0)
    result = solve_static(system, steps=20, method="arc-length", stop=Stop(turns=1), **OPTIONS)
    K = tangent(result.system, result.u, result.t)
    values = np.linalg.eigvals(K)
    assert np.abs(K - K.T).max() > 1e-7 * np.abs(K).max() and (values.real[values.imag == 0] < 0).sum() == 1
    assert result.status is Status.UNSTABLE and "1 negative eigenvalue" in result.message
    again = solve_static(system, steps=20, method="arc-length", stop=Stop(turns=1), stability=True, **OPTIONS)
    assert [step.negative for step in again.history] == [0] * (len(again.history) - 1) + [1]
    assert again.history[-1].status is Status.UNSTABLE


def skewed(below, n=60, seed=3):
    """Return an unsymmetric matrix with `below` negative real eigenvalues.

    The matrix has complex eigenvalues, too, and its symmetric part is indefinite.
    """
    rng = np.random.default_rng(seed)
    D = np.diag(np.concatenate([-np.arange(1.0, below + 1), np.arange(2.0, n - below + 2)]))
    D[-2:, -2:] = [[1.0, 5.0], [-5.0, 1.0]]
    Q = np.eye(n) + 0.5 * rng.standard_normal((n, n)) / np.sqrt(n)
    K = csr_matrix(Q @ D @ np.linalg.inv(Q))
    K.sort_indices()
    return K, Unknowns(np.arange(n), np.zeros(n, dtype=int), K.indptr, K.indices)


@pytest.mark.parametrize("dense", [0, 1000], ids=["the nearest", "all"])
@pytest.mark.parametrize("below", [0, 1, 2, 3])
def test_negative_real_eigenvalues_are_counted(monkeypatch, dense, below):
    monkeypatch.setattr(stability, "DENSE", dense)
    K, unknowns = skewed(below)
    assert np.linalg.eigvalsh((K + K.T).toarray() / 2)[0] < 0
    found = real_eigenvalues(K, unknowns)
    assert found.negative == below and found.unsigned == 0
    assert found.complete or below


def test_the_determinant_shows_a_negative_eigenvalue_far_from_zero(monkeypatch):
    K, unknowns = skewed(1)
    values, vectors = np.linalg.eig(K.toarray())
    first = int(np.argmin(np.where(values.imag == 0, values.real, np.inf)))
    values[first] = -1e3
    K.data[:] = (vectors @ np.diag(values) @ np.linalg.inv(vectors)).real.ravel()
    for name, value in (("DENSE", 0), ("FIRST", 3), ("MOST", 3)):
        monkeypatch.setattr(stability, name, value)
    assert real_eigenvalues(K, unknowns).negative == 1
    monkeypatch.setattr(stability, "COUNTED", 0)
    found = real_eigenvalues(K, unknowns)
    assert not found.negative and not found.complete, "without the determinant it is not known"


def diagonal(*values):
    """Return a matrix with the given eigenvalues, which its diagonal does not show."""
    Q = np.linalg.qr(np.random.default_rng(1).standard_normal((len(values),) * 2))[0]
    K = csr_matrix(Q @ np.diag(values) @ Q.T)
    return (K + K.T) / 2, Unknowns(np.arange(len(values)), np.zeros(len(values), dtype=int), K.indptr, K.indices)


@pytest.mark.parametrize(
    ("values", "counts"),
    [((3, 2, 1), (0, 0)), ((3, -2, -1), (2, 0)), ((3, 2, 0), (0, 1)), ((3, -2, 1e-17), (1, 1)), ((3, 2, -1e-12), (1, 0))],
)
def test_signs_within_rounding_do_not_count(values, counts):
    assert inertia(*diagonal(*map(float, values))) == Inertia(*counts)


def test_a_soft_part_next_to_a_stiff_one_has_a_sign():
    stiff, soft = diagonal(3.0, 2.0, 1.0)[0] * 1e9, diagonal(3.0, 2.0, -1.0)[0] * 1e-9
    K = block_diag([stiff, soft], format="csr")
    assert inertia(K, Unknowns(np.arange(6), np.zeros(6, dtype=int), K.indptr, K.indices)) == Inertia(1, 0)


def test_negative_curvature_at_the_round_off_of_cg_is_not_a_verdict(bent):
    problem = Equilibrium(bent.system, AmgCg(), Stopwatch())
    force = np.random.default_rng(0).standard_normal(len(problem.tangent.free.free))
    assert problem.solve(problem.factorise(bent.u, 1.0), force, 1e-4).outcome is Outcome.NEGATIVE_CURVATURE
    assert stability_of(problem, bent.u, 1.0) == (True, 0, "")


def test_an_unknown_stability_is_reported(bent, monkeypatch):
    """An unknown stability is reported: the body is too large to be factorised, and LOBPCG finds no eigenvalue."""
    monkeypatch.setattr(stability, "COUNTED", 0)
    monkeypatch.setattr(stability, "MOST_LOBPCG", 1)
    verdict = stability_of(Equilibrium(bent.system, AmgCg(), Stopwatch()), bent.u, 1.0)
    assert verdict.stable and verdict.negative is None and "not known" in verdict.doubt


def test_the_lowest_eigenvalue_of_a_slender_body_is_that_of_its_matrix(bent):
    lowest = eigsh(csc_matrix(tangent(bent.system, bent.u, bent.t)), 1, sigma=0.0)[0][0]
    assert lowest_mode(Equilibrium(bent.system, AmgCg(), Stopwatch()), bent.u, 1.0).value == pytest.approx(lowest, rel=1e-3)


def test_a_direct_solver_takes_over_where_cg_reaches_its_round_off(bent):
    result = solve_static(bent.system, steps=4, solver="amg-cg", **OPTIONS)
    assert result.success and result.solver in ("superlu", "pardiso") and "took over" in result.message
    np.testing.assert_allclose(result.u, bent.u, atol=1e-5 * np.abs(bent.u).max())


def test_cg_is_not_replaced_where_k_is_indefinite():
    result = solve_static(column(1.5 * CRITICAL, 0.01), steps=4, solver="amg-cg", **OPTIONS)
    assert result.success and result.solver == "amg-cg"


@pytest.mark.few
@pytest.mark.parametrize("outcome", ["OUT_OF_ITERATIONS", "INACCURATE", "NEGATIVE_CURVATURE"])
@pytest.mark.parametrize(("times", "stable"), [(0.5, True), (1.5, False)])
@pytest.mark.parametrize("counted", [0, 20_000], ids=["by the lowest eigenvalue", "by factorisation"])
def test_failures_of_cg_are_confirmed_by_another_method(monkeypatch, outcome, times, stable, counted):
    """A failure of CG is confirmed by another method: the straight column is stable below the load of Euler, and unstable above."""
    system = column(times * CRITICAL)
    straight = solve_static(system, steps=2, method="arc-length", solver="superlu", **OPTIONS)
    solve = Equilibrium.solve
    monkeypatch.setattr(stability, "COUNTED", counted)
    problem = Equilibrium(system, AmgCg(), Stopwatch())

    def failing(self, factors, b, rtol, *rest):
        found = solve(self, factors, b, rtol, *rest)
        return replace(found, outcome=Outcome[outcome]) if rtol == 1e-4 else found

    monkeypatch.setattr(Equilibrium, "solve", failing)
    assert stability_of(problem, straight.u, straight.t)[0] is stable


@pytest.mark.parametrize("times", [0.5, 1.5])
def test_perturbed_pivots_do_not_prove_stability(monkeypatch, times):
    pytest.importorskip("pypardiso")
    monkeypatch.setattr(PardisoFactors, "negative_pivots", property(lambda self: None))
    system = column(times * CRITICAL)
    straight = solve_static(system, steps=2, method="arc-length", solver=Pardiso(), **OPTIONS)
    assert straight.status is (Status.CONVERGED if times < 1 else Status.UNSTABLE)
    checked = solve_static(system, steps=2, solver=Pardiso(), stability=True, **OPTIONS)
    assert checked.history[0].negative is not None and checked.history[-1].status is straight.status


def test_a_state_whose_lowest_eigenvalue_is_round_off_has_no_verdict(monkeypatch):
    """A state whose lowest eigenvalue is round-off has no verdict: at a bifurcation, a pivot may be negative or not."""
    system = column(0.5 * CRITICAL)
    problem, matrix = Equilibrium(system, SuperLU(), Stopwatch()), Equilibrium.matrix
    u = np.zeros(system.ndofs)

    def shifted_by(part):
        def changed(self, *state):
            K, unknowns = matrix(self, *state)
            return shifted(K, (1 - part) * np.linalg.eigvalsh(K.toarray())[0]), unknowns

        return changed

    monkeypatch.setattr(Equilibrium, "negative_pivots", lambda self: 1)
    for part, stable, negative, says in ((0.0, True, 0, "not known"), (1e-3, True, 0, ""), (-1e-3, False, 1, "")):
        monkeypatch.setattr(Equilibrium, "matrix", shifted_by(part))
        verdict = stability_of(problem, u, 0.0)
        assert verdict[:2] == (stable, negative) and (says in verdict.doubt if says else not verdict.doubt)
