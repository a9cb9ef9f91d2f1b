"""What a time loop costs besides the arithmetic: memory, and looks at the critical step."""

import re
import tracemalloc
from contextlib import nullcontext

import numpy as np
import pytest
from skfem import MeshTet
from skfem_stvk.dynamics.clock import FEWEST, MOST, Looks
from skfem_stvk.dynamics.plan import Beginning, Plan
from skfem_stvk.dynamics.status import Status

from skfem_stvk import Gravity, StVK, StvkWarning, System
from skfem_stvk.dynamics import ForwardEuler, LinearBackwardEuler, VelocityVerlet, simulate
from skfem_stvk.dynamics.critical_step import LargestFrequency, critical_step
from skfem_stvk.dynamics.loop import Loop
from skfem_stvk.dynamics.stable_step import StableStep


def hanging(n, young=3e4):
    across, along = np.linspace(0, 0.15, n + 1), np.linspace(-0.3, 0, 2 * n + 1)
    terms = [StVK(young=young, poisson=0.4, density=1000.0), Gravity((0, 0, -9.81))]
    return System(MeshTet.init_tensor(across, across, along), terms, fixed={lambda x: x[2] == 0: "xyz"})


def pushed(system):
    v = np.zeros(system.mesh.p.T.shape)
    v[:, 0] = -2 * system.mesh.p[2] / 0.3
    return v.ravel()


def plan_of(system, integrator):
    return Plan.new(system, Beginning(integrator, None, pushed(system), 0.0, None, None, None, None))


@pytest.mark.parametrize(
    "integrator", [ForwardEuler(dt=1e-5), VelocityVerlet(dt=1e-5), LinearBackwardEuler(dt=1e-3)], ids=lambda one: one.name
)
def test_nothing_as_long_as_a_vector_is_allocated_in_the_time_loop(integrator):
    system = hanging(6)
    plan = plan_of(system, integrator)
    loop = Loop(plan, 1.0, True)

    def steps():
        for _ in range(3):
            loop._cutting.advance(plan.state, plan.clock.next(1.0)[0])
            loop._books.enter(plan.state, loop._stepper.energy)
            plan.clock.tick()

    steps()
    tracemalloc.start()
    try:
        steps()
        before, _ = tracemalloc.get_traced_memory()
        tracemalloc.reset_peak()
        steps()
        after, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak - before < plan.state.u.nbytes and after - before < 1000


def test_a_linear_step_starts_from_where_velocity_and_acceleration_lead():
    """Less iterations, and the same motion."""
    system = hanging(4)
    run = simulate(system, LinearBackwardEuler(dt=1e-2, rtol=1e-3), until=0.3, v0=pushed(system), quiet=True)
    plan = plan_of(system, run.integrator)
    stepper, state = plan.integrator.stepper(plan.motion), plan.state
    stepper.start(state)
    for k in range(run.ledger.steps - 1):
        stepper.step(state, (k + 1) * 1e-2)
        state.a[:] = 0
    assert run.iterations < 0.9 * stepper.counts.iterations
    assert np.abs(state.u - run.u).max() < 1e-2 * np.abs(run.u).max()


def test_looks_are_taken_more_often_while_the_bound_moves():
    looks = Looks(step=1.25, bound=1.0)
    assert looks.estimate(1.0, 10) == 1.25 and (looks.next, looks.interval) == (30, 20)
    for _ in range(5):
        looks.estimate(1.0, looks.next)
    assert looks.interval == MOST
    assert looks.estimate(0.8, 500) == pytest.approx(1.0) and looks.next == 500 + MOST // 4
    for n in range(5):
        looks.estimate(0.8 * 0.9**n, looks.next)
    assert looks.interval == FEWEST


@pytest.mark.parametrize("n", [4, 6, 8])
@pytest.mark.filterwarnings("ignore::skfem_stvk.StvkWarning")  # of elements inside out
def test_steps_that_are_found_stay_below_the_critical_one_as_a_soft_body_swings(n):
    system = hanging(n)
    run = simulate(system, VelocityVerlet(), until=0.5, v0=pushed(system), quiet=True, raise_on_failure=False)
    assert run.status is Status.FINISHED
    assert np.abs(run.ledger["closure_error"]).max() < 0.03 * run.ledger["kinetic_energy"].max()


@pytest.mark.parametrize("share, times", [(0.99, 0), (1.01, 1)], ids=["below", "above"])
def test_eigenvalues_are_looked_for_only_where_a_given_step_is_above_the_safe_bound(share, times, monkeypatch):
    """There they may show that it is stable all the same, and no warning comes."""
    system, asked, at = hanging(3), [], LargestFrequency.at
    found = critical_step(system)
    assert share * found.bound < found.step
    monkeypatch.setattr(LargestFrequency, "at", lambda self, u, t: asked.append(u) or at(self, u, t))
    run = simulate(system, VelocityVerlet(dt=share * found.bound), until=5 * found.bound, quiet=True)
    assert run.status is Status.FINISHED and len(asked) == times


def test_a_body_that_is_drawn_out_until_a_given_step_is_too_large_is_noticed_though_no_eigenvalue_was_looked_for_before():
    system = hanging(3)
    dt = 0.9 * critical_step(system).bound
    plan = plan_of(system, VelocityVerlet(dt=dt))
    limit = StableStep(plan)
    for stretch, looked in ((1.1, False), (2.0, True)):
        plan.state.u[2::3] = (stretch - 1) * system.mesh.p[2]
        plan.looks.next = plan.steps
        with pytest.warns(StvkWarning, match="above the critical one.*safe bound") if looked else nullcontext():
            limit.review()
        assert (limit._last is not None) == looked
    assert limit._last.step < dt < critical_step(system).bound


def test_the_advice_after_a_blow_up_has_both_numbers_even_if_none_was_looked_for_before():
    system = hanging(3)
    dt = 0.5 * critical_step(system).bound
    plan = plan_of(system, VelocityVerlet(dt=dt))
    assert re.search("critical step .* s, safe bound .* s when", StableStep(plan).advice())
