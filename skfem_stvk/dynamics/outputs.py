"""What a simulation writes while it runs."""

from __future__ import annotations

import time
from pathlib import Path

from ..results import Fields, Series
from ..statics.stopwatch import Stopwatch
from .checkpoint import Checkpoint
from .ledger import Ledger, LedgerFile
from .plan import Plan


class Outputs:
    """A series of states with the ledger beside it, and the checkpoint: each where it was asked for.

    Parameters
    ----------
    until : the end of the run [s].
    watch : of the run; what is done here is its part "write".

    Attributes
    ----------
    written : how many steps there were at the last checkpoint; below zero if there is none yet.

    Raises
    ------
    StvkError
        if a file cannot be written, before any work.
    """

    def __init__(self, plan: Plan, ledger: Ledger, until: float, watch: Stopwatch) -> None:
        self._plan, self._ledger, self._watch = plan, ledger, watch
        system, outlets = plan.motion.system, plan.outlets
        self._series = self._table = self._checkpoint = None
        self._saved: float | None = None
        self.written = -1
        if outlets.save is not None:
            last = plan.steps - plan.steps % outlets.every
            self._series = Series(
                outlets.save, resume=plan.ledger is not None, until=float(ledger["time"][last]) if plan.ledger else 0.0
            )
            self._fields = Fields(system.mesh, system.elastic_terms)
            self._table = LedgerFile(Path(outlets.save).with_suffix(".csv"), ledger)
        if outlets.checkpoint is not None:
            self._checkpoint = Checkpoint(outlets.checkpoint, system, (plan.state.t, until))

    @property
    def path(self) -> Path | None:
        """Of the series."""
        return None if self._series is None else self._series.path

    def frame(self) -> None:
        """Save the state."""
        state = self._plan.state
        if self._series is not None and self._table is not None and self._saved != state.t:
            with self._watch("write"):
                self._series.add(self._fields.at(state.u, state.v), state.t)
                self._table.write()
            self._saved = state.t

    def step(self) -> None:
        """A whole step is made: save its state if it is its turn, and write a checkpoint if it is time."""
        if self._plan.steps % self._plan.outlets.every == 0:
            self.frame()
        if self._checkpoint is not None and self._checkpoint.due(time.perf_counter()):
            self.checkpoint()

    def checkpoint(self) -> None:
        """Write it now."""
        if self._checkpoint is not None:
            self._plan.seconds = self._watch.parts()
            with self._watch("write"):
                self._checkpoint.write(*self._plan.packed(), self._ledger)
            self.written = self._plan.steps

    def back(self) -> None:
        """The state is an earlier one again: the end of the series and of the table, and what a checkpoint holds."""
        if self._series is not None and self._table is not None:
            with self._watch("write"):
                self._series.cut(self._plan.state.t)
                self._table.write()
            self._saved = None
        if self._plan.steps % self._plan.outlets.every == 0:
            self.frame()
        self.checkpoint()

    def close(self) -> None:
        """The last state, and the checkpoint unless the last step was shorter than the others: a later run goes on from before that."""
        self.frame()
        if self._plan.at_a_step:
            self.checkpoint()
