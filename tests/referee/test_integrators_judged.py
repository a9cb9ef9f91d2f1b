"""`verify_integrator` passes right integrators with their claims, and each planted fault fails the check meant for it."""

import numpy as np
import pytest

from skfem_stvk import StvkError, verify_integrator
from skfem_stvk.referee.results import CheckOutcome
from skfem_stvk.solvers.dynamics import INTEGRATORS
from skfem_stvk.solvers.dynamics.motion import Motion
from skfem_stvk.solvers.dynamics.record import MotionState

BOTH = ("linear momentum", "angular momentum")


def own(kind, **options):
    """Return a step of one of this package's integrators; each step has a new stepper."""

    def step(system, u, v, dt):
        motion, state = Motion(system, "lumped", None), MotionState.at(0.0, u, v)
        stepper = kind(dt, **options).stepper(motion)
        stepper.start(state)
        stepper.step(state, dt)
        return state.u, state.v

    return step


def verlet(system, u, v, dt, *, damping=0.0, force=1.0, late=False):
    M = system.mass()
    v = v - dt / 2 * force * M.solve(system.internal_force(u))
    moved = u + dt * v
    return moved, (v - dt / 2 * force * M.solve(system.internal_force(u if late else moved))) * (1 - damping)


def symplectic_euler(system, u, v, dt):
    v = v - dt * system.mass().solve(system.internal_force(u))
    return u + dt * v, v


def explicit_euler(system, u, v, dt):
    return u + dt * v, v - dt * system.mass().solve(system.internal_force(u))


class StaleForce:
    """Velocity Verlet that reuses the force of its last step in any state."""

    force = None

    def __call__(self, system, u, v, dt):
        M = system.mass()
        v = v - dt / 2 * M.solve(system.internal_force(u) if self.force is None else self.force)
        u = u + dt * v
        self.force = system.internal_force(u)
        return u, v - dt / 2 * M.solve(self.force)


def cached_force():
    """Return a step of velocity Verlet that reuses its last force while the displacements are nearly the same."""
    last = {}

    def force(system, u):
        if not last or not np.allclose(u, last["u"]):
            last.update(u=u.copy(), F=system.internal_force(u))
        return last["F"]

    def step(system, u, v, dt):
        M = system.mass()
        v = v - dt / 2 * M.solve(force(system, u))
        u = u + dt * v
        return u, v - dt / 2 * M.solve(force(system, u))

    return step


def pushed(system, u, v, dt):
    """Take a step of velocity Verlet with an external force on one end, so that momentum is not conserved."""
    u, v = verlet(system, u, v, dt)
    v[0] += 1e-3 * dt * np.abs(v).max() / dt
    return u, v


def judged(step, **claims):
    return verify_integrator(step, quiet=True, **claims)


def checks(report):
    return {(r.check, r.quantity) if r.check == "drift" else r.check for r in report.results if r.outcome is CheckOutcome.FAILED}


@pytest.mark.few(5)
@pytest.mark.parametrize("name", [name for name in INTEGRATORS if name != "GeneralizedAlpha"])  # stores accelerations
def test_own_integrators_pass_with_what_they_declare(name):
    kind = INTEGRATORS[name]
    options = {} if kind(1.0).explicit else {"rtol": 1e-12}
    limit = 1.99 if kind.explicit else 20.0
    report = judged(own(kind, **options), order=kind(1.0).order, conserves=tuple(kind(1.0, **options).conserves), stable=limit)
    assert report.passed, str(report)


@pytest.mark.parametrize(("step", "order"), [(verlet, 2), (symplectic_euler, 1)])
def test_integrators_written_by_users_pass(step, order):
    report = judged(step, order=order, conserves=BOTH, stable=2.0)
    assert report.passed, str(report)
    assert judged(step).passed and not judged(step, order=order + 1).passed and not judged(step, stable=2.5).passed


def damped(*state):
    return verlet(*state, damping=1e-3)


def too_strong(*state):
    return verlet(*state, force=1.02)


def late(*state):
    return verlet(*state, late=True)


@pytest.mark.few(12)
@pytest.mark.parametrize(
    ("step", "claims", "caught"),
    [
        (explicit_euler, {}, {"stability limit"}),
        (symplectic_euler, {"order": 2}, {"order"}),
        (late, {"order": 2}, {"order"}),
        (damped, {"order": 2}, {"order", ("drift", "energy")}),
        (too_strong, {"order": 2}, {"order"}),
        (StaleForce(), {}, {"memory"}),
        (cached_force(), {}, {"memory"}),
        (pushed, {}, {("drift", "linear momentum")}),
        (lambda system, u, v, dt: (np.nan * u, v), {}, {"memory", "order"}),
    ],
)
def test_planted_faults_are_caught(step, claims, caught):
    report = judged(step, **claims)
    assert not report.passed and caught <= checks(report), checks(report)


def half_velocity(system, u, v, dt):
    v = v - dt / 2 * system.mass().solve(system.internal_force(u))
    return u + dt * v, v


def without_second_order(system, u, v, dt):
    M, moved = system.mass(), u + dt * v
    return moved, v - dt / 2 * M.solve(system.internal_force(u) + system.internal_force(moved))


def by_consistent_mass(system, u, v, dt):
    """Take a step of velocity Verlet with a threefold force.

    The consistent mass of a bar is a third of the lumped one if its ends move against each other.
    """
    return verlet(system, u, v, dt, force=3.0)


def newmark(beta):
    """Return a step of Newmark's method with gamma = 1/2; Newton's method solves its equation."""

    def step(system, u, v, dt):
        M = system.mass()
        a = -M.solve(system.internal_force(u))
        new = a
        for _ in range(50):
            w = u + dt * v + dt**2 * ((0.5 - beta) * a + beta * new)
            left = M.multiply(new) + system.internal_force(w)
            change = np.linalg.solve(M.matrix.toarray() + beta * dt**2 * system.tangent(w).toarray(), left)
            new = new - change
            if np.abs(change).max() <= 1e-14 * np.abs(new).max():
                break
        w = u + dt * v + dt**2 * ((0.5 - beta) * a + beta * new)
        return w, v + dt / 2 * (a + new)

    return step


@pytest.mark.slow
def test_a_wrong_beta_of_newmark_is_caught_by_its_limit_and_named():
    claims = {"order": 2, "stable": 20.0}
    assert judged(newmark(1 / 4), **claims).passed
    report = judged(newmark(1 / 6), **claims)
    assert checks(report) == {"stability limit"} and report.named.names == ["beta = 0.167"], str(report)
    assert "stable up to omega dt = 3.46" in report.named.explanations[0].words
    assert judged(newmark(1 / 6), order=2, stable=3.4).passed


@pytest.mark.few
@pytest.mark.parametrize(
    ("step", "claims", "names"),
    [
        (late, {"order": 2}, ["old force"]),
        (half_velocity, {"order": 2}, ["velocity of the middle"]),
        (without_second_order, {"order": 2}, ["no dt^2/2 a"]),
        (explicit_euler, {}, ["old velocity"]),
        (too_strong, {"order": 2}, ["force x 1.020"]),
        (by_consistent_mass, {}, ["force x 3.000"]),
        (lambda *state: verlet(*state, force=-1.0), {}, ["force x -1.000"]),
        (lambda system, u, v, dt: verlet(system, u, v, dt / 4), {}, ["dt x 0.250"]),
        (damped, {"order": 2}, []),
        (pushed, {}, []),
        (StaleForce(), {}, []),
    ],
    ids=["late", "half", "second order", "explicit Euler", "force", "mass", "sign", "dt", "damped", "pushed", "stale"],
)
def test_planted_faults_are_named(step, claims, names):
    report = judged(step, **claims)
    assert report.named.names == names and (names or report.named.smallest), str(report)


def test_an_invalid_step_could_not_run():
    report = judged(lambda system, u, v, dt: u)
    assert report.named is None and not report.passed and all(r.outcome is CheckOutcome.COULD_NOT_RUN for r in report.results)


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"step": 3}, "step is a int"),
        ({"density": 0.0}, "density"),
        ({"order": 0}, "order"),
        ({"stable": -1.0}, "stable"),
        ({"conserves": ("mass",)}, "conserves"),
    ],
)
def test_arguments_are_refused_by_name(how, words):
    with pytest.raises(StvkError, match=words):
        verify_integrator(**{"step": verlet, "quiet": True} | how)
