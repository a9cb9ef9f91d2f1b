"""The report: what was found, as text and as files."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from ..arguments import path
from ..errors import StvkError
from ..results.files import cannot_write, replacing
from ..terminal import CountedProgress, as_text
from .rendering import rendered
from .results import Findings, Task


class Report(Findings):
    """What `verify` found; see `Findings` for its attributes. `print(report)` shows it."""

    def __str__(self) -> str:
        return as_text(rendered(self))

    def save(self, folder: str | Path) -> Path:
        """Write `report.json` and `report.html`, a file that needs no other, into a folder, which is made if it is missing.

        Each is written under another name first and then renamed, so that no file is ever half written.

        Raises
        ------
        StvkError
            if the folder cannot be written to, or a picture cannot be drawn.
        """
        folder = folder_for(folder)
        write(folder / "report.json", json.dumps(self.to_dict(), indent=1))
        write(folder / "report.html", self._page())
        return folder

    def _page(self) -> str:
        try:
            from .plots import page  # matplotlib is imported only when a page is made
        except (ImportError, ValueError) as error:
            raise StvkError(
                f"report.html needs matplotlib, which cannot be imported: {error}. MPLBACKEND = "
                f"{os.environ.get('MPLBACKEND', '')!r}; 'agg' always works. report.json is written."
            ) from error
        return page(self)


def carry_out(
    report: Report, command: str, tasks: Sequence[Task], quiet: bool, then: Mapping[str, Callable[[], None]] | None = None
) -> None:
    """Run tasks, and `then` other steps by their names, with a bar of progress, and add the results to the report.

    Ctrl-C keeps the results so far: tasks that did not run say so, and the other steps are left out.
    """
    steps = then or {}
    with CountedProgress(command, len(tasks) + len(steps), quiet) as progress:
        try:
            for task in tasks:
                progress.step(f"{task.check}: {task.player.name}, {task.quantity}, {task.state}")
                report.results.append(task.run())
            for name, step in steps.items():
                progress.step(name)
                step()
        except KeyboardInterrupt:
            report.interrupted = True
            report.results += [task.missed("interrupted") for task in tasks[len(report.results) :]]


def folder_for(name: str | Path) -> Path:
    """The folder of that name, which is made if it is missing; StvkError if it cannot be."""
    folder = path("folder", name, "the path of a folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(folder, error) from error
    return folder


def write(path: Path, text: str) -> None:
    """Write a file under another name first and then rename it."""
    with replacing(path) as beside:
        beside.write_text(text, encoding="utf-8", errors="backslashreplace")
