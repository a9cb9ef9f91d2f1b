"""What a simulation writes while it runs."""

from __future__ import annotations

import time
from pathlib import Path

from ..nonlinear.stopwatch import Stopwatch
from ..results import Fields
from .ledger import Ledger, LedgerFile
from .plan import Plan


class Outputs:
    """A series of states with the ledger beside it, and the checkpoint: each where it was asked for.

    A checkpoint is written after the state that is to be saved at its step, never before: what a later run goes on from has all states saved
    that lie behind it, whatever interrupts this one.

    Parameters
    ----------
    watch : of the run; what is done here is its part "write".

    Attributes
    ----------
    every : steps from one saved state to the next.
    written : how many steps there were at the last checkpoint; below zero if there is none yet.

    Raises
    ------
    StvkError
        if a file cannot be written, before any work.
    """

    def __init__(self, plan: Plan, ledger: Ledger, watch: Stopwatch) -> None:
        self._plan, self._ledger, self._watch = plan, ledger, watch
        self._series, self._checkpoint, self.every = plan.outlets.series, plan.outlets.checkpoint, plan.outlets.every
        self.written = -1
        if self._series is not None:
            system = plan.motion.system
            self._fields = Fields(system.mesh, system.elastic_terms)
            self._table = LedgerFile(self._series.path.with_suffix(".csv"), ledger)

    @property
    def path(self) -> Path | None:
        """Of the series."""
        return None if self._series is None else self._series.path

    def begin(self) -> None:
        """Save the first state; of a run that is resumed, the one that it goes on from, if it is its turn and it is missing."""
        if self._plan.ledger is None:
            self.frame()
        else:
            self._frame_in_turn()

    def frame(self) -> None:
        """Save the state, unless it is saved."""
        series, state = self._series, self._plan.state
        if series is None:
            return
        with self._watch("write"):
            if not series.steps or series.steps[-1][0] < state.t:
                series.add(self._fields.at(state.u, state.v), state.t)
            self._table.write()

    def _frame_in_turn(self) -> None:
        if self._plan.steps % self.every == 0:
            self.frame()

    def step(self) -> None:
        """A whole step is made: save its state if it is its turn, and write a checkpoint if it is time."""
        self._frame_in_turn()
        if self._checkpoint is not None and self._checkpoint.due(time.perf_counter()):
            self.checkpoint()

    def checkpoint(self) -> None:
        """Write it now, after the state if that is to be saved."""
        if self._checkpoint is not None:
            self._frame_in_turn()
            self._plan.seconds = self._watch.parts()
            with self._watch("write"):
                self._checkpoint.write(*self._plan.packed(self._ledger.steps), self._ledger)
            self.written = self._plan.steps

    def back(self) -> None:
        """The state is an earlier one again: the end of the series and of the table, and what a checkpoint holds."""
        if self._series is not None:
            with self._watch("write"):
                self._series.cut(self._plan.state.t)
                self._table.write()
        self._frame_in_turn()
        self.checkpoint()

    def close(self) -> None:
        """The last state, and the checkpoint unless the last step was shorter than the others: a later run goes on from before that."""
        self.frame()
        if self._plan.at_a_step:
            self.checkpoint()
