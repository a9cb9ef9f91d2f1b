"""Shapes whose displacements are inputs of a simulation move as shapes with the same function of time, to the last bit."""

import numpy as np
import pytest

from skfem_stvk import (
    BackwardEuler,
    EnergyMomentum,
    Friction,
    LinearBackwardEuler,
    NeoHookean,
    RigidContact,
    RigidSphere,
    Simulation,
    SimulationError,
    StvkError,
    System,
    VelocityVerlet,
    simulate,
    solve_static,
)
from skfem_stvk.mesh import box
from skfem_stvk.solvers.dynamics.inputs import Inputs
from skfem_stvk.solvers.dynamics.integrators import StepFailed

DT = 1e-3
INTEGRATORS = [LinearBackwardEuler(DT), BackwardEuler(DT), EnergyMomentum(DT), VelocityVerlet(5e-5)]
MESH = box((0.1, 0.1, 0.1), (3, 3, 3))


def pressed(friction=True, **options):
    """Return a block on a floor below a ball that touches its top."""
    law = NeoHookean(young=3e4, poisson=0.4, density=1000.0)
    rub = Friction(0.4, slip_speed=0.05) if friction else None
    ball = RigidContact(RigidSphere((0.05, 0.05, 0.15), 0.05), friction=rub, name="ball", **options)
    return System(MESH, [law, ball], fixed={"front": "xyz"})


def hand(i):
    """Return the displacement of the ball after step `i`: down and to the side."""
    return np.array([2e-4 * max(i - 8, 0), -1e-4 * max(i - 12, 0), -1e-3 * min(i, 10)])


def linear(times, values):
    """Return the function that an input is within each step."""

    def at(t):
        i = int(np.clip(np.searchsorted(times, t) - 1, 0, len(times) - 2))
        before, after = values[i], values[i + 1]
        if t >= times[i + 1]:
            return after
        return before + max(0.0, (t - times[i]) / (times[i + 1] - times[i])) * (after - before)

    return at


def state_of(sim):
    rows = () if sim.ledger is None else sim.ledger.rows().ravel()
    return np.concatenate(
        [[sim.t, sim.steps], sim.u, sim.v, sim.contact("ball").resultant, *sim.copy_state().snapshot.history, rows]
    )


@pytest.mark.parametrize("friction", [False, True], ids=["smooth", "friction"])
@pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda one: one.name)
def test_an_input_equals_the_same_function_of_time(integrator, friction):
    n = 20
    sim = Simulation(pressed(friction), integrator, moved=["ball"], ledger=True)
    times, values = [0.0], [np.zeros(3)]
    for i in range(1, n + 1):
        sim.step(ball=hand(i))
        times.append(sim.t)
        values.append(hand(i))
    other = Simulation(pressed(friction, motion=linear(times, values)), integrator, ledger=True)
    for _ in range(n):
        other.step()
    assert np.array_equal(state_of(sim), state_of(other))
    assert sim.contact("ball").resultant[2] < -0.1 and ("friction_work" in sim.ledger) == friction


def test_the_work_of_a_moved_shape_is_external():
    for friction in (False, True):
        sim = Simulation(pressed(friction), EnergyMomentum(DT), moved=["ball"], ledger=True)
        for i in range(30):
            sim.step(ball=hand(i))
        work = sim.ledger["external_work"]
        assert work[-1] > 1e-3 and abs(sim.ledger["closure_error"]).max() < 1e-12 * work[-1]
        assert ("friction_work" in sim.ledger) == friction


def test_a_shape_that_moves_half_a_step_late_has_other_states(monkeypatch):
    sims = [Simulation(pressed(), BackwardEuler(DT), moved=["ball"]) for _ in range(2)]
    at = Inputs.at
    for number, sim in enumerate(sims):
        with monkeypatch.context() as patch:
            if number:
                patch.setattr(Inputs, "at", lambda self, t: at(self, t - DT / 2))
            for i in range(1, 11):
                sim.step(ball=hand(i))
    assert np.abs(sims[0].u - sims[1].u).max() > 0.01 * np.abs(sims[0].u).max()


@pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda one: one.name)
def test_restored_and_loaded_simulations_go_on_to_the_last_bit(integrator, tmp_path):
    sim = Simulation(pressed(), integrator, moved=["ball"], ledger=True)
    for i in range(12):
        sim.step(ball=hand(i))
    saved, found = sim.copy_state(), []
    sim.save(tmp_path)
    loaded = Simulation.load(tmp_path, pressed(), integrator)
    for one in (sim, sim, loaded):
        for i in range(12, 20):
            one.step(**({} if i == 15 else {"ball": hand(i)}))
        found.append(state_of(one))
        if one is sim:
            sim.restore(saved)
    assert np.array_equal(found[0], found[1]) and np.array_equal(found[0], found[2])
    with pytest.raises(StvkError, match=r"of a Simulation with moved contacts\. Continue it with Simulation\.load"):
        simulate(pressed(), until=1.0, checkpoint=tmp_path, resume=True, quiet=True)


def test_a_removed_element_leaves_the_shape_moved():
    sim = Simulation(pressed(), BackwardEuler(DT), moved=["ball"])
    for i in range(8):
        sim.step(ball=hand(i))
    saved, found = sim.copy_state(), []
    for _ in range(2):
        sim.remove([0])
        for i in range(8, 14):
            sim.step(ball=hand(i))
        found.append(state_of(sim))
        sim.restore(saved)
    assert np.array_equal(*found) and sim.contact("ball").resultant[2] < -1.0


def test_simulations_of_one_body_move_their_own_shapes():
    body = pressed()
    together, alone = ([Simulation(body, BackwardEuler(DT), moved=["ball"]) for _ in range(2)] for _ in range(2))
    for i in range(10):
        together[0].step(ball=hand(i))
        together[1].step(ball=0.5 * hand(i))
    for i in range(10):
        alone[0].step(ball=hand(i))
    for i in range(10):
        alone[1].step(ball=0.5 * hand(i))
    for one, other in zip(together, alone, strict=True):
        assert np.array_equal(state_of(one), state_of(other))
    assert not np.array_equal(together[0].u, together[1].u)


def test_other_analyses_of_a_moved_body_hold_the_shape_where_it_was_made():
    sim = Simulation(pressed(friction=False), BackwardEuler(DT), moved=["ball"])
    for i in range(10):
        sim.step(ball=hand(i))
    assert np.array_equal(solve_static(sim.system, quiet=True).u, 0 * sim.u)
    again = Simulation(sim.system, BackwardEuler(DT), moved=["ball"])
    for i in range(10):
        again.step(ball=hand(i))
    assert np.array_equal(again.u, sim.u)


def test_a_step_that_fails_leaves_the_shape_where_it_was():
    """A ball that jumps through the block is refused, and halves of the step do not help."""
    sims = [Simulation(pressed(), BackwardEuler(DT), moved=["ball"], halvings=2, ledger=True) for _ in range(2)]
    for number, sim in enumerate(sims):
        for i in range(14):
            sim.step(ball=hand(i))
            if number and i % 4 == 3:
                with pytest.raises(SimulationError):
                    sim.step(ball=(0, 0, -5.0))
    assert np.array_equal(state_of(sims[0]), state_of(sims[1])) and sims[1].failures == 3


def test_halves_of_a_step_move_the_shape_by_halves(monkeypatch):
    whole, half = (Simulation(pressed(), BackwardEuler(dt), moved=["ball"], halvings=1) for dt in (DT, DT / 2))
    stepper = whole._steps.stepper
    step = stepper.step

    def short(state, t):
        if t - state.t > 0.6 * DT:
            raise StepFailed("too long")
        step(state, t)

    monkeypatch.setattr(stepper, "step", short)
    for i in range(1, 10):
        whole.step(ball=hand(i))
        half.step(ball=hand(i), until=whole.t)
    np.testing.assert_allclose(whole.u, half.u, rtol=0, atol=1e-9)
