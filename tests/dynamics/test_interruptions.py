"""Runs that are interrupted where it hurts."""

import numpy as np
import pytest
from motions import BOTH, MESHES, Scene, driven, kicked, material, reached, velocities

from skfem_stvk import Interrupted, System
from skfem_stvk.dynamics import EnergyMomentum, ForwardEuler, LinearBackwardEuler, Newmark, VelocityVerlet, checkpoint
from skfem_stvk.dynamics.books import Books
from skfem_stvk.dynamics.critical_step import LargestFrequency
from skfem_stvk.dynamics.guards import Guard
from skfem_stvk.dynamics.loop import Cutting
from skfem_stvk.dynamics.outputs import Outputs
from skfem_stvk.dynamics.record import Clock, Reviews, RunRecord
from skfem_stvk.dynamics.stable_step import StableStep

DT, SHORT = 0.01, 0.305
INTEGRATORS = [ForwardEuler(DT), VelocityVerlet(DT), LinearBackwardEuler(DT), EnergyMomentum(DT), Newmark(DT)]


def interrupt_once(owner, method, monkeypatch, number):
    """Ctrl-C comes once, after call `number` of a method."""
    kept, count = getattr(owner, method), 0

    def interrupted(self, *content):
        nonlocal count
        result = kept(self, *content)
        count += 1
        if count == number:
            raise KeyboardInterrupt
        return result

    monkeypatch.setattr(owner, method, interrupted)


def goes_on(scene, integrator, run, path, until):
    """Its last state is one that was entered in the books, and a run from its checkpoint ends as if nothing had been."""
    assert run.ledger["time"][-1] == run.t
    kinetic = run.v @ scene.system.mass().multiply(run.v) / 2
    assert kinetic == pytest.approx(run.ledger["kinetic_energy"][-1], rel=1e-12)
    resumed = reached(scene.system, checkpoint=path, resume=True, until=until)
    whole = scene.run(integrator, until)
    np.testing.assert_array_equal(resumed.ledger.rows(), whole.ledger.rows())
    np.testing.assert_array_equal(resumed.u, whole.u)


#: After the step itself, and after it was entered in the books, whose first row is that of the beginning.
MOMENTS = {"step": (Cutting, "advance", 0), "books": (Books, "enter", 1), "clock": (Clock, "tick", 0)}


#: Clocks count whole steps only.
WITHIN = [(moment, number) for moment in MOMENTS for number in (30, 31) if (moment, number) != ("clock", 31)]


@pytest.mark.parametrize(("moment", "number"), WITHIN)
@pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda one: one.name)
def test_ctrl_c_within_what_belongs_to_a_step_leaves_no_half_of_it(integrator, number, moment, tmp_path, monkeypatch):
    scene, (owner, method, more) = driven(2, damping=BOTH), MOMENTS[moment]
    with monkeypatch.context() as patch:
        interrupt_once(owner, method, patch, number + more)
        with pytest.raises(Interrupted, match=r"checkpoint='.*', resume=True goes on from") as caught:
            scene.run(integrator, SHORT, checkpoint=tmp_path / "c")
    assert 0.19 < caught.value.run.t <= SHORT
    goes_on(scene, integrator, caught.value.run, tmp_path / "c", SHORT)


@pytest.mark.parametrize("number", [30, 31], ids=["whole", "short"])
@pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda one: one.name)
def test_ctrl_c_where_a_support_is_asked_for_leaves_no_half_of_a_step(integrator, number, tmp_path):
    """Explicit integrators have moved the body by then."""
    mesh, asked, hit = MESHES[2], [0.0], []

    def moving(t):
        asked.append(t)
        if not hit and t > (number - 0.9) * DT and 0 < t - asked[-2] < 1.5 * DT:  # step by step, not for a checkpoint's signature
            hit.append(t)
            raise KeyboardInterrupt
        return 0.1 * np.sin(3 * t)

    scene = Scene(System(mesh, material(mesh), prescribed={"left": {"x": moving, "y": 0.0}}), 0.5 * velocities(mesh))
    with pytest.raises(Interrupted, match=r"checkpoint='.*', resume=True goes on from") as caught:
        scene.run(integrator, SHORT, checkpoint=tmp_path / "c")
    assert hit and 0.19 < caught.value.run.t < SHORT
    goes_on(scene, integrator, caught.value.run, tmp_path / "c", SHORT)


#: Where a step is found, and where a motion blows up and goes back: methods, and which calls of them.
FOUND = {
    "look": (Reviews, "estimate", (1, 4, 9)),
    "critical step": (LargestFrequency, "at", (3, 5)),
    "guard": (Guard, "trusts", (19, 20, 45, 60)),
    "good state": (RunRecord, "keep", (2, 3, 4)),
    "halving": (StableStep, "halved", (1,)),
    "way back": (RunRecord, "back", (1,)),
    "files": (Outputs, "back", (1,)),
}


@pytest.mark.filterwarnings("ignore:.*inside out:skfem_stvk.errors.StvkWarning")
@pytest.mark.parametrize(
    ("moment", "number"), [(moment, number) for moment, (_, _, numbers) in FOUND.items() for number in numbers]
)
def test_ctrl_c_where_a_step_is_found_leaves_no_half_of_it(moment, number, tmp_path, monkeypatch):
    """What was seen of the critical step goes with the state."""
    scene, (owner, method, _) = kicked(3), FOUND[moment]
    with monkeypatch.context() as patch:
        patch.setattr(checkpoint, "EVERY", np.inf)
        interrupt_once(owner, method, patch, number)
        with pytest.raises(Interrupted, match=r"checkpoint='.*', resume=True goes on from") as caught:
            scene.run(VelocityVerlet(), 4.0, checkpoint=tmp_path / "c")
    goes_on(scene, VelocityVerlet(), caught.value.run, tmp_path / "c", 4.0)


@pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda one: one.name)
def test_ctrl_c_between_two_steps_loses_none(integrator, tmp_path, monkeypatch):
    scene = driven(2, damping=BOTH)
    with monkeypatch.context() as patch:
        interrupt_once(Outputs, "step", patch, 27)
        with pytest.raises(Interrupted, match=r"checkpoint='.*', resume=True goes on from there") as caught:
            scene.run(integrator, SHORT, checkpoint=tmp_path / "c")
    assert caught.value.run.t == 27 * DT
    goes_on(scene, integrator, caught.value.run, tmp_path / "c", SHORT)


@pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda one: one.name)
def test_a_later_checkpoint_is_kept(integrator, tmp_path, monkeypatch):
    """The last good state is that of 20 steps before, the last checkpoint that of the step before."""
    scene = driven(2, damping=BOTH)
    with monkeypatch.context() as patch:
        patch.setattr(checkpoint, "EVERY", 0.0)
        patch.setattr(checkpoint, "SHARE", np.inf)
        interrupt_once(Cutting, "advance", patch, 30)
        with pytest.raises(Interrupted, match=r"checkpoint='.*', resume=True goes on from the last checkpoint") as caught:
            scene.run(integrator, SHORT, checkpoint=tmp_path / "c")
    assert caught.value.run.t == 20 * DT
    assert checkpoint.load(tmp_path / "c" / "motion.npz").ledger.steps == 30
    goes_on(scene, integrator, caught.value.run, tmp_path / "c", SHORT)
