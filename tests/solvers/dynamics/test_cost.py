"""Cost of a time loop besides arithmetic: memory, and reviews of the critical step."""

import re
import sys
import tracemalloc
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from motions import begun
from skfem import MeshTet

from skfem_stvk import Gravity, StVK, StvkWarning, System
from skfem_stvk.solvers.dynamics import ForwardEuler, LinearBackwardEuler, Status, VelocityVerlet, simulate
from skfem_stvk.solvers.dynamics.critical_step import LargestFrequency, critical_step
from skfem_stvk.solvers.dynamics.loop import Loop
from skfem_stvk.solvers.dynamics.motion_outputs import Outputs
from skfem_stvk.solvers.dynamics.record import FEWEST, MOST, Reviews
from skfem_stvk.solvers.dynamics.steps import StableStep


def hanging(n, young=3e4):
    across, along = np.linspace(0, 0.15, n + 1), np.linspace(-0.3, 0, 2 * n + 1)
    terms = [StVK(young=young, poisson=0.4, density=1000.0), Gravity((0, 0, -9.81))]
    return System(MeshTet.init_tensor(across, across, along), terms, fixed={lambda x: x[2] == 0: "xyz"})


def pushed(system):
    v = np.zeros(system.mesh.p.T.shape)
    v[:, 0] = -2 * system.mesh.p[2] / 0.3
    return v.ravel()


def forget_names():
    """Clear Python's cache of attribute names, which holds the last 4096 names used by C code, some 60 B each."""
    getattr(sys, "_clear_internal_caches", sys._clear_type_cache)()


def memory_of_steps(n, integrator):
    """Return bytes for a body of n cells across: the largest temporary allocation of a step, the growth in three steps, and `u`."""
    system = hanging(n)
    setup, record = begun(system, integrator, pushed(system))
    loop, peaks = Loop(setup, record, Outputs(setup, record), True), []

    def step():
        loop._steps.advance(record.clock.next(1.0)[0], whole=True)

    for _ in range(3):
        step()
    tracemalloc.start()
    try:
        for _ in range(3):
            step()
        forget_names()
        first, _ = tracemalloc.get_traced_memory()
        for _ in range(3):
            forget_names()
            before, _ = tracemalloc.get_traced_memory()
            tracemalloc.reset_peak()
            step()
            peaks.append(tracemalloc.get_traced_memory()[1] - before)
        forget_names()
        left = tracemalloc.get_traced_memory()[0] - first
    finally:
        tracemalloc.stop()
    return max(peaks), left, record.state.u.nbytes


@pytest.mark.parametrize(
    "integrator", [ForwardEuler(dt=1e-5), VelocityVerlet(dt=1e-5), LinearBackwardEuler(dt=1e-3)], ids=lambda one: one.name
)
def test_the_time_loop_allocates_no_vector(integrator):
    """Work arrays of kernels, 12 kB per block of elements, and all other allocations do not depend on the size of the body."""
    (few, _, _), (peak, left, u) = (memory_of_steps(n, integrator) for n in (4, 7))
    assert peak < u and left < 1000 and abs(peak - few) < 300


def test_a_linear_step_starts_from_the_extrapolated_velocity():
    """The initial guess saves iterations, and the motion is the same."""
    system = hanging(4)
    run = simulate(system, LinearBackwardEuler(dt=1e-2, rtol=1e-3), until=0.3, v0=pushed(system), quiet=True)
    setup, record = begun(system, run.integrator, pushed(system))
    stepper, state = run.integrator.stepper(setup.motion), record.state
    stepper.start(state)
    for k in range(run.ledger.steps - 1):
        stepper.step(state, (k + 1) * 1e-2)
        state.a[:] = 0
    assert run.iterations < 0.9 * stepper.counts.iterations
    assert np.abs(state.u - run.u).max() < 1e-2 * np.abs(run.u).max()


def test_reviews_are_more_frequent_while_the_bound_changes():
    step, reviews = Reviews(step=1.25, bound=1.0).estimate(1.0, 10)
    assert step == 1.25 and (reviews.next, reviews.interval) == (30, 20)
    for _ in range(5):
        _, reviews = reviews.estimate(1.0, reviews.next)
    assert reviews.interval == MOST
    step, reviews = reviews.estimate(0.8, 500)
    assert step == pytest.approx(1.0) and reviews.next == 500 + MOST // 4
    for n in range(5):
        _, reviews = reviews.estimate(0.8 * 0.9**n, reviews.next)
    assert reviews.interval == FEWEST


@pytest.mark.parametrize("n", [4, 6, 8])
@pytest.mark.filterwarnings("ignore::skfem_stvk.StvkWarning")  # warnings of inverted elements
def test_automatic_steps_of_a_soft_body_stay_below_the_critical_step(n):
    system = hanging(n)
    run = simulate(system, VelocityVerlet(), until=0.5, v0=pushed(system), quiet=True, raise_on_failure=False)
    assert run.status is Status.FINISHED
    assert np.abs(run.ledger["closure_error"]).max() < 0.03 * run.ledger["kinetic_energy"].max()


@pytest.mark.parametrize("share, times", [(0.99, 0), (1.01, 1)], ids=["below", "above"])
def test_eigenvalues_are_computed_only_for_steps_above_the_safe_bound(share, times, monkeypatch):
    """The eigenvalues may show that the step is stable nevertheless; then there is no warning."""
    system, asked, at = hanging(3), [], LargestFrequency.at
    found = critical_step(system)
    assert share * found.bound < found.step
    monkeypatch.setattr(LargestFrequency, "at", lambda self, u, t: asked.append(u) or at(self, u, t))
    run = simulate(system, VelocityVerlet(dt=share * found.bound), until=5 * found.bound, quiet=True)
    assert run.status is Status.FINISHED and len(asked) == times


def test_a_step_that_becomes_too_large_is_reported_without_earlier_eigenvalues():
    system = hanging(3)
    dt = 0.9 * critical_step(system).bound
    setup, record = begun(system, VelocityVerlet(dt=dt), pushed(system))
    limit = StableStep(setup.motion, setup.integrator)
    record.clock.dt, reviews = limit.first(record.state)
    for stretch, looked in ((1.1, False), (2.0, True)):
        record.state.u[2::3] = (stretch - 1) * system.mesh.p[2]
        record.reviews = replace(reviews, next=record.steps)
        with pytest.warns(StvkWarning, match="above the critical one.*safe bound") if looked else nullcontext():
            _, reviews = limit.review(record)
        assert (limit._last is not None) == looked
    assert limit._last.step < dt < critical_step(system).bound


def test_the_advice_after_a_blow_up_names_step_and_bound():
    system = hanging(3)
    dt = 0.5 * critical_step(system).bound
    setup, record = begun(system, VelocityVerlet(dt=dt), pushed(system))
    assert re.search(
        "critical step .* s, safe bound .* s at the last review", StableStep(setup.motion, setup.integrator).advice(record)
    )
