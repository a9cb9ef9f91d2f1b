"""Ctrl-C at any line that writes files loses nothing, and no state is ever missing from a series.

With a stride of 1 each line that is run would be tested.
"""

import gc
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from motions import spinning

from skfem_stvk import Interrupted, simulate
from skfem_stvk.results.series import read_list
from skfem_stvk.solvers.dynamics import EnergyMomentum, VelocityVerlet
from skfem_stvk.solvers.dynamics import motion_checkpoint as checkpoint

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
