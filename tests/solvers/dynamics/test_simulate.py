"""Runs that fail, their counts and messages, and the contents of the energy ledger."""

import pickle
import re
from dataclasses import dataclass, replace
from types import SimpleNamespace

import meshio
import numpy as np
import pytest
import skfem
from motions import BOTH, MESHES, SCENES, begun, clamped, driven, material, pushed, reached, released, spinning, velocities

from skfem_stvk import (
    BodyForce,
    ElasticFoundation,
    ElementMesh,
    Gravity,
    Interrupted,
    NeoHookean,
    NodalLoad,
    Pressure,
    RigidContact,
    RigidPlane,
    StVK,
    StvkError,
    StvkWarning,
    System,
    Traction,
    VolumePenalty,
    simulate,
    solve_static,
)
from skfem_stvk.edges import ALL, NONE, TENSILE
from skfem_stvk.mesh import box
from skfem_stvk.results.series import read_list
from skfem_stvk.solvers.dynamics import (
    BackwardEuler,
    EdgeDamping,
    EnergyMomentum,
    ForwardEuler,
    GeneralizedAlpha,
    LinearBackwardEuler,
    Newmark,
    SimulationError,
    Status,
    VelocityVerlet,
)
from skfem_stvk.solvers.dynamics.critical_step import critical_step
from skfem_stvk.solvers.dynamics.forces import StartTensions
from skfem_stvk.solvers.dynamics.guards import EVERY, Guard
from skfem_stvk.solvers.dynamics.integrators import StepFailed
from skfem_stvk.solvers.dynamics.integrators.implicit import ImplicitStepper
from skfem_stvk.solvers.dynamics.motion_checkpoint import load
from skfem_stvk.solvers.dynamics.record import FEWEST, FIRST, Clock, MotionState, Reviews, RunRecord
from skfem_stvk.solvers.dynamics.steps import StableStep, StepCollapsed
from skfem_stvk.solvers.runs.ledger import Ledger

EXPLICIT = [ForwardEuler, VelocityVerlet]
SYSTEM = spinning(2).system
V0 = velocities(SYSTEM.mesh)


def call(system=SYSTEM, integrator=None, **options):
    options = {"until": 0.1, "v0": V0, "quiet": True} | options
    return simulate(system, integrator or VelocityVerlet(0.01), **options)


@pytest.mark.parametrize("make", EXPLICIT)
@pytest.mark.parametrize("d", [2, 3])
def test_a_step_that_is_too_long_is_reported_and_its_blow_up_detected(make, d):
    scene = spinning(d)
    critical = critical_step(scene.system).step
    with pytest.warns(StvkWarning, match=f"step dt = .* above the critical one, {critical:.4g} s"):
        run = scene.run(make(1.5 * critical), 500 * critical, raise_on_failure=False)
    assert run.status is Status.BLEW_UP and not run.success and "blew up soon after t = " in run.message
    energy, noticed = map(float, re.search(r", (\S+) J in all at t = (\S+) s", run.message).groups())
    assert energy > 20 * run.ledger["total_energy"][0] and run.t < noticed < 40 * 1.5 * critical
    assert run.ledger["time"][-1] == run.t and (np.diff(run.ledger["time"]) > 0).all()
    kinetic = 0.5 * run.v @ scene.system.mass().multiply(run.v)
    assert kinetic == pytest.approx(run.ledger["kinetic_energy"][-1], rel=1e-12)
    assert np.isfinite(run.u).all() and kinetic < 4 * run.ledger["total_energy"][0]


@pytest.mark.filterwarnings("ignore::skfem_stvk.errors.StvkWarning")
def test_a_blow_up_is_raised_with_the_run_so_far(tmp_path):
    with pytest.raises(SimulationError, match=r"blew up soon after t = .*try a smaller step, dt=None") as caught:
        spinning(2).run(VelocityVerlet(0.2), 100.0, save=tmp_path / "bang.pvd", every=1)
    assert "raise_on_failure=False" in str(caught.value) and "raise_on_failure" not in caught.value.run.message
    run = pickle.loads(pickle.dumps(caught.value)).run
    assert run.status is Status.BLEW_UP and run.ledger["time"][-1] == run.t and run.u.shape == (SYSTEM.ndofs,)
    times = [float(line.split('"')[1]) for line in (tmp_path / "bang.pvd").read_text().splitlines() if "timestep" in line]
    assert times == sorted(set(times))


def test_stable_steps_cause_no_warning_and_are_chosen_by_default():
    scene = spinning(3)
    for make in EXPLICIT:
        run = scene.run(make(), 0.3)
        assert run.dt == pytest.approx(0.9 * critical_step(scene.system).step, rel=0.1) and run.success
        assert scene.run(make(run.dt), 0.1).success


def recorded(state, ledger, steps):
    """Return the record of a run after some steps of 0.1 s."""
    record = RunRecord.at(state, ledger, SimpleNamespace(first_history=lambda: ()))
    record.clock, record.steps = Clock(0.0, 0.1), steps
    return record


def guarded(rows):
    """Return which rows of energies count as a blow-up, and the numbers of steps of the good states.

    Rows are kinetic, strain and potential energy, external and dissipated work, and closure error.
    """
    names = "time", "kinetic_energy", "strain_energy", "potential_energy", "external_work", "dissipated_work", "closure_error"
    ledger, found, good = Ledger(names), [], []
    record = recorded(MotionState.at(0.0, np.zeros(2), np.zeros(2)), ledger, 0)
    for number, row in enumerate(rows):
        record.steps = number
        ledger.append([0.1 * number, *row])
        if number == 0:
            record.store_good_state()
            guard = Guard(record)
        else:
            found.append(guard.blown_up())
            if guard.is_good():
                record.store_good_state()
            good.append(record.good.steps)
    return found, good


def test_excess_energy_is_compared_with_initial_and_supplied_energy():
    row = [1.0, 2.0, 5.0, 0.0, 0.0]
    error, bearable = 20.2, 19.9
    assert guarded([[*row, 0.0], [*row, 3 * error], [*row, 3 * bearable], [*row, -9e9]])[0] == [True, False, False]
    assert guarded([[*row, 0.0], [1.0, 2.0, -35.0, 0.0, 0.0, 3 * error]])[0] == [False]  # the potential energy has decreased
    assert guarded([[*row, 0.0], [1.0, 2.0, 5.0, -40.0, 0.0, 3 * error]])[0] == [False]  # external work was done on it
    assert guarded([[*row, 0.0], [1.0, 2.0, 5.0, 0.0, 40.0, 3 * error]])[0] == [
        True
    ]  # damping dissipated energy that never existed
    assert guarded([[*row, 0.0], [np.nan, 2.0, 5.0, 0.0, 0.0, 0.0]])[0] == [True]
    assert guarded([[0.0] * 6, [1e-20, 0.0, 0.0, 0.0, 0.0, 1e-20]])[0] == [False]


def test_the_last_good_state_has_the_right_energy():
    row = [1.0, 2.0, 0.0, 0.0, 0.0]
    _, good = guarded([[*row, 0.0]] * (3 * EVERY) + [[*row, 4.0]] * (2 * EVERY))
    assert good[0] == 0 and good[EVERY - 1] == EVERY
    assert good[-1] == 2 * EVERY


def test_a_state_with_new_energy_is_good_only_after_some_steps():
    row = [1.0, 2.0, 0.0, 0.0, 0.0]
    _, good = guarded(
        [[*row, 0.0]] * (EVERY + 1) + [[*row, 0.75]] * (3 * EVERY)
    )  # a quarter; a tenth is tolerated in as many steps
    assert good[7 * EVERY // 2 - 2] == EVERY and good[7 * EVERY // 2 - 1] == 7 * EVERY // 2
    _, good = guarded([[*row, 0.01 * number] for number in range(400)])  # slowly, and no more than the initial energy
    assert good[-1] == 300


@dataclass(frozen=True)
class LimitedSteps(EnergyMomentum):
    """EnergyMomentum that fails for steps longer than `limit`, all of them or every other one, and leaves the state unchanged."""

    limit: float = 1.0
    alternately: bool = False

    def stepper(self, motion):
        return LimitedStepper(motion, self)


class LimitedStepper(ImplicitStepper):
    def step(self, state, t):
        its_turn = not self.integrator.alternately or round(t / self.integrator.dt) % 2
        if t - state.t > self.integrator.limit and its_turn:
            raise StepFailed("too long")
        super().step(state, t)


def test_a_bar_without_stiffness_continues_to_move():
    """The critical step is infinite for some time."""
    bar = ElementMesh(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0], [1]]))
    system = System(bar, [StVK(young=1e5, poisson=0.0, area=1e-2, density=1000.0)], fixed=[([0], "xy"), ([1], "y")])
    for integrator in (VelocityVerlet(1e-3), ForwardEuler(1e-3), VelocityVerlet()):
        run = simulate(system, integrator, until=1.0, u0=[0, 0, 0.4, 0], quiet=True)
        assert run.success
        assert integrator.dt is None or abs(run.ledger["closure_error"][-1]) < 0.01 * run.ledger["strain_energy"][0]


@pytest.mark.filterwarnings("ignore::skfem_stvk.errors.StvkWarning")
def test_an_automatic_step_does_not_exceed_that_at_rest():
    """A body released from compression is soft for a moment; a body released from tension passes through its state of rest."""
    scene = spinning(2)
    for stretch in (-0.1, 0.3):
        u0 = stretch * scene.system.mesh.p.ravel("F")
        run = simulate(scene.system, VelocityVerlet(), until=1.0, u0=u0, quiet=True, raise_on_failure=False)
        rest, start = (critical_step(scene.system, u).step for u in (0 * u0, u0))
        assert np.diff(run.ledger["time"]).max() <= 0.851 * min(rest, start)


def test_energy_lost_by_the_steps_is_reported():
    assert re.search(r"; the steps lost \d+ % of the energy", clamped(2).run(BackwardEuler(0.05), 0.5).message)
    assert "energy" not in clamped(2).run(EnergyMomentum(0.05), 0.5).message


def test_steps_lose_at_most_all_energy():
    """A body with initial and supplied energy that large steps stop at once has lost nearly all of both, not 200 % of one."""
    bar = skfem.MeshLine(np.linspace(0, 1, 4))
    system = System(bar, [StVK(young=10.0, poisson=0.3, density=1.0), Gravity((1.0,))], fixed={lambda x: x[0] == 0: "x"})
    fallen, v0 = system.external_force(np.zeros(4)) @ solve_static(system, quiet=True).u, np.ones(4)
    v0 *= np.sqrt(2 * fallen / system.mass().vertex[1:].sum())
    run = simulate(system, BackwardEuler(1e3), until=1e4, v0=v0, quiet=True)
    kinetic, potential = run.ledger["kinetic_energy"], run.ledger["potential_energy"]
    lost = -run.ledger["closure_error"][-1]
    assert lost > 1.3 * kinetic[0] and lost > 1.3 * (potential[0] - potential[-1])  # of one alone, it is more than all
    assert -1 <= run.gained < -0.7 and run.gained == pytest.approx(-lost / (kinetic[0] + potential[0] - potential[-1]), rel=1e-3)
    assert f"lost {-100 * run.gained:.0f} % of the energy" in run.message


def test_a_failed_step_is_made_in_halves():
    for scene in (SCENES["driven and damped"](2), clamped(3)):
        fine, cut = (
            scene.run(make, 0.1) for make in (EnergyMomentum(0.005, rtol=1e-13), LimitedSteps(0.02, limit=0.006, rtol=1e-13))
        )
        assert cut.cuts == 5 and "in 5 steps, 5 of them cut into smaller ones" in cut.message and not fine.cuts
        assert np.abs(cut.v - fine.v).max() < 1e-6 * np.abs(fine.v).max()  # first velocities of supports: differences over 1e-2 dt
        for name in fine.ledger:
            scale = max(np.abs(fine.ledger[name]).max(), fine.ledger["kinetic_energy"].max())
            np.testing.assert_allclose(cut.ledger[name], fine.ledger[name][::4], rtol=0, atol=1e-6 * scale)


def test_consecutive_cut_steps_are_reported():
    with pytest.warns(StvkWarning, match="10 steps in a row had to be cut") as caught:
        clamped(2).run(LimitedSteps(0.02, limit=0.015), 0.4)
    assert len(caught) == 1


def test_eq_9_refuses_edge_damping_that_would_damp_other_terms():
    mesh = MESHES[2]
    floor = RigidContact(RigidPlane((0, -1), (0, 1)))
    for other in (VolumePenalty(), Pressure("right", 0.1), ElasticFoundation("left", 1.0), floor):
        system = System(mesh, [material(mesh), Gravity((0, -1)), other])
        with pytest.raises(StvkError, match=rf"would also damp {type(other).__name__}; expected laws on edges .*BackwardEuler"):
            call(system, LinearBackwardEuler(0.01, solver="superlu"), damping=EdgeDamping(0.1))
        assert call(system, BackwardEuler(0.01), damping=EdgeDamping(0.1)).success


def test_energy_supplied_before_a_resume_counts_for_the_guard():
    row = [1.0, 2.0, 0.0, 0.0, 0.0]
    ledger = Ledger(
        ("time", "kinetic_energy", "strain_energy", "potential_energy", "external_work", "dissipated_work", "closure_error")
    )
    for number, given in enumerate((0.0, 40.0, 0.0)):
        ledger.append([0.1 * number, 1.0, 2.0, 0.0, given, 0.0, 0.0])
    guard = Guard(recorded(MotionState.at(0.2, np.zeros(2), np.zeros(2)), ledger, 3))
    ledger.append([0.3, *row, 70.0])
    assert not guard.blown_up()


def test_initial_tensions_are_the_requested_ones():
    mesh = MESHES[2]
    system = System(mesh, [material(mesh)])
    tensions, v = StartTensions(system), velocities(mesh)
    for u in (0.2 * np.cos(np.arange(system.ndofs)), -0.1 * mesh.p.ravel("F")):
        tensions.begin(u)
        for kept in (ALL, TENSILE, ALL):
            difference = system.jacobian(u, kept=kept) - system.jacobian(u, kept=NONE)
            assert abs(difference).max() > 0.01
            np.testing.assert_allclose(
                tensions.values(1.0, kept), system.jacobian(u, kept=kept).data - system.jacobian(u, kept=NONE).data
            )
            product = sum(c * operator.matvec(v) for c, operator in tensions.operators(0.0, kept))
            np.testing.assert_allclose(product, difference @ v, atol=1e-12)


def test_a_record_is_restored_completely():
    _, record = begun(SYSTEM, VelocityVerlet(0.01), V0)

    def now():
        state, *others = vars(record.snapshot()).values()
        return str((state.t, others, record.ledger.steps))

    record.ledger.append(np.zeros(len(record.ledger)))
    record.store_good_state()
    before = now()
    record.state.u += 1
    record.ledger.append(np.ones(len(record.ledger)))
    record.state.t, record.steps, record.cuts, record.reviews = 0.5, 50, 3, Reviews(next=99)
    record.clock.change(0.02)
    assert now() != before
    record.return_to_good_state()
    assert now() == before and not record.state.u.any()
    record.clock.tick()  # the copy differs from the state that continues
    record.return_to_good_state()
    assert now() == before


def test_an_automatic_step_grows_only_up_to_its_first_value():
    setup, record = begun(SYSTEM, VelocityVerlet(), V0)
    limit = StableStep(setup.motion, setup.integrator)
    dt, reviews = limit.first(record.state)
    record.clock = Clock(0.0, dt, 1)

    def review(critical):
        record.reviews = replace(reviews, next=0)
        limit._largest = SimpleNamespace(bound=lambda u, t: np.inf, at=lambda u, t: SimpleNamespace(step=critical, bound=critical))
        record.clock.dt, record.reviews = limit.review(record)
        return record.clock.dt

    assert review(3 * dt) == dt
    assert review(dt / 2) == 0.85 * dt / 2
    assert review(dt) == 0.85 * dt and review(10 * dt) == dt
    with pytest.raises(StepCollapsed, match=r"the stable step fell from .* s to 8.5e-19 s, because the body is so stiff there"):
        review(1e-18)
    assert review(1.01e-5 * dt / 0.85) == pytest.approx(1.01e-5 * dt)


def test_an_infinite_bound_gives_no_estimate_and_an_early_review():
    for before, bound in ((np.inf, 1.0), (1.0, np.inf)):
        step, reviews = Reviews(step=1.0, bound=before).estimate(bound, 7)
        assert np.isnan(step) and reviews.next == 7 + FEWEST
    step, reviews = Reviews(step=1.0, bound=0.5).estimate(0.25, 7)
    assert step == 0.5 and reviews.next < 7 + FIRST


def test_a_run_ends_with_the_state_before_a_step_that_fails_in_all_parts():
    scene = SCENES["driven and damped"](2)
    run = scene.run(LimitedSteps(0.02, limit=0.02 / 65), 0.1, raise_on_failure=False)
    assert (
        run.status is Status.NOT_CONVERGED
        and run.t == 0
        and not run.u[scene.system.free_dofs(scene.system.supports.held).free].any()
    )
    assert "the step from t = 0 s did not converge, not even in 64 parts: too long" in run.message
    assert scene.run(LimitedSteps(0.02, limit=0.02 / 63), 0.04).cuts == 2


def test_a_run_stopped_by_inversion_names_the_elements():
    mesh = MESHES[3]
    system = System(mesh, [material(mesh), NodalLoad((1, 5), lambda t: [f / 10 for f in pushed(t)])])
    for make in (BackwardEuler, Newmark, GeneralizedAlpha, EnergyMomentum):
        with pytest.raises(
            SimulationError, match=r"did not converge, .*would invert: 1 element \(\d+\), .* Try a smaller dt or another"
        ) as caught:
            simulate(system, make(0.02), until=0.5, v0=velocities(mesh), quiet=True)
        run = caught.value.run
        assert 0 < run.t < 0.5 and not len(system.inside_out(run.u)) and run.ledger["time"][-1] == run.t


@pytest.mark.parametrize("integrator", [ForwardEuler(0.01), VelocityVerlet(0.01), LinearBackwardEuler(0.01), EnergyMomentum(0.01)])
@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_exceptions_are_raised_with_the_last_whole_state(integrator, error):
    def failing(t):
        if 0.5 < t < 0.99:
            raise error("no more")
        return (np.sin(3 * t), 0.1)

    system = System(MESHES[2], [material(MESHES[2]), Traction("right", failing)], fixed={"left": "xy"})
    with pytest.raises(
        Interrupted if error is KeyboardInterrupt else SimulationError, match=r"interrupted at t = 0\.[45]"
    ) as caught:
        simulate(system, integrator, until=0.9, quiet=True, raise_on_failure=False)
    run = caught.value.run
    assert run.status is Status.INTERRUPTED and 0.4 <= run.t <= 0.51 and run.ledger["time"][-1] == run.t
    whole = simulate(system, integrator, until=run.t, quiet=True)
    np.testing.assert_array_equal(whole.u, run.u)
    np.testing.assert_array_equal(whole.v, run.v)


@pytest.mark.parametrize("until", [0.95, 1.0])
def test_steps_end_at_multiples_of_dt_and_at_the_end_time(until):
    times = spinning(2).run(EnergyMomentum(0.1), until).ledger["time"]
    np.testing.assert_array_equal(times, [*(0.1 * np.arange(10)), until])
    late = spinning(2).run(EnergyMomentum(0.1), 5.0 + until, t0=5.0).ledger["time"]
    np.testing.assert_allclose(late - 5, times, atol=1e-14)


@pytest.mark.parametrize(
    ("start", "dt", "until"),
    [(0.0, 0.1, 1.0), (0.0, 0.3, 0.9), (0.0, 0.01, 0.07), (0.3, 1 / 3, 100.3), (-2.0, 1e-3, 7.0), (1e6, 0.1, 1e6 + 1)],
)
def test_a_clock_reaches_the_end_after_a_whole_number_of_steps(start, dt, until):
    clock, whole = Clock(start, dt), True
    expected = clock.steps_left(until)
    steps = 0
    while clock.steps_left(until):
        t, whole = clock.next(until)
        clock.tick()
        steps += 1
    assert whole and steps == expected == round((until - start) / dt) and abs(t - until) < 1e-6 * dt


def test_a_clock_continues_with_another_step():
    clock = Clock(1.0, 0.25)
    clock.tick()
    clock.change(0.5)
    assert clock.t == 1.25 and clock.next(9.0) == (1.75, True) and clock.next(1.5) == (1.5, False) and clock.steps_left(2.0) == 2
    assert clock.steps_left(1.25) == clock.steps_left(1.0) == 0


def kinds():
    mesh = MESHES[3]
    yield "potential_energy", Gravity((0.3, -1.0, 0.5))
    yield "potential_energy", Traction("right", (0.1, 0.2, -0.1))
    yield "potential_energy", NodalLoad((3, 4), (0.01, 0.02, -0.03))
    yield "potential_energy", BodyForce((0.1, 0.2, -0.3))
    yield "external_work", Pressure("right", 0.3)
    yield "external_work", Gravity(lambda t: pushed(t))
    yield "external_work", Traction("right", lambda x, t: (x[1] * t, np.cos(3 * t), 0 * x[0]))
    yield "external_work", NodalLoad((3, 4), lambda t: [0.01 * f for f in pushed(t)])
    yield "external_work", BodyForce(lambda x, t: (t * x[0], x[1], np.sin(5 * t) * x[2]))
    yield "external_work", Pressure(lambda x: x[0] > 0.8, lambda t: 0.3 * t)
    assert mesh.d == 3


@pytest.mark.few
@pytest.mark.parametrize(("column", "load"), [pytest.param(*kind, id=f"{type(kind[1]).__name__}, {kind[0]}") for kind in kinds()])
def test_the_energy_of_a_load_is_in_the_ledger(column, load):
    mesh = MESHES[3]
    system = System(mesh, [material(mesh), load])
    run = simulate(system, EnergyMomentum(0.02, rtol=1e-13), until=0.2, v0=0.5 * velocities(mesh), quiet=True)
    ledger = run.ledger
    other = {"potential_energy": "external_work", "external_work": "potential_energy"}[column]
    given = np.abs(ledger[column] - ledger[column][0]).max()
    assert given > 1e-4 and not ledger[other].any() and np.abs(ledger["closure_error"]).max() < 1e-10 * given
    assert (
        np.ptp(ledger["total_energy"]) < 1e-10 * given
        if column == "potential_energy"
        else np.ptp(ledger["total_energy"]) > 0.5 * given
    )


def test_a_row_of_the_ledger_agrees_with_the_state():
    mesh = MESHES[3]
    terms = [material(mesh), VolumePenalty(2.0, kind="quadratic"), Gravity((0.3, -1.0, 0.5))]
    system = System(mesh, terms)
    run = simulate(system, VelocityVerlet(0.005), until=0.1, v0=velocities(mesh), probes={"A": [3], "B": "right"}, quiet=True)
    ledger, x = run.ledger, mesh.p.T + run.u.reshape(-1, 3)
    momentum = (run.v * np.repeat(system.mass().vertex, 3)).reshape(-1, 3)
    energies, last = system.energies(run.u), {name: ledger[name][-1] for name in ledger}
    expected = {
        "time": 0.1,
        "kinetic_energy": run.v @ momentum.ravel() / 2,
        "strain_energy": energies["StVK 0"] + energies["VolumePenalty 1"],
        "strain_energy StVK 0": energies["StVK 0"],
        "strain_energy VolumePenalty 1": energies["VolumePenalty 1"],
        "potential_energy": energies["Gravity 2"],
        "external_work": 0.0,
        "dissipated_work": 0.0,
        "total_energy": system.energy(run.u) + energies["Gravity 2"] + run.v @ momentum.ravel() / 2,
        "closure_error": ledger["total_energy"][-1] - ledger["total_energy"][0],
        "inside_out": 0,
        **{f"linear_momentum_{c}": value for c, value in zip("xyz", momentum.sum(axis=0), strict=True)},
        **{f"angular_momentum_{c}": value for c, value in zip("xyz", np.cross(x, momentum).sum(axis=0), strict=True)},
        **{f"A {c}": value for c, value in zip("xyz", run.u.reshape(-1, 3)[3], strict=True)},
        **{
            f"B {c}": value
            for c, value in zip("xyz", run.u.reshape(-1, 3)[np.unique(mesh.boundaries["right"])].mean(axis=0), strict=True)
        },
    }
    assert list(last) == list(expected) and last == pytest.approx(expected, rel=1e-10, abs=1e-13)


def test_a_body_in_equilibrium_stays_at_rest_under_constant_loads():
    mesh = MESHES[2]
    terms = [material(mesh, young=30.0), Gravity((0.0, -1.0)), Traction("right", (0.5, 0.2))]
    supports = {"fixed": {"left": "xy"}, "prescribed": {lambda x: x[0] > 0.9: {"x": 0.05}}}
    equilibrium = solve_static(System(mesh, terms, **supports), quiet=True, rtol=1e-13).u
    for integrator in (VelocityVerlet(0.002), LinearBackwardEuler(0.01), EnergyMomentum(0.01), GeneralizedAlpha(0.01)):
        run = simulate(System(mesh, terms, **supports), integrator, until=0.1, u0=equilibrium, quiet=True)
        assert (
            np.abs(run.u - equilibrium).max() < 1e-9 * np.abs(equilibrium).max()
            and np.abs(run.ledger["external_work"]).max() < 1e-12
        )


@pytest.mark.parametrize("name", ["save", "checkpoint"])
def test_unwritable_files_are_refused_before_any_work(tmp_path, name):
    (tmp_path / "folder.pvd").mkdir()
    (tmp_path / "flag").write_text("no folder")
    wrong = {"save": ("missing/flag.pvd", "flag.txt", "folder.pvd"), "checkpoint": ("missing/flag", "flag")}
    for path in (tmp_path / one for one in wrong[name]):
        with pytest.raises(StvkError, match=r"flag|folder"):
            call(**{name: path})
        with pytest.raises(StvkError, match=r"flag|folder"):
            call(System(MESHES[2], StVK(young=3.0, poisson=0.3)), **{name: path})  # which would be the next error


def test_names_of_files_may_have_blanks_and_umlauts(tmp_path):
    run = clamped(2).run(EnergyMomentum(0.01), 0.05, save=tmp_path / "Flügel 1 ß.pvd", every=1, checkpoint=tmp_path / "Flü gel")
    assert (
        simulate(run.system, checkpoint=tmp_path / "Flü gel", resume=True, until=0.1, quiet=True).series
        == tmp_path / "Flügel 1 ß.pvd"
    )
    for path in (run.animate(tmp_path / "ä ö.gif", "velocity"), run.save(tmp_path / "ü é.vtu"), tmp_path / "Flügel 1 ß.csv"):
        assert path.is_file()


def test_animations_need_saved_states():
    run = clamped(2).run(EnergyMomentum(0.01), 0.02)
    with pytest.raises(StvkError, match=r"no states were saved. Name a series: simulate\(..., save='run.pvd'\)"):
        run.animate("flag.gif")
    with pytest.raises(TypeError, match="until"):
        simulate(run.system, EnergyMomentum(0.01))


def velocities_of(path):
    """Return velocities by time, of a series."""
    return {t: meshio.read(path.with_name(name)).point_data["velocity"][:, :2].ravel() for t, name in read_list(path)}


def test_velocities_are_saved_with_the_displacements(tmp_path):
    scene = driven(2, damping=BOTH)
    whole = scene.run(EnergyMomentum(0.01), 0.2, save=tmp_path / "whole.pvd", every=3)
    scene.run(EnergyMomentum(0.01), 0.1, save=tmp_path / "parts.pvd", every=3, checkpoint=tmp_path / "c")
    simulate(scene.system, checkpoint=tmp_path / "c", resume=True, until=0.2, quiet=True)
    one, other = velocities_of(tmp_path / "whole.pvd"), velocities_of(tmp_path / "parts.pvd")
    assert list(one) == list(other) and len(one) == 8
    for t, v in one.items():
        np.testing.assert_array_equal(other[t], v)
        np.testing.assert_array_equal(v, whole.v if t == whole.t else scene.run(EnergyMomentum(0.01), t).v if t else v)
    kinetic = [v @ whole.motion.mass.multiply(v) / 2 for v in one.values()]
    rows = np.searchsorted(whole.ledger["time"], list(one))
    np.testing.assert_allclose(kinetic, whole.ledger["kinetic_energy"][rows], rtol=1e-12)
    assert meshio.read(whole.save(tmp_path / "end.vtu")).point_data["velocity"][:, :2].ravel().tolist() == whole.v.tolist()
    assert not list(set(velocities_of(tmp_path / "whole.pvd")) - set(whole.ledger["time"]))


@pytest.mark.filterwarnings("ignore::skfem_stvk.errors.StvkWarning")
def test_the_velocities_after_a_blow_up_are_those_of_the_last_good_state(tmp_path):
    run = spinning(2).run(VelocityVerlet(0.2), 100.0, save=tmp_path / "bang.pvd", every=1, raise_on_failure=False)
    saved = velocities_of(tmp_path / "bang.pvd")
    assert run.status is Status.BLEW_UP and max(saved) == run.t
    np.testing.assert_array_equal(saved[run.t], run.v)


@pytest.mark.parametrize("integrator", [VelocityVerlet(0.01), LinearBackwardEuler(0.01), EnergyMomentum(0.01)])
def test_writing_time_is_part_of_the_total(integrator, tmp_path):
    for options in ({}, {"save": tmp_path / "a.pvd"}, {"checkpoint": tmp_path / "a"}):
        run = clamped(2).run(integrator, 0.05, **options)
        assert list(run.seconds) == ["assemble", "factor", "solve", "write", "other"]
        assert bool(options) == (run.seconds["write"] > 0) and min(run.seconds.values()) >= 0


def test_the_last_state_and_the_ledger_are_always_saved(tmp_path):
    run = clamped(2).run(EnergyMomentum(0.01), 0.135, save=tmp_path / "a.pvd", every=5, checkpoint=tmp_path / "a")
    pvd = (tmp_path / "a.pvd").read_text()
    assert [float(line.split('"')[1]) for line in pvd.splitlines() if "timestep" in line] == [0.0, 0.05, 0.1, 0.135]
    table = np.genfromtxt(tmp_path / "a.csv", delimiter=",", names=True)
    np.testing.assert_array_equal(table["total_energy_J"], run.ledger["total_energy"])
    assert run.series == tmp_path / "a.pvd" and sorted(file.suffix for file in tmp_path.iterdir()) == [
        "",
        ".csv",
        ".pvd",
        *4 * [".vtu"],
    ]


def test_a_run_is_summarised_in_repr_and_output(capsys):
    run = driven(2, damping=BOTH).run(EnergyMomentum(0.01), 0.1, quiet=False)
    assert "reached t = 0.1 s in 10 steps" in repr(run) and "EnergyMomentum(dt=0.01" in repr(run) and "assemble" in repr(run)
    printed = capsys.readouterr().out
    assert "step 10/10" in printed and "EnergyMomentum" in printed
    assert run.iterations >= 10 and run.success and run.system.ndofs == len(run.u)
    driven(2).run(EnergyMomentum(0.01), 0.1, quiet=True)
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("name", ["a\nb", "\x1b[31mred", "a\0", "\ud800", "a\rb"])
def test_unprintable_names_of_probes_and_series_are_refused(name, tmp_path):
    scene = spinning(2)
    with pytest.raises(StvkError, match=r"probes: name = .*; expected printable characters") as caught:
        scene.run(VelocityVerlet(0.01), 0.1, probes={name: [1]})
    assert str(caught.value).isprintable()
    if "\0" not in name:
        with pytest.raises(StvkError, match=r"cannot be printed or stored in lists of files|names can be encoded") as caught:
            scene.run(VelocityVerlet(0.01), 0.1, save=tmp_path / f"{name}.pvd")
        assert str(caught.value).isprintable() and not list(tmp_path.iterdir())


def test_iterations_are_summed_over_all_steps():
    short, long = (clamped(3).run(LinearBackwardEuler(0.01), until).iterations for until in (0.2, 0.4))
    assert short >= 20 and long >= short + 20


def test_a_resumed_run_continues_its_counts(tmp_path):
    """Iterations, clamped tangents and seconds include the first part of the run, which has most of them."""
    pressed, integrator = released(3), LinearBackwardEuler(0.2)
    whole = pressed.run(integrator, 4.0)
    first = pressed.run(integrator, 3.0, checkpoint=tmp_path / "run")
    resumed = reached(pressed.system, checkpoint=tmp_path / "run", resume=True, until=4.0)
    assert 0 < first.iterations < resumed.iterations == whole.iterations
    assert re.search(r"[1-9]\d* of them with the clamped", first.message) and resumed.message == whole.message
    assert resumed.seconds.keys() == first.seconds.keys()
    assert all(resumed.seconds[part] >= 0.9 * first.seconds[part] for part in ("assemble", "factor", "solve"))


def test_an_unused_clamped_tangent_is_not_reported():
    assert "clamped" not in spinning(3).run(LinearBackwardEuler(0.01), 0.1).message


def test_occasional_cut_steps_are_counted_without_a_warning():
    assert clamped(2).run(LimitedSteps(0.01, limit=0.009, alternately=True), 0.4).cuts == 20


def test_a_run_resumes_in_its_original_folder(tmp_path, monkeypatch):
    scene, here, there = clamped(2), tmp_path / "here", tmp_path / "there"
    for folder in (here, there):
        folder.mkdir()
    monkeypatch.chdir(here)
    scene.run(EnergyMomentum(0.01), 0.1, save="run.pvd", checkpoint="run")
    monkeypatch.chdir(there)
    simulate(scene.system, checkpoint=here / "run", resume=True, until=0.2, quiet=True)
    assert not list(there.iterdir())
    assert '"0.2' in (here / "run.pvd").read_text()
    assert load(here / "run" / "motion.npz").saved.steps == 20


def test_a_body_that_starts_within_a_shape_makes_the_message_name_the_contact():
    """The normal of the floor points down, so most of the cube is within the half-space of the floor and its first step fails."""
    rubber = NeoHookean(young=5e4, poisson=0.4, density=1000.0)

    def message(normal, height=-0.05, **motion):
        floor = RigidContact(RigidPlane((0, 0, height), normal), name="floor")
        cube = System(box((0.1, 0.1, 0.1), (4, 4, 4)), [rubber, Gravity((0, 0, -9.81)), floor])
        return simulate(cube, EnergyMomentum(dt=1e-3), until=2e-3, quiet=True, raise_on_failure=False, **motion).message

    assert "The body starts within the shape of 'floor': check the position and the normal of the shape." in message(
        (0, 0, -1), 0.01
    )
    assert "starts within" not in message((0, 0, 1))
    wild = np.random.default_rng(0).normal(0, 300, 375)  # the first step fails, on a floor that the cube touches to round-off
    resting = message((0, 0, 1), 1e-17, v0=wild)
    assert "the step from t = 0 s did not converge" in resting and "starts within" not in resting
