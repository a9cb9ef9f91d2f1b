"""Explicit runs find stable steps, shorten them after a blow-up, and report inverted elements and long steps."""

import re
import sys

import numpy as np
import pytest
from motions import MESHES, kicked, material, pushed, reached, released, spinning, velocities

from skfem_stvk import (
    ElementMesh,
    Friction,
    Gravity,
    NodalLoad,
    RigidContact,
    RigidPlane,
    StVK,
    StvkError,
    StvkWarning,
    System,
    VolumePenalty,
    simulate,
)
from skfem_stvk.mesh import box as solid
from skfem_stvk.results.series import read_list
from skfem_stvk.solvers.dynamics import (
    BackwardEuler,
    EdgeDamping,
    EnergyMomentum,
    ForwardEuler,
    Newmark,
    Rayleigh,
    Status,
    VelocityVerlet,
    critical_step,
    guards,
)
from skfem_stvk.solvers.dynamics.loop import Loop
from skfem_stvk.solvers.dynamics.motion_checkpoint import load


@pytest.mark.parametrize("damping", [(3.0, 0.0, 0.0), (0.0, 0.02, 0.0), (0.0, 0.0, 0.02)], ids=["alpha", "beta", "tau"])
@pytest.mark.parametrize(("make", "weight"), [(ForwardEuler, 1), (VelocityVerlet, 2)], ids=["ForwardEuler", "VelocityVerlet"])
def test_damping_at_a_predicted_velocity_counts_twice_in_the_step(make, weight, damping):
    scene = spinning(2, damping=kinds(1, *damping))
    expected = critical_step(scene.system, damping=kinds(weight, *damping)).step
    assert scene.run(make(), 1e-3).dt == pytest.approx(0.85 * expected, rel=1e-9)
    assert 0.85 * expected < 0.84 * critical_step(scene.system).step


def kinds(times, alpha, beta, tau):
    return [Rayleigh(times * alpha, times * beta), EdgeDamping(times * tau)]


def test_a_step_size_is_required_if_any_step_is_stable():
    """A bar that can only swing has no transverse stiffness."""
    bar = ElementMesh(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0], [1]]))
    system = System(bar, StVK(young=1.0, poisson=0.0, area=1.0, density=1.0), fixed=[([0], "xy"), ([1], "x")])
    v0 = [0, 0, 0, 0.01]
    with pytest.raises(StvkError, match=r"no part that moves has stiffness, so every step is stable. Give dt=..."):
        simulate(system, VelocityVerlet(), until=1.0, v0=v0, quiet=True)
    assert simulate(system, VelocityVerlet(0.1), until=1.0, v0=v0, quiet=True).success


def test_the_search_for_a_frequency_is_limited(monkeypatch):
    system = spinning(3).system
    found = critical_step(system)
    monkeypatch.setattr(sys.modules["skfem_stvk.solvers.dynamics.critical_step"], "MOST_PRODUCTS", 5)
    given_up = critical_step(system)
    assert found.products > given_up.products == 5
    assert given_up.bound <= given_up.step <= 1.001 * found.step  # on the safe side by the remaining residual


@pytest.mark.parametrize("make", [ForwardEuler, VelocityVerlet])
def test_inverted_elements_are_reported_once_even_if_states_are_saved_rarely(make):
    mesh = MESHES[3]
    system = System(mesh, [material(mesh), NodalLoad((1, 5), lambda t: [f / 5 for f in pushed(t)])])
    with pytest.warns(StvkWarning, match=r"t = 0.16 s: .*element.* inverted.*VolumePenalty") as caught:
        run = reached(system, make(0.004), until=0.5, v0=velocities(mesh), every=10_000)
    assert len(caught) == 1 and run.ledger["inside_out"][-1] == len(system.inside_out(run.u)) > 0


@pytest.mark.parametrize("make", [BackwardEuler, Newmark])
def test_a_body_may_start_with_inverted_elements(make):
    mesh = MESHES[2]
    system = System(mesh, [material(mesh), VolumePenalty(3.0, kind="compression")], fixed={"left": "xy"})
    u0 = np.zeros((mesh.nv, 2))
    corner = int(np.argmax(mesh.p.sum(axis=0)))
    u0[corner] = [-0.45, -0.35]
    assert len(system.inside_out(u0.ravel()))
    with pytest.warns(StvkWarning, match=r"t = 0.005 s: .* inverted"):
        assert reached(system, make(0.005), until=0.005, u0=u0.ravel()).cuts == 0


@pytest.mark.parametrize("every", [1, 7, 20, 1000])
@pytest.mark.filterwarnings("ignore::skfem_stvk.errors.StvkWarning")
def test_files_of_a_motion_that_blew_up_end_with_the_run(every, tmp_path):
    mesh = MESHES[2]
    system = System(mesh, [material(mesh), NodalLoad((1, 5), lambda t: (0.0, 0.0) if t <= 1 else (1e5, 3e5))])
    files = {"save": tmp_path / "run.pvd", "every": every, "checkpoint": tmp_path / "run"}
    run = simulate(system, VelocityVerlet(0.01), until=5.0, v0=0.1 * velocities(mesh), raise_on_failure=False, quiet=True, **files)
    times = [t for t, _ in read_list(tmp_path / "run.pvd")]
    assert run.status is Status.BLEW_UP and run.t == 1.0
    assert times == sorted(set(times)) and times[-1] == run.t and len(times) == 1 + -(-100 // every)
    read = load(tmp_path / "run" / "motion.npz")
    assert read.saved.state.t == run.t and read.ledger.steps == 101
    np.testing.assert_array_equal(read.saved.state.u, run.u)


def test_a_step_that_is_too_long_is_reported_once():
    """A body in pure translation has no vibration that could grow, except round-off."""
    scene = spinning(2, v0=np.ones(2 * MESHES[2].nv))
    dt = 1.02 * critical_step(scene.system).step
    with pytest.warns(StvkWarning) as caught:
        assert scene.run(VelocityVerlet(dt), 50 * dt).success
    assert sum("above the critical one" in str(warning.message) for warning in caught) == 1


def test_an_infinite_step_is_refused():
    for make in (VelocityVerlet, BackwardEuler):
        with pytest.raises(StvkError, match="dt = inf; expected a time step"):
            make(np.inf)


def test_newmarks_factors_are_checked_together():
    for beta, gamma in ((0.25, 0.6), (0.29, 0.6)):
        with pytest.raises(StvkError, match="expected gamma >= 1/2 and beta >= gamma/2"):
            Newmark(0.1, beta=beta, gamma=gamma)
    assert Newmark(0.1, beta=0.3, gamma=0.6).order == 1


def on_floor(slip_speed, coefficient=0.3):
    """Return a block on a floor with friction."""
    friction = Friction(coefficient, slip_speed=slip_speed)
    contact = RigidContact(RigidPlane((0, 0, 0), (0, 0, 1)), lambda x: x[2] == 0, friction=friction)
    return System(solid((0.2, 0.2, 0.1), (3, 3, 2)), [SOLID, Gravity((1.0, 0, -9.81)), contact])


SOLID = StVK(young=1e6, poisson=0.3, density=1e3)


@pytest.mark.parametrize("make", [VelocityVerlet, ForwardEuler])
def test_friction_in_explicit_steps_does_no_work_and_the_body_sticks(make):
    system = on_floor(1e-3)
    v0 = np.tile([0.05, 0, 0], system.mesh.nv)
    run = simulate(system, make(), until=0.1, v0=v0, damping=Rayleigh(beta=1e-3), quiet=True)
    energy, foot = run.ledger["kinetic_energy"][0], system.mesh.p[2] == 0
    assert run.ledger["closure_error"].max() < 0.02 * energy
    assert 0 < run.v.reshape(-1, 3)[foot, 0].mean() < 1e-3 and np.ptp(run.v.reshape(-1, 3)[foot, 0]) < 2e-3
    assert run.dt < 0.5 * run.ledger["time"][1]  # the first row is from before it touches


def test_a_step_in_which_friction_would_reverse_velocities_is_reported_with_the_node_and_the_step():
    system, dt = on_floor(1e-3), 1e-4
    assert dt < critical_step(system).step
    with pytest.warns(StvkWarning, match=r"step dt = 0.0001 s is above the critical one, .* s, because friction .* at node \d+"):
        simulate(system, VelocityVerlet(dt), until=0.01, quiet=True)
    simulate(on_floor(0.1), VelocityVerlet(dt), until=0.01, quiet=True)


def test_edge_damping_of_a_body_with_friction_does_not_let_the_step_collapse():
    run = simulate(on_floor(0.1, 0.5), VelocityVerlet(), until=0.02, damping=EdgeDamping(tau=2e-3), quiet=True)
    assert run.success and run.dt > 0.1 * run.ledger["time"][1] and run.blow_ups == 0


@pytest.mark.parametrize(
    ("slip_speed", "why", "floor"), [(1e-10, "friction would reverse velocities at node", 1e-2), (0.1, "so stiff there", 2.0)]
)
def test_a_collapse_of_the_step_is_called_by_its_name(monkeypatch, slip_speed, why, floor):
    """Without friction nothing collapses in a healthy state. With it, steps shrink slowly, so the floor is raised."""
    monkeypatch.setattr(sys.modules["skfem_stvk.solvers.dynamics.steps"], "FLOOR", floor)
    run = simulate(on_floor(slip_speed), VelocityVerlet(), until=0.02, quiet=True, raise_on_failure=False)
    assert run.status is Status.STOPPED and "blew up" not in run.message
    assert run.message.startswith("stopped soon after t = ") and "the stable step fell from" in run.message and why in run.message
    assert ("Take a larger slip_speed, or an implicit integrator" in run.message) == (slip_speed < 0.1)


pytestmark = pytest.mark.filterwarnings("ignore:.*inverted:skfem_stvk.errors.StvkWarning")
V0 = velocities(MESHES[2])
EXPLICIT = [ForwardEuler, VelocityVerlet]
ONCE = r"; it blew up once on the way, and went on from the last good state with steps of at most (\S+) s in place of (\S+) s"


@pytest.mark.parametrize("make", EXPLICIT)
@pytest.mark.parametrize("scene", [released, kicked])
@pytest.mark.parametrize("d", [2, 3])
def test_a_motion_that_blows_up_continues_with_half_the_step(d, scene, make):
    run = scene(d).run(make(), 4.0)
    shorter, first = map(float, re.search(ONCE, run.message).groups())
    times, ledger = run.ledger["time"], run.ledger
    assert run.t == times[-1] == 4.0 and shorter == pytest.approx(first / 2, rel=1e-3)
    assert run.blow_ups == 1 and run.gained == ledger["closure_error"][-1] / guards.reference_energy(ledger)
    assert (np.diff(times) > 0).all() and f"in {len(times) - 1} steps" in run.message
    assert run.dt < 1.001 * shorter
    kinetic = run.v @ run.motion.mass.multiply(run.v) / 2
    assert ledger["kinetic_energy"][-1] == pytest.approx(kinetic, rel=1e-12)
    assert ledger["strain_energy"][-1] == pytest.approx(run.system.energies(run.u)["StVK 0"], rel=1e-12)
    most = guards.reference_energy(ledger)
    assert np.abs(ledger["closure_error"]).max() < 0.3 * most and np.abs(ledger["closure_error"][-1]) < 0.1 * most


@pytest.mark.parametrize("make", EXPLICIT)
def test_a_user_supplied_step_is_never_changed(make):
    scene = released(2)
    dt = 2 * scene.run(make(), 3.0).ledger["time"][1]  # it went back to the beginning
    run = scene.run(make(dt), 3.0, raise_on_failure=False)
    assert run.status is Status.BLEW_UP and run.dt == dt and "on the way" not in run.message and "halved" not in run.message


def test_a_motion_that_blows_up_repeatedly_is_stopped(tmp_path, monkeypatch):
    """The load does no work before t = 1 s."""
    mesh, begun, kept = MESHES[2], [], Loop._begin
    monkeypatch.setattr(Loop, "_begin", lambda self: begun.append(self.record.clock.dt) or kept(self))
    system = System(mesh, [material(mesh), NodalLoad((1, 5), lambda t: (0.0, 0.0) if t <= 1 else (1e9, 3e9))])
    files = {"save": tmp_path / "run.pvd", "every": 7, "checkpoint": tmp_path / "run"}
    run = simulate(system, VelocityVerlet(), until=2.0, v0=0.1 * V0, quiet=True, raise_on_failure=False, **files)
    assert run.status is Status.BLEW_UP and 0 < run.t <= 1
    np.testing.assert_allclose(np.array(begun) / begun[0], [1, 1 / 2, 1 / 4, 1 / 8, 1 / 16])
    assert re.search(
        rf"The step was \S+ s, halved 4 times from {begun[0]:.4g} s at most \(critical step .* s, safe bound", run.message
    )
    assert read_list(tmp_path / "run.pvd")[-1][0] == run.t == run.ledger["time"][-1]


@pytest.mark.parametrize("every", [1, 3, 7, 23, 1000])
def test_discarded_steps_are_in_no_file(every, tmp_path):
    files = {"save": tmp_path / "run.pvd", "every": every, "checkpoint": tmp_path / "run"}
    run = kicked(3).run(VelocityVerlet(), 3.0, **files)
    times, steps = run.ledger["time"], run.ledger.steps - 1
    saved = [t for t, _ in read_list(tmp_path / "run.pvd")]
    assert "on the way" in run.message and saved == [*times[:-1:every], times[-1]]
    assert len(list(tmp_path.glob("*.vtu"))) == len(saved) == 1 + -(-steps // every)
    np.testing.assert_array_equal(np.genfromtxt(tmp_path / "run.csv", delimiter=",", skip_header=1), run.ledger.rows())


def test_checkpoints_contain_the_last_good_state_only_for_automatic_steps(tmp_path):
    for integrator, kept in ((VelocityVerlet(), True), (VelocityVerlet(0.01), False), (EnergyMomentum(0.01), False)):
        run = released(2, by=0.05).run(integrator, 1.0, checkpoint=tmp_path / "run", overwrite=True)
        saved = load(tmp_path / "run" / "motion.npz").saved
        assert kept == (saved.good is not None)
        assert run.status is Status.FINISHED


def test_an_existing_penalty_is_not_recommended():
    mesh = MESHES[3]
    system = System(
        mesh, [material(mesh), VolumePenalty(0.01, "compression"), NodalLoad((1, 5), lambda t: [f / 5 for f in pushed(t)])]
    )
    with pytest.warns(StvkWarning, match=r"inverted. Take smaller steps, or a stiffer VolumePenalty\.$"):
        reached(system, VelocityVerlet(0.004), until=1.0)


@pytest.mark.parametrize(("t0", "dt"), [(1e12, 1e-6), (1e9, 1e-3), (-1e9, 1e-3), (1e13, None)])
def test_a_start_time_too_large_for_the_step_is_refused(t0, dt):
    scene = released(2, by=0.05)
    with pytest.raises(
        StvkError, match=rf"t0 = {re.escape(f'{t0:g}')} s; expected an earlier time for steps of dt = .*Count the time from 0"
    ):
        scene.run(VelocityVerlet(dt), t0 + 0.5, t0=t0)
    with pytest.raises(StvkError, match="expected an earlier time"):
        scene.run(EnergyMomentum(dt or 0.03), t0 + 0.5, t0=t0)
    assert scene.run(EnergyMomentum(0.01), 1e6 + 0.1, t0=1e6).success
