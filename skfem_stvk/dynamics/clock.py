"""When the steps of a motion end."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil

#: Part of a step by which the end may be missed and still be met.
SLACK = 1e-6


@dataclass
class Clock:
    """Steps of one length from one time on; times are counted, not added up, so that they do not drift.

    Attributes
    ----------
    start, dt, count : time [s] at which steps of the length `dt` began, and how many there were since.

    >>> clock = Clock(0.0, 0.1)
    >>> for _ in range(3):
    ...     clock.tick()
    >>> clock.t == 3 * 0.1, clock.left(until=1.0), clock.left(until=0.95)
    (True, 7, 7)
    """

    start: float
    dt: float
    count: int = 0

    @property
    def t(self) -> float:
        """Now."""
        return self.start + self.count * self.dt

    def tick(self) -> None:
        """A step is made."""
        self.count += 1

    def left(self, until: float) -> int:
        """How many steps there are until then; the last may be shorter."""
        return max(0, ceil((until - self.t) / self.dt - SLACK))

    def next(self, until: float) -> tuple[float, bool]:
        """When the next step ends, and whether that is a whole step."""
        t = self.start + (self.count + 1) * self.dt
        if t <= until + SLACK * self.dt:
            return t, True
        return until, False

    def change(self, dt: float) -> None:
        """Steps of another length from here on."""
        self.start, self.dt, self.count = self.t, dt, 0
