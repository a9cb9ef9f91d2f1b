"""What a simulation prints while it runs."""

from __future__ import annotations

import time
from collections import deque
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, TextColumn
from rich.progress import Progress as Bar

from .ledger import Ledger

#: Time from one look to the next [s], on a terminal and elsewhere, and over how many of them steps/s are averaged.
REFRESH, LINES, WINDOW = 0.25, 5.0, 10
ENERGIES = {"kinetic": "kinetic_energy", "strain": "strain_energy", "total": "total_energy", "closure error": "closure_error"}


class Progress:
    """On a terminal a bar that goes away when the work is done, elsewhere a line every few seconds; one at the end. Nothing if quiet.

    Parameters
    ----------
    header : the first line.
    ledger : of the motion; its last row is what is told.
    done : steps that were made before, by the run that is resumed.
    quiet : print nothing.
    """

    def __init__(self, header: str, ledger: Ledger, done: int, quiet: bool) -> None:
        console = Console(stderr=True)
        columns = TextColumn("dynamics"), BarColumn(24), TextColumn("{task.description}")
        disabled = quiet or not console.is_terminal
        self._bar = Bar(*columns, console=console, transient=True, auto_refresh=False, disable=disabled)
        self._task = self._bar.add_task("")
        self._header, self._ledger, self._quiet = header, ledger, quiet
        self._every = LINES if disabled else REFRESH
        self._number = self._steps = self._done = done
        self._next = float("inf")

    def __enter__(self) -> Progress:
        if not self._quiet:
            print(self._header, flush=True)
            self._begin = time.perf_counter()
            self._looks = deque([(self._begin, self._done)], maxlen=WINDOW)
            self._next = self._begin + self._every
            self._bar.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._bar.stop()
        if self._number > self._done and not self._quiet:
            taken = time.perf_counter() - self._begin
            rate = (self._number - self._done) / taken
            print(self._line(rate, f"took {duration(taken)}"), flush=True)

    def step(self, number: int, steps: int) -> None:
        """Step `number` of `steps` is made, those before this run counted too, and in the ledger."""
        self._number, self._steps = number, steps
        now = time.perf_counter()
        if now >= self._next:
            self._look(now)

    def _look(self, now: float) -> None:
        then, before = self._looks[0]
        rate = (self._number - before) / (now - then)
        self._looks.append((now, self._number))
        line = self._line(rate, f"{duration((self._steps - self._number) / rate)} left" if rate else "")
        if self._bar.disable:
            print(line, flush=True)
        else:
            self._bar.update(self._task, completed=self._number, total=self._steps, description=line, refresh=True)
        self._next = now + self._every

    def _line(self, rate: float, end: str) -> str:
        ledger = self._ledger
        speed = f"{rate:,.0f} steps/s" if rate >= 100 else f"{rate:.3g} steps/s"
        parts = [f"step {self._number}/{self._steps}", speed, end]
        if ledger.steps:
            parts.append(f"t {ledger['time'][-1]:.4g} s")
            parts += [f"{words} {ledger[name][-1]:.3g} J" for words, name in ENERGIES.items() if name in ledger]
        return "   ".join(part for part in parts if part)


def duration(seconds: float) -> str:
    """In words, to two numbers.

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
