"""The progress of a long command."""

from __future__ import annotations

from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as Bar


class Progress:
    """A bar on standard error that goes away when the work is done; nothing if quiet or not on a terminal."""

    def __init__(self, command: str, total: int, quiet: bool) -> None:
        columns = TextColumn(command), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.description}")
        console = Console(stderr=True)
        self._bar = Bar(*columns, console=console, transient=True, disable=quiet or not console.is_terminal)
        self._task = self._bar.add_task("", total=total)

    def __enter__(self) -> Progress:
        self._bar.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._bar.stop()

    def step(self, description: str) -> None:
        """One more piece of work begins."""
        self._bar.update(self._task, advance=1, description=description)
