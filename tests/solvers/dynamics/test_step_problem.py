"""The equation of a step, as Newton's method uses it."""

import numpy as np
import pytest
from motions import MESHES, clamped, material, pushed, velocities
from solvers.dynamics.test_critical_step import BLOCK, SOLID, UNDAMPED

from skfem_stvk import Gravity, NodalLoad, Pressure, StateError, System, simulate
from skfem_stvk.edges import ALL
from skfem_stvk.solvers.dynamics import (
    BackwardEuler,
    EdgeDamping,
    EnergyMomentum,
    GeneralizedAlpha,
    LinearBackwardEuler,
    Newmark,
    Rayleigh,
)
from skfem_stvk.solvers.dynamics.integrators.implicit import ImplicitStepper
from skfem_stvk.solvers.dynamics.motion import Motion
from skfem_stvk.solvers.dynamics.record import MotionState
from skfem_stvk.solvers.newton.problem import Tangent
from skfem_stvk.system.free_tangent import FreeTangent
from skfem_stvk.system.rigid import rigid_modes
from skfem_stvk.terms.loads.load import Moment

DT = 0.03
AT_END = Moment(0.5 + DT, 1.0)
EPS = np.finfo(float).eps


def begun(integrator, d=3, mass="lumped", damping=None, size=0.1):
    """Return the problem of a started step of a supported body under time-dependent loads, and displacements over the step."""
    mesh, rng = MESHES[d], np.random.default_rng(d)
    loads = [NodalLoad((1, 5), lambda t: [0.4 * f for f in pushed(t)[:d]]), Gravity((0.3, -1.0, 0.5)[:d])]
    system = System(mesh, [material(mesh), *loads], fixed={"left": "xyz"[:d]})
    stepper = ImplicitStepper(Motion(system, mass, damping), integrator)
    free = stepper.problem.tangent.free.vector
    u, w, p = (size * free(rng.standard_normal(len(stepper.problem.tangent.free.free))) for _ in range(3))
    state = MotionState.at(0.5, u, velocities(mesh))
    stepper.start(state)
    stepper.problem.begin(state, integrator.coefficients(state, DT, stepper))
    return stepper.problem, u, w, p


@pytest.mark.few
@pytest.mark.parametrize("mass", ["lumped", "consistent"])
@pytest.mark.parametrize("damping", [None, Rayleigh(0.8, 0.05)], ids=["undamped", "damped"])
@pytest.mark.parametrize("integrator", [BackwardEuler(DT), Newmark(DT), GeneralizedAlpha(DT, rho=0.4)], ids=lambda one: one.name)
@pytest.mark.parametrize("d", [2, 3])
def test_the_slope_of_the_incremental_potential_is_the_residual(d, integrator, damping, mass):
    problem, _, w, p = begun(integrator, d, mass, damping)
    assert problem.quartic
    cost = np.polynomial.Polynomial(problem.energy_along(w, p, AT_END))
    for s in (-0.7, 0.0, 0.4, 1.0):
        slope = problem.residual(w + s * p, AT_END).vector @ p[problem.tangent.free.free]
        assert cost.deriv()(s) == pytest.approx(slope, rel=1e-9)


def test_equations_without_a_potential_are_not_quartic():
    assert not begun(EnergyMomentum(DT))[0].quartic
    assert not begun(BackwardEuler(DT), damping=EdgeDamping(0.1))[0].quartic


def test_step_limits_and_inversions_refer_to_the_current_state():
    problem, u, w, p = begun(BackwardEuler(DT), size=0.2)
    assert problem.step_limit(w, p) == problem.motion.system.step_limit(u + w, p) != problem.motion.system.step_limit(w, p)
    far = u + 5 * p
    assert list(problem.inside_out(5 * p)) == list(problem.motion.system.inside_out(far)) and len(
        problem.motion.system.inside_out(far)
    )
    np.testing.assert_array_equal(problem.inside_out(0 * u), problem.motion.system.inside_out(u))


@pytest.mark.parametrize("integrator", [BackwardEuler(DT), EnergyMomentum(DT), Newmark(DT)], ids=lambda one: one.name)
def test_the_scales_of_residual_and_round_off_include_all_forces(integrator):
    """The scale includes inertia at both ends of the step, loads and internal forces, and is at most a few times their sum."""
    for strength, heavy in ((1e6, 1.0), (1.0, 1e6)):
        mesh = MESHES[3]
        soft = System(mesh, [material(mesh, young=3.0 / strength), Gravity((0.0, -heavy, 0.0))])
        stepper = ImplicitStepper(Motion(soft, "lumped", None), integrator)
        state, problem = MotionState.at(0.0, np.zeros(soft.ndofs), 5.0 * velocities(mesh)), stepper.problem
        coefficients = integrator.coefficients(state, DT, stepper)
        problem.begin(state, coefficients)
        behind = soft.mass().multiply(coefficients.m)
        for w in (np.zeros(soft.ndofs), 0.3 * velocities(mesh)):
            ahead, loads = coefficients.c * soft.mass().multiply(w), soft.external_force(w, AT_END)
            sizes = [np.linalg.norm(force) for force in (ahead, behind, loads)]
            residual = problem.residual(w, AT_END)
            assert max(sizes) < residual.scale < 3 * sum(sizes)
            assert max(sizes) < 1.01 * problem.round_off(w, AT_END) / EPS < 30 * sum(sizes)


def test_a_residual_that_overflows_raises():
    """The forces are finite, but their norm is not: an infinite residual would be as small as its scale."""
    problem, _, w, _ = begun(BackwardEuler(DT))
    with pytest.raises(StateError, match="overflows"):
        problem.residual(1e102 * w / np.abs(w).max(), AT_END)


@pytest.mark.parametrize("solver", ["superlu", "block-jacobi-cg", "amg-cg"])
def test_the_tangent_at_rest_is_never_replaced(solver):
    problem, _, w, p = begun(BackwardEuler(DT, tangent="rest", solver=solver))
    first, *others = (problem.factorise(at, AT_END, tangent) for at, tangent in zip((w, 3 * w, -w), Tangent, strict=True))
    assert all(other is first for other in others)
    b, free = p[problem.tangent.free.free], problem.tangent.free.free
    x = problem.solve(first, b, 1e-12).x
    K = (
        problem.motion.system.tangent(0 * w) @ problem.tangent.free.vector(x)
        + problem.motion.system.mass().multiply(problem.tangent.free.vector(x)) / DT**2
    )
    np.testing.assert_allclose(K[free], b, atol=1e-9 * np.abs(b).max())


@pytest.mark.parametrize("make", [LinearBackwardEuler, EnergyMomentum])
def test_the_tangent_at_rest_does_not_depend_on_the_time(make, tmp_path):
    """The tangent does not contain time-dependent follower loads, because a resumed run makes it later."""
    mesh = MESHES[2]
    system = System(mesh, [material(mesh), Pressure("right", lambda t: 0.3 + 0.5 * np.sin(6 * t))], fixed={"left": "xy"})
    integrator = make(0.01, tangent="rest", solver="superlu")
    whole = simulate(system, integrator, until=0.4, quiet=True)
    simulate(system, integrator, until=0.2, checkpoint=tmp_path / "run", quiet=True)
    resumed = simulate(system, checkpoint=tmp_path / "run", resume=True, until=0.4, quiet=True)
    np.testing.assert_array_equal(resumed.ledger.rows(), whole.ledger.rows())


@pytest.mark.parametrize("make", [BackwardEuler, Newmark, EnergyMomentum, LinearBackwardEuler])
def test_the_tangent_at_rest_is_factorised_once(make, monkeypatch):
    made, factorise = [], FreeTangent.factorise

    def counted(self, *content):
        made.append(content)
        return factorise(self, *content)

    monkeypatch.setattr(FreeTangent, "factorise", counted)
    run = clamped(2).run(make(1e-3, tangent="rest", solver="superlu"), 10.1, t0=10.0)
    assert len(made) == 1 and run.ledger.steps == 101 and len(np.unique(np.diff(run.ledger["time"]))) > 1


def test_multigrid_gets_the_rigid_modes_of_the_current_state():
    problem, u, w, _ = begun(BackwardEuler(DT, solver="amg-cg"))
    problem.factorise(w, AT_END)
    where = problem.motion.system.mesh.p.T + (u + w).reshape(-1, 3)
    np.testing.assert_array_equal(problem.tangent.rigid_modes(), rigid_modes(where)[problem.tangent.free.free])


@pytest.mark.parametrize("rho", [None, 0.5])
@pytest.mark.parametrize("name", ["contact", "foundation", "volume"])
def test_the_matrix_of_a_step_damps_the_terms_that_its_equation_damps(name, rho):
    integrator = BackwardEuler(1e-3) if rho is None else GeneralizedAlpha(1e-3, rho=rho)
    motion = Motion(System(BLOCK, [SOLID, UNDAMPED[name]]), None, EdgeDamping(0.02))
    rng = np.random.default_rng(0)
    u, w, v = 1e-4 * rng.normal(size=(3, motion.system.ndofs)) - [[1e-3], [0], [0]]
    state, h = MotionState.at(0.0, u, v), 1e-8
    stepper = integrator.stepper(motion)
    problem, t = stepper.problem, motion.moment(1e-3)
    problem.begin(state, integrator.coefficients(state, 1e-3, stepper))
    K = problem.matrix._matrix(w, t, ALL)
    direction = rng.normal(size=len(u))
    ends = [problem.residual(w + s * h * direction, t).vector for s in (1, -1)]
    change = (ends[0] - ends[1]) / (2 * h)
    assert np.linalg.norm(K @ direction - change) < 0.02 * np.linalg.norm(change)  # without the change of the edges' directions
