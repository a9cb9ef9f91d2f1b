"""The record of a run: its state, clock, counts and ledger as it goes on. The loop alone writes it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import ceil, isfinite, nan, ulp
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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
    """A motion at one time, with vectors (ndofs,). Integrators change them in place, once a step has succeeded."""

    t: float  # time [s]
    u: Array  # displacements [m]
    v: Array  # velocities [m/s]
    a: Array  # accelerations [m/s^2] where the integrator keeps them, otherwise zero
    #: Mean forces of the supports over the last step [N]; explicit integrators leave them zero where none moves, and their work is.
    reaction: Array

    @classmethod
    def at(cls, t: float, u: Array, v: Array) -> MotionState:
        """Copies of `u` and `v`, without accelerations and reactions yet."""
        return cls(t, u.copy(), v.copy(), np.zeros_like(u), np.zeros_like(u))

    def copy(self) -> MotionState:
        """Return a state of its own, with the same numbers."""
        return MotionState(self.t, *(array.copy() for array in (self.u, self.v, self.a, self.reaction)))

    def become(self, other: MotionState) -> None:
        """Take over another state, in the arrays of this one."""
        self.t = other.t
        for name in ("u", "v", "a", "reaction"):
            np.copyto(getattr(self, name), getattr(other, name))


@dataclass
class Clock:
    """Steps of one length from one time on; times are counted, not added up, so that they do not drift.

    >>> clock = Clock(0.0, 0.1)
    >>> for _ in range(3):
    ...     clock.tick()
    >>> clock.t == 3 * 0.1, clock.left(until=1.0), clock.left(until=0.95)
    (True, 7, 7)
    """

    start: float  # time at which steps of the length `dt` began [s]
    dt: float  # 0 until one is found [s]
    count: int = 0  # how many there were since

    @property
    def t(self) -> float:
        """Time at which the steps so far end [s]."""
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
        return (t, True) if t <= until + SLACK * self.dt else (until, False)

    def resolves(self, dt: float) -> bool:
        """Whether steps of this length from now on have it within `ROUNDED`, although times are rounded."""
        return ulp(self.t) <= ROUNDED * dt

    def change(self, dt: float) -> None:
        """Take steps of another length from now on."""
        self.start, self.dt, self.count = self.t, dt, 0


@dataclass(frozen=True)
class Reviews:
    """When an explicit run reviews its critical step, seldom while that does not move, and what it found last."""

    next: int = FIRST  # number of the step after which the next review is
    interval: int = FIRST  # number of steps between two reviews
    seen: float = 0.0  # the bound at the last review [s]
    step: float = 0.0  # the critical step when it was computed last [s]
    bound: float = 0.0  # its bound then [s]
    largest: float = 0.0  # steps that are found are not larger than this [s]
    halvings: int = 0  # how often the motion has blown up; steps that are found were halved each time

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
    """Counted by a stepper, over the whole motion: those before it was resumed are added."""

    iterations: int = 0  # of Newton's method, or of the linear solver where a step is one linear solve; 0 where there are none
    clamped: int = 0  # steps of one linear solve that were made with the clamped tangent, because K was not positive definite

    def add(self, before: Counts) -> None:
        """Count what was counted before as well."""
        self.iterations += before.iterations
        self.clamped += before.clamped


class HierarchyOrigin(NamedTuple):
    """The matrix from which multigrid has built the hierarchy that it keeps. A resumed run builds it from the same matrix.

    Attributes
    ----------
    u0, w : (ndofs,) displacements at the beginning of the step, and over it [m].
    t : time of the equation [s].
    c, g : factors of accelerations and velocities, as in `Coefficients`.
    tangent : value of a `Tangent` of Newton's method.
    with_tensions : whether it has the tensions of the beginning.
    pace : iterations per decade of the residual in the first solve; None before it.
    slow : whether the next matrix gets a new hierarchy.
    """

    u0: Array
    w: Array
    t: float
    c: float
    g: float
    tangent: str
    with_tensions: bool
    pace: float | None = None
    slow: bool = False


@dataclass(frozen=True)
class Snapshot:
    """A copy of the record after a whole step."""

    state: MotionState
    clock: Clock
    reviews: Reviews
    steps: int
    cuts: int
    rows: int  # how many the ledger had


@dataclass
class RunRecord:
    """The state of a run, with all that a run that goes on from here needs; what steps took is in all where it is resumed."""

    state: MotionState
    clock: Clock
    ledger: Ledger  # one row for each step, and one for the beginning
    reviews: Reviews = field(default_factory=Reviews)  # of the critical step
    steps: int = 0  # how many were made
    cuts: int = 0  # how many of them in parts
    good: Snapshot | None = None  # the last good state, to which a run that blows up goes back
    counts: Counts = field(default_factory=Counts)  # what the steps took
    watch: Stopwatch = field(default_factory=lambda: Stopwatch("write"))  # how long they took, by part
    origin: HierarchyOrigin | None = None  # of the hierarchy that multigrid keeps
    removed: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))  # elements taken out, in turn
    removed_at: Array = field(default_factory=lambda: np.empty(0))  # when [s]; not a number where that was before the run

    def take_out(self, elements: NDArray[np.int64], t: float) -> None:
        """Note that elements were taken out at this time. The last good state is never older than that."""
        self.removed = np.concatenate([self.removed, elements])
        self.removed_at = np.concatenate([self.removed_at, np.full(len(elements), t)])

    @property
    def at_a_step(self) -> bool:
        """Whether a whole step has led here: a run goes on from there only."""
        return self.state.t == self.clock.t

    def keep(self) -> None:
        """Take what is now for the last good state."""
        self.good = Snapshot(self.state.copy(), replace(self.clock), self.reviews, self.steps, self.cuts, self.ledger.steps)

    def back(self) -> None:
        """Return to the last good state."""
        assert self.good is not None
        good = self.good
        self.state.become(good.state)
        self.clock, self.reviews, self.steps, self.cuts = replace(good.clock), good.reviews, good.steps, good.cuts
        self.ledger.truncate(good.rows)
