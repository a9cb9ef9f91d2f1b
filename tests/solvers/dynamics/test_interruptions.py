"""Interrupted runs end in a consistent state and resume exactly."""

import numpy as np
import pytest
from motions import BOTH, MESHES, Scene, driven, kicked, material, reached, velocities

from skfem_stvk import Interrupted, System
from skfem_stvk.solvers.dynamics import EnergyMomentum, ForwardEuler, LinearBackwardEuler, Newmark, VelocityVerlet
from skfem_stvk.solvers.dynamics import motion_checkpoint as checkpoint
from skfem_stvk.solvers.dynamics.critical_step import LargestFrequency
from skfem_stvk.solvers.dynamics.guards import Guard
from skfem_stvk.solvers.dynamics.ledger_rows import LedgerWriter
from skfem_stvk.solvers.dynamics.motion_outputs import Outputs
from skfem_stvk.solvers.dynamics.record import Clock, Reviews, RunRecord
from skfem_stvk.solvers.dynamics.stable_step import StableStep
from skfem_stvk.solvers.dynamics.steps import Steps

DT, SHORT = 0.01, 0.305
INTEGRATORS = [ForwardEuler(DT), VelocityVerlet(DT), LinearBackwardEuler(DT), EnergyMomentum(DT), Newmark(DT)]


def interrupt_once(owner, method, monkeypatch, number):
    """Raise KeyboardInterrupt once, after call `number` of a method."""
    kept, count = getattr(owner, method), 0

    def interrupted(self, *content):
        nonlocal count
        result = kept(self, *content)
        count += 1
        if count == number:
            raise KeyboardInterrupt
        return result

    monkeypatch.setattr(owner, method, interrupted)


def assert_resumes(scene, integrator, run, path, until):
    """Assert that the last state is in the ledger, and that the resumed run equals an uninterrupted run."""
    assert run.ledger["time"][-1] == run.t
    kinetic = run.v @ scene.system.mass().multiply(run.v) / 2
    assert kinetic == pytest.approx(run.ledger["kinetic_energy"][-1], rel=1e-12)
    resumed = reached(scene.system, checkpoint=path, resume=True, until=until)
    whole = scene.run(integrator, until)
    np.testing.assert_array_equal(resumed.ledger.rows(), whole.ledger.rows())
    np.testing.assert_array_equal(resumed.u, whole.u)


#: The moments are after the step, after its ledger row (the first row is the initial state), and after the clock.
MOMENTS = {"step": (Steps, "_bisected", 0), "ledger": (LedgerWriter, "append_row", 1), "clock": (Clock, "tick", 0)}


#: Clocks count only whole steps.
WITHIN = [(moment, number) for moment in MOMENTS for number in (30, 31) if (moment, number) != ("clock", 31)]


@pytest.mark.few
@pytest.mark.parametrize(("moment", "number"), WITHIN)
@pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda one: one.name)
def test_ctrl_c_within_a_step_leaves_a_whole_step(integrator, number, moment, tmp_path, monkeypatch):
    scene, (owner, method, more) = driven(2, damping=BOTH), MOMENTS[moment]
    with monkeypatch.context() as patch:
        interrupt_once(owner, method, patch, number + more)
        with pytest.raises(Interrupted, match=r"To continue from .*: checkpoint='.*', resume=True") as caught:
            scene.run(integrator, SHORT, checkpoint=tmp_path / "c")
    assert 0.19 < caught.value.run.t <= SHORT
    assert_resumes(scene, integrator, caught.value.run, tmp_path / "c", SHORT)


@pytest.mark.few
@pytest.mark.parametrize("number", [30, 31], ids=["whole", "short"])
@pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda one: one.name)
def test_ctrl_c_in_a_function_of_a_support_leaves_a_whole_step(integrator, number, tmp_path):
    """At this moment explicit integrators have already moved the body."""
    mesh, asked, hit = MESHES[2], [0.0], []

    def moving(t):
        asked.append(t)
        if not hit and t > (number - 0.9) * DT and 0 < t - asked[-2] < 1.5 * DT:  # not for the signature of a checkpoint
            hit.append(t)
            raise KeyboardInterrupt
        return 0.1 * np.sin(3 * t)

    scene = Scene(System(mesh, material(mesh), prescribed={"left": {"x": moving, "y": 0.0}}), 0.5 * velocities(mesh))
    with pytest.raises(Interrupted, match=r"To continue from .*: checkpoint='.*', resume=True") as caught:
        scene.run(integrator, SHORT, checkpoint=tmp_path / "c")
    assert hit and 0.19 < caught.value.run.t < SHORT
    assert_resumes(scene, integrator, caught.value.run, tmp_path / "c", SHORT)


#: Moments at which a step size is found, or a motion blows up and goes back: methods, and numbers of their calls.
FOUND = {
    "look": (Reviews, "estimate", (1, 4, 9)),
    "critical step": (LargestFrequency, "at", (3, 5)),
    "guard": (Guard, "is_good", (19, 20, 45, 60)),
    "good state": (RunRecord, "store_good_state", (2, 3, 4)),
    "halving": (StableStep, "halved", (1,)),
    "way back": (RunRecord, "return_to_good_state", (1,)),
    "files": (Outputs, "discard_later_states", (1,)),
}


@pytest.mark.few
@pytest.mark.filterwarnings("ignore:.*inverted:skfem_stvk.errors.StvkWarning")
@pytest.mark.parametrize(
    ("moment", "number"), [(moment, number) for moment, (_, _, numbers) in FOUND.items() for number in numbers]
)
def test_ctrl_c_during_step_size_control_leaves_a_whole_step(moment, number, tmp_path, monkeypatch):
    """The state includes the data about the critical step."""
    scene, (owner, method, _) = kicked(3), FOUND[moment]
    with monkeypatch.context() as patch:
        patch.setattr(checkpoint, "EVERY", np.inf)
        interrupt_once(owner, method, patch, number)
        with pytest.raises(Interrupted, match=r"To continue from .*: checkpoint='.*', resume=True") as caught:
            scene.run(VelocityVerlet(), 4.0, checkpoint=tmp_path / "c")
    assert_resumes(scene, VelocityVerlet(), caught.value.run, tmp_path / "c", 4.0)


@pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda one: one.name)
def test_ctrl_c_between_two_steps_loses_no_step(integrator, tmp_path, monkeypatch):
    scene = driven(2, damping=BOTH)
    with monkeypatch.context() as patch:
        interrupt_once(Outputs, "step", patch, 27)
        with pytest.raises(Interrupted, match=r"To continue from there: checkpoint='.*', resume=True") as caught:
            scene.run(integrator, SHORT, checkpoint=tmp_path / "c")
    assert caught.value.run.t == 27 * DT
    assert_resumes(scene, integrator, caught.value.run, tmp_path / "c", SHORT)


@pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda one: one.name)
def test_a_checkpoint_later_than_the_good_state_is_retained(integrator, tmp_path, monkeypatch):
    """The last good state is 20 steps old, and the last checkpoint is one step old."""
    scene = driven(2, damping=BOTH)
    with monkeypatch.context() as patch:
        patch.setattr(checkpoint, "EVERY", 0.0)
        patch.setattr(checkpoint, "SHARE", np.inf)
        interrupt_once(Steps, "_bisected", patch, 30)
        with pytest.raises(Interrupted, match=r"To continue from the last checkpoint: checkpoint='.*', resume=True") as caught:
            scene.run(integrator, SHORT, checkpoint=tmp_path / "c")
    assert caught.value.run.t == 20 * DT
    assert checkpoint.load(tmp_path / "c" / "motion.npz").ledger.steps == 30
    assert_resumes(scene, integrator, caught.value.run, tmp_path / "c", SHORT)
