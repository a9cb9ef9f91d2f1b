"""Motions that blow up with a step that was found continue from the last good state, with shorter steps."""

import re

import numpy as np
import pytest
from motions import MESHES, kicked, material, pushed, reached, released, velocities

from skfem_stvk import NodalLoad, StvkError, StvkWarning, System, VolumePenalty, simulate
from skfem_stvk.results.series import read_list
from skfem_stvk.solvers.dynamics import EnergyMomentum, ForwardEuler, Status, VelocityVerlet, guards
from skfem_stvk.solvers.dynamics.loop import Loop
from skfem_stvk.solvers.dynamics.motion_checkpoint import load

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
