"""Output of a static solve while it runs: lines and a progress bar, a series of states, and the checkpoint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from rich.progress import BarColumn, TimeElapsedColumn

from ...space import Space
from ...system import System
from ...system.signature import Fingerprint
from ...terminal import Progress
from ...terms.loads.load import Moment
from ..newton.newton import Iterations
from ..runs.outputs import OutputFiles, StateSeries
from .history import Attempt, Step
from .path_checkpoint import PathCheckpoint

#: Load factors at which loads and prescribed displacements are evaluated to identify a problem.
MOMENTS = 0.5, 1.0


class PathOutputs:
    """Series and checkpoint of a path, each only if requested, and locked against other writers until the end of `stack`."""

    def __init__(
        self, files: OutputFiles, system: System, method: dict[str, Any], start: Mapping[str, Sequence[float]], stack: ExitStack
    ) -> None:
        problem = Fingerprint("path of equilibria", system, method, MOMENTS, start)
        self._system, self.checkpoint, self._series = system, None, None
        if files.checkpoint is not None:
            self.checkpoint = stack.enter_context(PathCheckpoint(files.checkpoint, system, problem, files))
        if files.save is not None:
            self._series = stack.enter_context(StateSeries(files.save, system, problem, files))

    def save(self, t: float, step: Step, moment: Moment) -> None:
        """Write a state at a moment of its step to the series, as that of `t`."""
        if self._series is not None:
            self._series.add_state(t, self._system, step.u, moment)


class PathProgress(Progress):
    """Progress of a path: a line for each state on standard output, and on a terminal a temporary bar; nothing if `quiet`."""

    def __init__(self, header: str, quiet: bool, space: Space) -> None:
        super().__init__("statics", quiet, (BarColumn(), TimeElapsedColumn()))
        self._space = space
        self.show(total=1.0)
        self.print(header)

    def iterating(self, t: float, record: Iterations) -> None:
        """Show the beginning of an iteration."""
        self.show(description=f"t {t:.4g}, iteration {len(record)}, residual {record.residuals[-1]:.1e}")

    def line(self, outcome: Step | Attempt) -> None:
        """Print a state that was found, now or by the resumed run, or a failed step."""
        self.print(outcome.line(self._space.comm.most(outcome.largest)) if isinstance(outcome, Step) else str(outcome))
        if isinstance(outcome, Step):
            self.show(completed=min(max(outcome.t, 0.0), 1.0))
            for point in outcome.critical:
                self.print(str(point))

    def resumed(self, folder: Path, states: int) -> None:
        """Print that the first states come from an earlier run."""
        self.print(f"read from {folder}: {states} states")
