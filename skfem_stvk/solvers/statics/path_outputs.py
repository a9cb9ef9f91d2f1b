"""Output of a static solve while it runs: lines and a progress bar, a series of states, and the checkpoint."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from rich.progress import BarColumn, TimeElapsedColumn

from ...results import Fields, Series
from ...results.complete_files import OutputFiles
from ...results.contact_forces import contact_states
from ...space import Space
from ...system import System
from ...system.signature import Fingerprint
from ...terminal import Progress
from ...terms.loads.load import Moment
from ..newton.newton import Iterations
from .history import Attempt, Step

if TYPE_CHECKING:
    from .path_checkpoint import PathCheckpoint

Write: TypeAlias = Callable[[float, Step, Moment], object]

#: Load factors at which loads and prescribed displacements are evaluated to identify a problem.
MOMENTS = 0.5, 1.0


@contextmanager
def opened(
    output_files: OutputFiles, system: System, options: dict[str, Any], start: Mapping[str, Sequence[float]]
) -> Iterator[tuple[Write, PathCheckpoint | None]]:
    """Yield a function that writes a state to the series, and the checkpoint; each only if requested.

    Both are locked against other writers.
    """
    with ExitStack() as stack:
        write, checkpoint = _nothing, None
        if output_files.save is not None or output_files.checkpoint is not None:
            problem = Fingerprint("path of equilibria", system, options, MOMENTS, start)
        if output_files.checkpoint is not None:
            from .path_checkpoint import PathCheckpoint  # imports pydantic, needed only for checkpoints

            checkpoint = stack.enter_context(PathCheckpoint(output_files.checkpoint, system, problem, output_files))
        if output_files.save is not None:
            series = stack.enter_context(
                Series(
                    output_files.save, output_files.fields, problem=problem, overwrite=output_files.overwrite, space=system.space
                )
            )
            write = partial(_add, series, Fields.of(system), system)
        yield write, checkpoint


def _add(series: Series, fields: Fields, system: System, t: float, step: Step, moment: Moment) -> None:
    series.add(fields.at(step.u, contacts=contact_states(system, step.u, moment)), t)


def _nothing(t: float, step: Step, moment: Moment) -> None:
    """Write nothing, because no series was requested."""


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
