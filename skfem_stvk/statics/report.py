"""What a static solve prints while it runs."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from ..nonlinear.newton import Iterations
from .history import Attempt, Step


class Report:
    """A line for each step on standard output; on a terminal also a bar that goes away when the work is done. Nothing if quiet."""

    def __init__(self, header: str, quiet: bool) -> None:
        columns = TextColumn("statics"), BarColumn(), TimeElapsedColumn(), TextColumn("{task.description}")
        console = Console(stderr=True)
        self._bar = Progress(*columns, console=console, transient=True, disable=quiet or not console.is_terminal)
        self._task = self._bar.add_task("", total=1.0)
        self._header, self._quiet = header, quiet

    def __enter__(self) -> Report:
        self._bar.start()
        self._print(self._header)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._bar.stop()

    def iterating(self, t: float, record: Iterations) -> None:
        """An iteration begins."""
        text = f"t {t:.4g}, iteration {len(record)}, residual {record.residuals[-1]:.1e}"
        self._bar.update(self._task, description=text, refresh=True)

    def line(self, outcome: Step | Attempt) -> None:
        """A state was found, now or by the run that is resumed, or a step has to be cut back."""
        if isinstance(outcome, Step):
            self._bar.update(self._task, completed=min(max(outcome.t, 0.0), 1.0))
        self._print(str(outcome))
        if isinstance(outcome, Step):
            for point in outcome.critical:
                self._print(str(point))

    def resumed(self, folder: Path, states: int) -> None:
        """What comes first was found before."""
        self._print(f"kept in {folder}: {states} states")

    def _print(self, line: str) -> None:
        if not self._quiet:
            print(line, flush=True)
