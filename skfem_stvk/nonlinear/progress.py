"""What analyses and long commands print while they run."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping
from math import isnan
from typing import Any, TypeVar

from rich.console import Console
from rich.progress import BarColumn, ProgressColumn, TextColumn
from rich.progress import Progress as Bar

#: Time from one look to the next [s], on a terminal and elsewhere, and over how many of them steps/s are averaged.
REFRESH, LINES, WINDOW = 0.25, 5.0, 10
ENERGIES = {"kinetic": "kinetic_energy", "strain": "strain_energy", "total": "total_energy", "closure error": "closure_error"}

Entered = TypeVar("Entered", bound="Progress")


class Progress:
    """Lines on standard output, and on a terminal a bar on standard error that goes away when the work is done; nothing if quiet.

    The bar has its name, rich's `columns` and a description; `options` are those of rich's `Progress`.
    """

    def __init__(self, name: str, quiet: bool, columns: tuple[ProgressColumn, ...], **options: Any) -> None:
        self._quiet = quiet
        self._bar: Bar | None = None
        console = None if quiet else Console(stderr=True)
        if console is not None and console.is_terminal:
            shown = TextColumn(name), *columns, TextColumn("{task.description}")
            self._bar = Bar(*shown, console=console, transient=True, **options)
            self._bar.add_task("")

    def __enter__(self: Entered) -> Entered:
        if self._bar is not None:
            self._bar.start()
        return self

    def __exit__(self, *error: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def print(self, line: str) -> None:
        """Print a line."""
        if not self._quiet:
            print(line, flush=True)

    def show(self, **changes: Any) -> None:
        """Draw the bar anew, with changes as rich's `Progress.update` takes them."""
        if self._bar is not None:
            self._bar.update(self._bar.task_ids[0], refresh=True, **changes)


class MotionProgress(Progress):
    """On a terminal a bar that is drawn four times a second, elsewhere a line every few seconds; one at the end.

    The last row of the ledger is what is printed; `done` steps were made before, by the run that is resumed.
    """

    def __init__(self, header: str, ledger: Mapping[str, Any], done: int, quiet: bool) -> None:
        super().__init__("dynamics", quiet, (BarColumn(24),), auto_refresh=False)
        self._header, self._ledger, self._every = header, ledger, LINES if self._bar is None else REFRESH
        self._number = self._steps = self._done = done
        self._next = float("inf")

    def __enter__(self) -> MotionProgress:
        if not self._quiet:
            self.print(self._header)
            self._begin = time.perf_counter()
            self._looks = deque([(self._begin, self._done)], maxlen=WINDOW)
            self._next = self._begin + self._every
        return super().__enter__()

    def __exit__(self, *error: object) -> None:
        super().__exit__(*error)
        if self._number > self._done and not self._quiet:
            taken = time.perf_counter() - self._begin
            self.print(self._line((self._number - self._done) / taken, f"took {duration(taken)}"))

    def step(self, number: int, steps: int) -> None:
        """Count a step that is in the ledger: `number` of `steps`, those before this run included."""
        self._number, self._steps = number, steps
        now = time.perf_counter()
        if now >= self._next:
            self._look(now)

    def _look(self, now: float) -> None:
        then, before = self._looks[0]
        rate = (self._number - before) / (now - then)
        self._looks.append((now, self._number))
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
            parts.append(f"t {ledger['time'][-1]:.4g} s")
            parts += [f"{words} {_joules(ledger[name][-1])}" for words, name in ENERGIES.items() if name in ledger]
        return "   ".join(part for part in parts if part)


def _joules(energy: float) -> str:
    """An energy in words; "-" for one that does not exist."""
    return "-" if isnan(energy) else f"{energy:.3g} J"


def duration(seconds: float) -> str:
    """Seconds in words, to two numbers.

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
