"""When the steps of a motion end."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, isfinite, nan, ulp

#: Part of a step by which the end may be missed and still be met.
SLACK = 1e-6
#: Part of a step that rounding of the time may add or take away.
ROUNDED = 1e-6


@dataclass
class Clock:
    """Steps of one length from one time on; times are counted, not added up, so that they do not drift.

    Attributes
    ----------
    start, dt, count : time [s] at which steps of the length `dt` began, 0 until one is found, and how many there were since.

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

    def resolves(self, dt: float) -> bool:
        """Whether steps of this length from here on are that long, but for `ROUNDED` of it, for all that times are rounded."""
        return ulp(self.t) <= ROUNDED * dt

    def change(self, dt: float) -> None:
        """Steps of another length from here on."""
        self.start, self.dt, self.count = self.t, dt, 0


#: The safe bound may move by this part from one look to the next, between which there are so many steps at first, at least and at most.
MOVES, FIRST, FEWEST, MOST = 0.01, 10, 5, 200
#: Steps that were found are halved so often at most.
HALVINGS = 4


@dataclass
class Looks:
    """When explicit motions look at their critical step: often while it moves, seldom while it does not.

    Attributes
    ----------
    next, interval : number of the step after which to look, and how many there are in between.
    seen : the bound of the last look [s].
    step, bound : the critical step when it was looked for last, and its bound [s].
    largest : what is taken by itself is not larger than this [s].
    halvings : so often a motion has blown up; what is taken by itself was halved each time.
    """

    next: int = FIRST
    interval: int = FIRST
    seen: float = 0.0
    step: float = 0.0
    bound: float = 0.0
    largest: float = 0.0
    halvings: int = 0

    def estimate(self, bound: float, steps: int) -> float:
        """The critical step, if it has moved with its bound [s], after so many steps, or NaN; says when to look next."""
        if not (isfinite(bound) and isfinite(self.bound)):  # nothing has stiffness, for the moment
            self.next, self.interval, self.seen = steps + FEWEST, FEWEST, 0.0
            return nan
        moved = abs(bound / (self.seen or self.bound) - 1)
        factor = min(max(MOVES / moved, 0.25), 2.0) if moved else 2.0
        self.interval = int(min(max(factor * self.interval, FEWEST), MOST))
        self.next, self.seen = steps + self.interval, bound
        return self.step * (bound / self.bound)
