"""Progress of a simulation."""

from __future__ import annotations

import time
from collections import deque
from math import isnan

from rich.progress import BarColumn

from ...terminal import LINE_INTERVAL, Progress, duration
from ...units import UnitSystem
from ..runs.ledger import Ledger

#: Interval between two updates of a bar [s], and number of updates over which steps/s are averaged.
REFRESH, WINDOW = 0.25, 10
ENERGIES = {"kinetic": "kinetic_energy", "strain": "strain_energy", "total": "total_energy", "closure error": "closure_error"}


class MotionProgress(Progress):
    """Progress display: on a terminal or in a notebook a bar; elsewhere a line every few seconds; and a final line.

    It prints the last row of the ledger. A resumed run made `done` steps before.
    """

    def __init__(self, header: str, ledger: Ledger, done: int, quiet: bool) -> None:
        super().__init__("dynamics", quiet, (BarColumn(24),), auto_refresh=False)
        self._header, self._ledger, self._every = header, ledger, LINE_INTERVAL if self._bar is None else REFRESH
        self._number = self._steps = self._done = done
        self._next = float("inf")

    def __enter__(self) -> MotionProgress:
        if self._reports:
            self.print(self._header)
            self._begin = time.perf_counter()
            self._updates = deque([(self._begin, self._done)], maxlen=WINDOW)
            self._next = self._begin + self._every
        return super().__enter__()

    def __exit__(self, *error: object) -> None:
        super().__exit__(*error)
        if self._number > self._done and self._reports:
            taken = time.perf_counter() - self._begin
            self.print(self._line((self._number - self._done) / taken, f"took {duration(taken)}"))

    def step(self, number: int, steps: int) -> None:
        """Count a recorded step: `number` of `steps`, including those before this run."""
        self._number, self._steps = number, steps
        now = time.perf_counter()
        if now >= self._next:
            self._update(now)

    def _update(self, now: float) -> None:
        then, before = self._updates[0]
        rate = (self._number - before) / (now - then)
        self._updates.append((now, self._number))
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
            parts.append(f"t {ledger['time'][-1]:.4g} {ledger.units.of('s')}")
            parts += [f"{words} {_energy(ledger[name][-1], ledger.units)}" for words, name in ENERGIES.items() if name in ledger]
        return "   ".join(part for part in parts if part)


def _energy(energy: float, units: UnitSystem) -> str:
    """Return an energy as text; "-" for one that does not exist."""
    return "-" if isnan(energy) else f"{energy:.3g} {units.of('J')}"
