"""Text for a terminal, tables in a uniform style and for notebooks, and the progress of analyses and long commands."""

from __future__ import annotations

import html
import io
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib import import_module
from typing import Any, TypeVar

from rich import box
from rich.console import Console, RenderableType
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, ProgressColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as Bar
from rich.table import Table

from .errors import log, logs, prints

WIDTH = 124
#: Exit codes of the commands: success; a check did not pass, or a solve did not converge; bad input; a scene does not give the
#: expected results; Ctrl-C.
DONE, NOT_PASSED, BAD_INPUT, NOT_AS_EXPECTED, INTERRUPTED = 0, 1, 2, 3, 130
#: Interval between lines of progress without a terminal [s].
LINE_INTERVAL = 5.0
#: Shortest interval between two updates of a bar in a notebook [s].
NOTEBOOK_INTERVAL = 0.1

Entered = TypeVar("Entered", bound="Progress")


def printable(text: str) -> str:
    """Return text that a terminal shows literally: markup and control characters are escaped, and line breaks stay.

    >>> printable("[bold]bracket\\x1b[2J.msh")
    '\\\\[bold]bracket\\\\x1b[2J.msh'
    """
    harmless = (c if c.isprintable() or c == "\n" else c.encode("unicode_escape", "surrogatepass").decode() for c in text)
    return escape("".join(harmless))


def console(width: int | None = None, **options: Any) -> Console:
    """Return a console that prints text without changes; `options` are those of rich.

    The console is as wide as its terminal, or `width` if there is no terminal.

    >>> console(20).print(":cat: 12")
    :cat: 12
    """
    options = {"highlight": False, "emoji": False} | options
    made = Console(**options)
    return made if width is None or made.is_terminal else Console(width=width, **options)


def as_text(renderable: RenderableType, width: int = WIDTH) -> str:
    """Return plain text, without trailing blanks."""
    buffer = io.StringIO()
    console(width, file=buffer, no_color=True).print(renderable)
    return "\n".join(line.rstrip() for line in buffer.getvalue().splitlines()).strip("\n")


def grid(title: str, *columns: str, right: tuple[str, ...] = ()) -> Table:
    """Return a table in the style of this package; the columns named in `right` hold numbers."""
    table = Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, pad_edge=False)
    for column in columns:
        table.add_column(escape(column), justify="right" if column in right else "left", no_wrap=column in right, overflow="fold")
    return table


def say(line: str, quiet: bool) -> None:
    """Print a line unless `quiet`, and log it. A line that cannot be printed does not end the analysis."""
    if not quiet:
        with suppress(OSError):  # a full disk, or a closed pipe
            print(line, flush=True)
    log(line)


def note(text: str) -> None:
    """Print a message of this package on standard error. If it cannot be printed, the work goes on."""
    with suppress(OSError):
        _NoteConsole(stderr=True, highlight=False).print(
            f"{__name__.partition('.')[0]}: {text}", style="dim", markup=False, soft_wrap=True
        )


class _NoteConsole(Console):
    """Console of notes, which does not end the process if its pipe is closed."""

    def on_broken_pipe(self) -> None:
        """Continue without the text."""


class _DroppingFile(io.FileIO):
    """File of a standard stream. Text that it cannot take, on a full disk or in a closed pipe, is dropped without an error."""

    def write(self, data: Any) -> int:
        """Write bytes, and return their number."""
        with suppress(OSError):
            return super().write(data)
        return memoryview(data).nbytes


@contextmanager
def unfailing_output() -> Iterator[None]:
    """Drop text that standard output and standard error cannot take, so that it does not end the work in this block."""
    replaced = {}
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        with suppress(OSError, AttributeError):  # a closed stream, or one in memory, is left as it is
            file = io.BufferedWriter(_DroppingFile(stream.fileno(), "w", closefd=False))
            setattr(sys, name, io.TextIOWrapper(file, stream.encoding, "backslashreplace", line_buffering=True))
            replaced[name] = stream
    try:
        yield
    finally:
        for name, stream in replaced.items():
            getattr(sys, name).flush()
            setattr(sys, name, stream)


class Progress:
    """Progress display: lines on standard output, and on a terminal and in a notebook a temporary bar; nothing if `quiet`.

    The bar shows its name, rich's `columns` and a description; `options` are those of rich's `Progress`. On a terminal it is on
    standard error. In a notebook it is an output of the cell, which needs no widgets. Lines are logged, also if `quiet`.
    """

    def __init__(self, name: str, quiet: bool, columns: tuple[ProgressColumn, ...], **options: Any) -> None:
        self._quiet = quiet or not prints()
        self._reports = not quiet or logs()  # whether lines are printed or logged
        self._bar: Bar | None = None
        self._notebook = False
        self._output: Any = None  # of the cell of a notebook, once the bar is shown there
        self._next_update = 0.0
        console = None if quiet else Console(stderr=True)
        if console is not None and (console.is_terminal or console.is_jupyter):
            self._notebook = console.is_jupyter
            shown = TextColumn(name), *columns, TextColumn("{task.description}")
            self._bar = Bar(*shown, console=console, transient=True, **options)
            self._bar.add_task("")

    def __enter__(self: Entered) -> Entered:
        if self._notebook:
            self._output = import_module("IPython.display").display(self._bar, display_id=True)
        elif self._bar is not None:
            self._bar.start()
        return self

    def __exit__(self, *error: object) -> None:
        if self._output is not None:
            self._output.update({"text/plain": ""}, raw=True)
        elif self._bar is not None:
            self._bar.stop()

    def print(self, line: str) -> None:
        """Print and log a line."""
        say(line, self._quiet)

    def show(self, **changes: Any) -> None:
        """Update and redraw the bar; `changes` are as in rich's `Progress.update`."""
        if self._bar is not None:
            self._bar.update(self._bar.task_ids[0], refresh=True, **changes)
        if self._output is not None and time.monotonic() >= self._next_update:
            self._output.update(self._bar)
            self._next_update = time.monotonic() + NOTEBOOK_INTERVAL


class CountedProgress(Progress):
    """Progress bar that counts `total` work items. With `lines`, lines replace it if there is no terminal, every few seconds."""

    def __init__(self, command: str, total: int, quiet: bool, lines: bool = False) -> None:
        super().__init__(command, quiet, (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn()))
        self.show(total=total)
        self._command, self._total, self._begun, self._lines = command, total, 0, lines and self._bar is None
        self._start = time.perf_counter()
        self._next = self._start + LINE_INTERVAL

    def step(self, description: str) -> None:
        """Show that the next work item begins."""
        self.show(advance=1, description=description)
        self._begun += 1
        now = time.perf_counter()
        if self._lines and now >= self._next:
            self._next = now + LINE_INTERVAL
            self.print(f"{self._command}: {self._begun} of {self._total}, {description}, {duration(now - self._start)}")


def duration(seconds: float) -> str:
    """Return a duration [s] as text with two significant digits or two units.

    >>> duration(0.0123), duration(59.4), duration(192), duration(7500)
    ('0.012 s', '59 s', '3 min 12 s', '2 h 5 min')
    """
    if seconds < 10:
        return f"{seconds:.2g} s"
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"


def html_table(title: str, rows: Iterable[Sequence[Any]], picture: str = "") -> str:
    """Return a table as HTML: the title, rows whose first cell is their name, and the HTML of a picture below.

    >>> html_table("Bar", [("E < 1", 2.5)])
    '<table><caption><b>Bar</b></caption><tr><th>E &lt; 1</th><td>2.5</td></tr></table>'
    """
    cells = (
        [f"<th>{html.escape(str(name))}</th>", *(f"<td>{html.escape(str(value))}</td>" for value in values)]
        for name, *values in rows
    )
    body = "".join(f"<tr>{''.join(row)}</tr>" for row in cells)
    return f"<table><caption><b>{html.escape(title)}</b></caption>{body}</table>{picture}"
