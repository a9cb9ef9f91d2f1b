"""Ctrl-C at lines all over what writes files (a stride of 1 takes each that is run): nothing is lost, and no state is ever missing
from a series.
"""

import gc
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from motions import spinning

from skfem_stvk import Interrupted, simulate
from skfem_stvk.dynamics import EnergyMomentum, VelocityVerlet, checkpoint
from skfem_stvk.results.series import read_list

#: Of this package, what writes while a run goes.
WRITERS = (
    "outputs.py",
    "series.py",
    "files.py",
    "ledger.py",
    "checkpoint.py",
    "store.py",
    "vtu.py",
    "one_writer.py",
)
STEPS, EVERY = 2, 2


class CtrlC:
    """Raises KeyboardInterrupt at line `number` of those that the writers run; notes them all if there is none."""

    def __init__(self, number=None):
        self.number, self.lines = number, []

    def __enter__(self):
        sys.settrace(self._call)
        return self

    def __exit__(self, *_):
        sys.settrace(None)

    def _call(self, frame, event, argument):
        path = Path(frame.f_code.co_filename)
        return self._line if path.name in WRITERS and path.parent.parent.name == "skfem_stvk" else None

    def _line(self, frame, event, argument):
        if event == "line":
            self.lines.append((frame.f_code.co_filename, frame.f_lineno))
            if len(self.lines) == self.number:
                sys.settrace(None)
                raise KeyboardInterrupt
        return self._line

    def last_times(self):
        """The number at which each line is run for the last time."""
        return sorted({line: number for number, line in enumerate(self.lines, 1)}.values())


def motion(folder, integrator, steps=STEPS, **options):
    scene = spinning(2)
    files = {"save": folder / "run.pvd", "every": EVERY, "checkpoint": folder / "run"}
    return simulate(scene.system, integrator, until=steps * 0.01, v0=scene.v0, quiet=True, **files, **options)


def written(folder):
    """All files of a run, and what those hold that are to be the same whenever they were written."""
    files = {str(file.relative_to(folder)): file for file in folder.rglob("*") if file.is_file()}
    held = {name: file.read_bytes() for name, file in files.items() if file.suffix in (".vtu", ".csv")}
    return dict.fromkeys(files) | held, read_list(folder / "run.pvd")


@pytest.fixture
def each_step(monkeypatch):
    """A checkpoint each step."""
    monkeypatch.setattr(checkpoint, "EVERY", 0.0)
    monkeypatch.setattr(checkpoint, "SHARE", np.inf)


@pytest.mark.slow
@pytest.mark.parametrize(("integrator", "stride"), [(VelocityVerlet(0.01), 13), (EnergyMomentum(0.01), 41)])
def test_ctrl_c_at_lines_that_write_leaves_a_motion_that_goes_on_whole(integrator, stride, tmp_path, each_step):
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
        gc.collect()  # a lock whose giving back was interrupted goes with the frames of the error
        again = motion(folder, integrator, STEPS + 1, resume=True)
        np.testing.assert_array_equal(again.ledger.rows(), whole.ledger.rows())
        assert written(folder) == expected, f"line {number}"
        shutil.rmtree(folder)
    assert interrupted > 0.3 * len(numbers)
