"""Output of a simulation while it runs: a series of states with the ledger next to it, a checkpoint, and its progress."""

from __future__ import annotations

import os
import time
from collections import deque
from contextlib import ExitStack, suppress
from functools import partial
from math import isnan
from pathlib import Path

from rich.progress import BarColumn

from ...errors import StvkError, warn
from ...results.complete_files import of_leader
from ...system import System
from ...system.signature import Fingerprint
from ...terminal import LINE_INTERVAL, Progress, duration
from ...units import UnitSystem
from ..runs.ledger import Ledger, LedgerFile
from ..runs.outputs import StateSeries
from .motion_checkpoint import MotionCheckpoint, SavedMotion
from .motion_setup import Options, Setup
from .record import RunRecord

#: Default number of steps from one saved state to the next.
EVERY = 10
#: Number of steps that no run reaches.
NEVER = 1 << 62

#: Interval between two updates of a bar [s], and number of updates over which steps/s are averaged.
REFRESH, WINDOW = 0.25, 10
ENERGIES = {"kinetic": "kinetic_energy", "strain": "strain_energy", "total": "total_energy", "closure error": "closure_error"}


class Outputs:
    """Files of a run: the states, the ledger and the checkpoint, as far as they were requested.

    If a step saves a state, its checkpoint is written after this state, never before. Hence the series contains all states before
    the checkpoint, whatever interrupts the run. The record of the run is only read. Its stopwatch counts the time of these methods
    as "write".
    """

    def __init__(
        self,
        setup: Setup,
        record: RunRecord,
        series: StateSeries | None = None,
        every: int = EVERY,
        checkpoint: MotionCheckpoint | None = None,
    ) -> None:
        self._setup, self._record = setup, record
        self._series, self._every, self._checkpoint = series, every, checkpoint
        self.written = -1  # steps at the last checkpoint; negative if there is none yet
        if series is not None:
            table = LedgerFile(series.path.with_suffix(".csv"), record.ledger)
            self._write_table = partial(of_leader, series.comm, table.write)

    @classmethod
    def opened(
        cls,
        setup: Setup,
        record: RunRecord,
        options: Options,
        stack: ExitStack,
        problem: Fingerprint | None = None,
        then: SavedMotion | None = None,
    ) -> Outputs:
        """Open the files of a run until the end of `stack`. Refuse files of another problem.

        A run that continues has the problem of its checkpoint, and its content `then`. Its series is at the user-supplied path, or
        next to the checkpoint.
        """
        files, checkpoint, series, system = options.output_files, options.checkpoint, None, setup.motion.system
        save, every, resumed = files.save, files.every or (EVERY if then is None else then.every), {}
        if problem is None:
            problem = setup.problem(record.state.t, options.start(system))
            if setup.rule is not None and (save or checkpoint):
                assert problem.signature  # computed now, before elements are removed
        if checkpoint is not None:
            checkpoint.belongs_to(problem, files.overwrite)
        if then is not None and checkpoint is not None:
            save = save or _series_next_to(then, checkpoint.folder, system.units.of("s"))
            if save is not None:
                _warn_of_new_series(then, save, system)
            resumed = {"resume": True, "until": float(record.ledger["time"][record.steps - record.steps % every])}
        if save is not None:
            series = stack.enter_context(StateSeries(save, system, problem, files, **resumed))
            if then is not None and every == then.every:
                _warn_of_missing_state(series, resumed["until"], record.state.t, system)
        return cls(setup, record, series, every, checkpoint)

    @property
    def path(self) -> Path | None:
        """Path of the series; None without one."""
        return None if self._series is None else self._series.path

    @property
    def saved_every(self) -> int:
        """Number of steps from one saved state to the next; larger than any run if no states are saved."""
        return NEVER if self._series is None else self._every

    def save_state(self) -> None:
        """Save the state unless it is already saved, and update the ledger's table."""
        series, state = self._series, self._record.state
        if series is None:
            return
        with self._record.watch("write"):
            if not series.steps or series.steps[-1][0] < state.t:
                motion = self._setup.motion
                u, v = (motion.states.expand(x) for x in (state.u, state.v))
                series.add_state(state.t, motion.system, u, motion.moment(state.t), v, state.forces)
            self._write_table()

    def save_if_due(self) -> None:
        """Save the state if it is due at this step.

        This includes the first state of a run, and the state from which a run continues if it was not saved.
        """
        if self._record.steps % self._every == 0:
            self.save_state()

    def step(self) -> None:
        """Save the state after a whole step if it is due, and write a checkpoint if it is due."""
        self.save_if_due()
        space = self._setup.motion.system.space
        if self._checkpoint is not None and space.comm.any(space.comm.leads and self._checkpoint.due(time.perf_counter())):
            self.checkpoint()

    def checkpoint(self) -> None:
        """Write the checkpoint now, after saving the state if that is due."""
        if self._checkpoint is None:
            return
        self.save_if_due()
        record, setup, seconds = self._record, self._setup, self._record.watch.parts()
        with self._record.watch("write"):
            save, found = None if self._series is None else str(self._series.path), setup.integrator.dt is None
            others = {"seconds": seconds, "every": self._every, "save": save}
            self._checkpoint.replace(SavedMotion.of(record, setup.locations, setup.motion.system.mesh, found=found, **others))
        self.written = record.steps

    def discard_later_states(self) -> None:
        """Remove the saved states and rows after the present state, which is an earlier one again."""
        if self._series is not None:
            with self._record.watch("write"):
                self._series.cut(self._record.state.t)
                self._write_table()
        self.save_if_due()
        self.checkpoint()

    def close(self) -> None:
        """Write the last state and the checkpoint.

        If the last step was shorter than `dt`, the checkpoint before it remains, so that a later run continues from there.
        """
        self.save_state()
        if self._record.after_whole_step:
            self.checkpoint()

    def resume_advice(self, error: BaseException) -> str:
        """Write a checkpoint after an error, and return a message about how to continue from it.

        No checkpoint is written if a later one exists or the disk is full.
        """
        if self._checkpoint is None:
            return ""
        record, full = self._record, isinstance(error, OSError)  # after a full disk, a state may be missing from the series
        if record.after_whole_step and record.steps > self.written and not full:
            with suppress(Exception):
                self.checkpoint()
        if self.written < 0:
            return ""
        there = "there" if self.written == record.steps else "the last checkpoint"
        return f" To continue from {there}: checkpoint={str(self._checkpoint.folder)!r}, resume=True."


def _warn_of_new_series(then: SavedMotion, save: Path, system: System) -> None:
    """Warn if the series of a resumed run does not exist at its path, so that earlier states are elsewhere."""
    if then.save is not None and not save.exists():
        warn(
            f"{save} does not exist, so it begins at t = {then.state.t:g} {system.units.of('s')}. Earlier states are in the series "
            f"of the run that is resumed, {then.save!r}."
        )


def _warn_of_missing_state(series: StateSeries, last: float, t: float, system: System) -> None:
    """Warn if the series of a resumed run at time `t` lacks its last state before, at the time `last`."""
    if series.steps and series.steps[-1][0] < last < t:
        s = system.units.of("s")
        warn(f"{series.path} ends at t = {series.steps[-1][0]:g} {s}: its state at {last:g} {s} is missing and cannot be restored.")


def _series_next_to(then: SavedMotion, folder: Path, unit: str) -> Path | None:
    """Return the path of a run's series: its file name, in the folder that contains the checkpoint."""
    if then.save is None:
        return None
    save = Path(os.path.abspath(folder)).parent / Path(then.save).name
    if not save.is_file() or save.suffix.lower() != ".pvd":
        raise StvkError(
            f"The run of the checkpoint {folder} saved the series {then.save!r}, but there is no {save.name} in {save.parent}. "
            f"Move the series there, or name its path, or that of a new series from t = {then.state.t:g} {unit} on: save=..."
        )
    return save


class MotionProgress(Progress):
    """Progress display: on a terminal or in a notebook a bar; elsewhere a line every few seconds; and a final line.

    It prints the last row of the ledger. A resumed run made `done` steps before.
    """

    def __init__(self, header: str, ledger: Ledger, done: int, quiet: bool) -> None:
        super().__init__("dynamics", quiet, (BarColumn(24),), auto_refresh=False)
        self._header, self._ledger, self._every = header, ledger, LINE_INTERVAL if self._bar is None else REFRESH
        self._number = self._steps = self._done = done
        self._next = float("inf")

    def __enter__(self) -> MotionProgress:
        if self._reports:
            self.print(self._header)
            self._begin = time.perf_counter()
            self._updates = deque([(self._begin, self._done)], maxlen=WINDOW)
            self._next = self._begin + self._every
        return super().__enter__()

    def __exit__(self, *error: object) -> None:
        super().__exit__(*error)
        if self._number > self._done and self._reports:
            taken = time.perf_counter() - self._begin
            self.print(self._line((self._number - self._done) / taken, f"took {duration(taken)}"))

    def step(self, number: int, steps: int) -> None:
        """Count a recorded step: `number` of `steps`, including those before this run."""
        self._number, self._steps = number, steps
        now = time.perf_counter()
        if now >= self._next:
            self._update(now)

    def _update(self, now: float) -> None:
        then, before = self._updates[0]
        rate = (self._number - before) / (now - then)
        self._updates.append((now, self._number))
        line = self._line(rate, f"{duration((self._steps - self._number) / rate)} left" if rate else "")
        if self._bar is None:
            self.print(line)
        else:
            self.show(completed=self._number, total=self._steps, description=line)
        self._next = now + self._every

    def _line(self, rate: float, end: str) -> str:
        ledger = self._ledger
        speed = f"{rate:,.0f} steps/s" if rate >= 100 else f"{rate:.3g} steps/s"
        parts = [f"step {self._number}/{self._steps}", speed, end]
        if len(ledger["time"]):
            parts.append(f"t {ledger['time'][-1]:.4g} {ledger.units.of('s')}")
            parts += [f"{words} {_energy(ledger[name][-1], ledger.units)}" for words, name in ENERGIES.items() if name in ledger]
        return "   ".join(part for part in parts if part)


def _energy(energy: float, units: UnitSystem) -> str:
    """Return an energy as text; "-" for one that does not exist."""
    return "-" if isnan(energy) else f"{energy:.3g} {units.of('J')}"
