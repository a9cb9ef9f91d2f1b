"""The record of a run: its state, clock, counts and ledger as it goes on. The loop alone writes it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import ceil, isfinite, nan, ulp

import numpy as np

from ..arguments import Array
from ..nonlinear.stopwatch import Stopwatch
from .ledger import Ledger

#: Part of a step by which the end may be missed and still be met.
SLACK = 1e-6
#: Part of a step that rounding of the time may add or take away.
ROUNDED = 1e-6
#: The safe bound may move by this part between two reviews; steps between two reviews at first, at least and at most.
MOVES, FIRST, FEWEST, MOST = 0.01, 10, 5, 200
#: Steps that were found are halved so often at most.
HALVINGS = 4


@dataclass
class MotionState:
    """Displacements, velocities and accelerations at one time. Integrators change them in place, once a step has succeeded.

    Attributes
    ----------
    t : time [s].
    u, v, a : (ndofs,) displacements [m], velocities [m/s], and accelerations [m/s^2] where the integrator keeps them, otherwise
        zero.
    reaction : (ndofs,) mean forces of the supports over the last step [N], at held degrees of freedom. Explicit integrators leave
        it zero where none of them moves, and their work is zero.
    """

    t: float
    u: Array
    v: Array
    a: Array
    reaction: Array

    @classmethod
    def at(cls, t: float, u: Array, v: Array) -> MotionState:
        """Copies of `u` and `v`, without accelerations and reactions yet."""
        return cls(t, u.copy(), v.copy(), np.zeros_like(u), np.zeros_like(u))

    def copy(self) -> MotionState:
        """An independent copy."""
        return MotionState(self.t, *(array.copy() for array in (self.u, self.v, self.a, self.reaction)))

    def become(self, other: MotionState) -> None:
        """Take over another state, in the arrays of this one."""
        self.t = other.t
        for name in ("u", "v", "a", "reaction"):
            np.copyto(getattr(self, name), getattr(other, name))


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
        """The time now [s]."""
        return self.start + self.count * self.dt

    def tick(self) -> None:
        """Advance the clock by one step."""
        self.count += 1

    def left(self, until: float) -> int:
        """How many steps are left until that time; the last may be shorter."""
        return max(0, ceil((until - self.t) / self.dt - SLACK))

    def next(self, until: float) -> tuple[float, bool]:
        """When the next step ends, and whether that is a whole step."""
        t = self.start + (self.count + 1) * self.dt
        if t <= until + SLACK * self.dt:
            return t, True
        return until, False

    def resolves(self, dt: float) -> bool:
        """Whether steps of this length from now on have it within `ROUNDED`, although times are rounded."""
        return ulp(self.t) <= ROUNDED * dt

    def change(self, dt: float) -> None:
        """Take steps of another length from now on."""
        self.start, self.dt, self.count = self.t, dt, 0


@dataclass(frozen=True)
class Reviews:
    """When an explicit run reviews its critical step, often while that moves and seldom while it does not, and what it found last.

    Attributes
    ----------
    next, interval : number of the step after which the next review is, and number of steps between two reviews.
    seen : the bound at the last review [s].
    step, bound : the critical step when it was computed last, and its bound [s].
    largest : steps that are found are not larger than this [s].
    halvings : how often the motion has blown up; steps that are found were halved each time.
    """

    next: int = FIRST
    interval: int = FIRST
    seen: float = 0.0
    step: float = 0.0
    bound: float = 0.0
    largest: float = 0.0
    halvings: int = 0

    def estimate(self, bound: float, steps: int) -> tuple[float, Reviews]:
        """The critical step if it has moved with its bound [s], or NaN; and the reviews after this one, after so many steps."""
        if not (isfinite(bound) and isfinite(self.bound)):  # nothing has stiffness, for the moment
            return nan, replace(self, next=steps + FEWEST, interval=FEWEST, seen=0.0)
        moved = abs(bound / (self.seen or self.bound) - 1)
        factor = min(max(MOVES / moved, 0.25), 2.0) if moved else 2.0
        interval = int(min(max(factor * self.interval, FEWEST), MOST))
        return self.step * (bound / self.bound), replace(self, next=steps + interval, interval=interval, seen=bound)


@dataclass
class Counts:
    """Counted by a stepper, over the whole motion: those before it was resumed are added.

    Attributes
    ----------
    iterations : of Newton's method, or of the linear solver where a step is one linear solve; 0 where there are none.
    clamped : steps of one linear solve that were made with the clamped tangent, because K was not positive definite.
    """

    iterations: int = 0
    clamped: int = 0

    def add(self, before: Counts) -> None:
        """Count what was counted before as well."""
        self.iterations += before.iterations
        self.clamped += before.clamped


@dataclass(frozen=True)
class Snapshot:
    """A copy of the record after a whole step.

    Attributes
    ----------
    rows : how many rows the ledger had.
    """

    state: MotionState
    clock: Clock
    reviews: Reviews
    steps: int
    cuts: int
    rows: int


@dataclass
class RunRecord:
    """The state of a run, with all that a run that goes on from here needs.

    Attributes
    ----------
    clock : its step is 0 until one is found.
    reviews : of the critical step.
    ledger : one row for each step, and one for the beginning.
    steps, cuts : how many steps were made, and how many of them in parts.
    good : the last good state, to which a run that blows up goes back.
    counts, watch : what the steps took, and how long by part; of a motion that is resumed, in all.
    """

    state: MotionState
    clock: Clock
    ledger: Ledger
    reviews: Reviews = field(default_factory=Reviews)
    steps: int = 0
    cuts: int = 0
    good: Snapshot | None = None
    counts: Counts = field(default_factory=Counts)
    watch: Stopwatch = field(default_factory=lambda: Stopwatch("write"))

    @property
    def at_a_step(self) -> bool:
        """Whether a whole step has led here: a run goes on from there only."""
        return self.state.t == self.clock.t

    def snapshot(self) -> Snapshot:
        """An independent copy of what is now."""
        return Snapshot(self.state.copy(), replace(self.clock), self.reviews, self.steps, self.cuts, self.ledger.steps)

    def keep(self) -> None:
        """Take what is now for the last good state."""
        self.good = self.snapshot()

    def back(self) -> None:
        """Return to the last good state."""
        assert self.good is not None
        good = self.good
        self.state.become(good.state)
        self.clock, self.reviews, self.steps, self.cuts = replace(good.clock), good.reviews, good.steps, good.cuts
        self.ledger.truncate(good.rows)
