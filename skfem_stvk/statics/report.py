"""What a static solve prints while it runs."""

from __future__ import annotations

from pathlib import Path

from rich.progress import BarColumn, TimeElapsedColumn

from ..nonlinear.newton import Iterations
from ..nonlinear.progress import Progress
from .history import Attempt, Step


class PathProgress(Progress):
    """A line for each state on standard output; on a terminal also a bar that goes away when the work is done. Nothing if quiet."""

    def __init__(self, header: str, quiet: bool) -> None:
        super().__init__("statics", header, quiet, (BarColumn(), TimeElapsedColumn()))
        self.show(total=1.0)

    def iterating(self, t: float, record: Iterations) -> None:
        """Show that an iteration begins."""
        self.show(description=f"t {t:.4g}, iteration {len(record)}, residual {record.residuals[-1]:.1e}")

    def line(self, outcome: Step | Attempt) -> None:
        """Print a state that was found, now or by the run that is resumed, or a step that has to be cut back."""
        self.print(str(outcome))
        if isinstance(outcome, Step):
            self.show(completed=min(max(outcome.t, 0.0), 1.0))
            for point in outcome.critical:
                self.print(str(point))

    def resumed(self, folder: Path, states: int) -> None:
        """Print that what comes first was found before."""
        self.print(f"kept in {folder}: {states} states")
