"""Interrupted runs end in a consistent state and resume exactly, also after Ctrl-C at any line that writes files."""

import gc
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from motions import BOTH, MESHES, Scene, driven, kicked, material, reached, spinning, velocities

from skfem_stvk import Interrupted, System, simulate
from skfem_stvk.results.series import read_list
from skfem_stvk.solvers.dynamics import EnergyMomentum, ForwardEuler, LinearBackwardEuler, Newmark, VelocityVerlet
from skfem_stvk.solvers.dynamics import motion_checkpoint as checkpoint
from skfem_stvk.solvers.dynamics.critical_step import LargestFrequency
from skfem_stvk.solvers.dynamics.guards import Guard
from skfem_stvk.solvers.dynamics.ledger_rows import LedgerWriter
from skfem_stvk.solvers.dynamics.motion_outputs import Outputs
from skfem_stvk.solvers.dynamics.record import Clock, Reviews, RunRecord
from skfem_stvk.solvers.dynamics.steps import StableStep, Steps

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
WITHIN = [(integrator, *one) for integrator in INTEGRATORS for one in WITHIN]
#: Implicit integrators change the velocities first, and the displacements last.
for one in INTEGRATORS[2:4]:
    MOMENTS[f"velocities, {one.name}"] = (type(one), "update", 30 * one.mean)  # once more per step, for supports that move
    WITHIN.append((one, f"velocities, {one.name}", 30))


@pytest.mark.few
@pytest.mark.parametrize(("integrator", "moment", "number"), WITHIN, ids=lambda one: getattr(one, "name", None))
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


#: Modules of this package that write during a run.
WRITERS = (
    "motion_outputs.py",
    "series.py",
    "complete_files.py",
    "ledger.py",
    "motion_checkpoint.py",
    "archive.py",
    "vtu.py",
)
STEPS, EVERY = 2, 2


class CtrlC:
    """Context that raises KeyboardInterrupt at line `number` of the writers, or records all their lines if `number` is None."""

    def __init__(self, number=None):
        self.number, self.lines = number, []

    def __enter__(self):
        sys.settrace(self._call)
        return self

    def __exit__(self, *_):
        sys.settrace(None)

    def _call(self, frame, event, argument):
        path = Path(frame.f_code.co_filename)
        return self._line if path.name in WRITERS and "skfem_stvk" in path.parts else None

    def _line(self, frame, event, argument):
        if event == "line":
            self.lines.append((frame.f_code.co_filename, frame.f_lineno))
            if len(self.lines) == self.number:
                sys.settrace(None)
                raise KeyboardInterrupt
        return self._line

    def last_times(self):
        """Return the number at which each line is run for the last time."""
        return sorted({line: number for number, line in enumerate(self.lines, 1)}.values())


def motion(folder, integrator, steps=STEPS, **options):
    scene = spinning(2)
    files = {"save": folder / "run.pvd", "every": EVERY, "checkpoint": folder / "run"}
    return simulate(scene.system, integrator, until=steps * 0.01, v0=scene.v0, quiet=True, **files, **options)


def written(folder):
    """Return all files of a run, and the contents of files that do not depend on when they were written."""
    files = {str(file.relative_to(folder)): file for file in folder.rglob("*") if file.is_file()}
    contents = {name: file.read_bytes() for name, file in files.items() if file.suffix in (".vtu", ".csv")}
    return dict.fromkeys(files) | contents, read_list(folder / "run.pvd")


@pytest.fixture
def each_step(monkeypatch):
    """Write a checkpoint at each step."""
    monkeypatch.setattr(checkpoint, "EVERY", 0.0)
    monkeypatch.setattr(checkpoint, "SHARE", np.inf)


@pytest.mark.slow
@pytest.mark.parametrize(("integrator", "stride"), [(VelocityVerlet(0.01), 13), (EnergyMomentum(0.01), 41)])
def test_ctrl_c_at_any_line_that_writes_leaves_a_motion_that_resumes_exactly(integrator, stride, tmp_path, each_step):
    (tmp_path / "whole").mkdir()
    whole = motion(tmp_path / "whole", integrator, STEPS + 1)
    expected, interrupted = written(tmp_path / "whole"), 0
    (tmp_path / "all").mkdir()
    with CtrlC() as noted:
        motion(tmp_path / "all", integrator)
    numbers = noted.last_times()[::stride]
    assert len(numbers) * stride > 250
    for number in numbers:
        folder = tmp_path / str(number)
        folder.mkdir()
        try:
            with CtrlC(number):
                motion(folder, integrator)
        except KeyboardInterrupt as error:
            interrupted += isinstance(error, Interrupted)
        gc.collect()  # a lock whose release was interrupted is freed with the frames of the error
        again = motion(folder, integrator, STEPS + 1, resume=True)
        np.testing.assert_array_equal(again.ledger.rows(), whole.ledger.rows())
        assert written(folder) == expected, f"line {number}"
        shutil.rmtree(folder)
    assert interrupted > 0.3 * len(numbers)
