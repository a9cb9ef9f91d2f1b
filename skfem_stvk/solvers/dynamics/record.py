"""Record of a run: its present state, clock, counts and ledger. Only the loop writes it."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from math import ceil, isfinite, nan, ulp
from typing import Annotated, Any, TypeAlias

import numpy as np

from ...arguments import Array
from ...npz import Count, Ids, Stored, Vector, Vectors, Within
from ..newton.problem import Tangent
from ..newton.stopwatch import Stopwatch
from ..runs.ledger import Ledger

#: Tolerance for the end of the run, as a part of a step.
SLACK = 1e-6
#: Largest change of a step's length by rounding of the time, as a part of the step.
ROUNDED = 1e-6
#: Change of the safe bound between two reviews that is aimed at; first, smallest and largest number of steps between two reviews.
MOVES, FIRST, FEWEST, MOST = 0.01, 10, 5, 200
#: Largest number of times that computed steps are halved.
HALVINGS = 4
#: Length of a step, or a bound on it [s]; infinite for a body without stiffness.
Bound: TypeAlias = Annotated[float, Within(0.0, finite=False)]


@dataclass
class MotionState:
    """State of a motion at one time, with vectors (ndofs,). Integrators change them in place after a successful step."""

    t: float  # time [s]
    u: Vector  # displacements [m]
    v: Vector  # velocities [m/s]
    a: Vector  # accelerations [m/s^2] if the integrator stores them, otherwise zero
    #: Mean forces of the supports over the last step [N].
    reaction: Vector
    #: (n, ndofs) forces of each contact, and in a last row of all foundations, on the body in the last step [N].
    forces: Vectors

    @classmethod
    def at(cls, t: float, u: Array, v: Array, rows: int = 0) -> MotionState:
        """Return a state with copies of `u` and `v`, zero accelerations and reactions, and `rows` of zero forces."""
        return cls(t, u.copy(), v.copy(), np.zeros_like(u), np.zeros_like(u), np.zeros((rows, len(u))))

    def copy(self) -> MotionState:
        """Return an independent copy."""
        return MotionState(self.t, *(array.copy() for array in (self.u, self.v, self.a, self.reaction, self.forces)))

    def copy_from(self, other: MotionState) -> None:
        """Copy another state into the arrays of this one."""
        self.t = other.t
        for name in ("u", "v", "a", "reaction", "forces"):
            np.copyto(getattr(self, name), getattr(other, name))


@dataclass
class Clock:
    """Counter of steps of equal length. Times are computed from the count, not summed, so that they do not drift.

    >>> clock = Clock(0.0, 0.1)
    >>> for _ in range(3):
    ...     clock.tick()
    >>> clock.t == 3 * 0.1, clock.steps_left(until=1.0), clock.steps_left(until=0.95)
    (True, 7, 7)
    """

    start: float  # time at which steps of the length `dt` began [s]
    dt: Annotated[float, Within(ulp(0.0))]  # 0 before it is computed [s]
    count: Count = 0  # number of steps since `start`

    @property
    def t(self) -> float:
        """Time at the end of the steps so far [s]."""
        return self.start + self.count * self.dt

    def tick(self) -> None:
        """Advance the clock by one step."""
        self.count += 1

    def steps_left(self, until: float) -> int:
        """Return the number of steps left until that time. The last one may be shorter."""
        return max(0, ceil((until - self.t) / self.dt - SLACK))

    def next(self, until: float) -> tuple[float, bool]:
        """Return the end of the next step [s], and whether it is a whole step."""
        t = self.start + (self.count + 1) * self.dt
        return (t, True) if t <= until + SLACK * self.dt else (until, False)

    def resolves(self, dt: float) -> bool:
        """Return whether rounded times resolve steps of length `dt` with a relative error of at most `ROUNDED`."""
        return ulp(self.t) <= ROUNDED * dt

    def change(self, dt: float) -> None:
        """Change the length of the steps from now on."""
        self.start, self.dt, self.count = self.t, dt, 0


@dataclass(frozen=True)
class Reviews:
    """Schedule of the reviews of an explicit run's critical step, and their last results.

    Reviews are rare while the step is constant.
    """

    next: Count = FIRST  # number of the step after which the next review is
    interval: Annotated[int, Within(FEWEST, MOST)] = FIRST  # number of steps between two reviews
    seen: Bound = 0.0  # the bound at the last review [s]
    step: Bound = 0.0  # the critical step when it was computed last [s]
    bound: Bound = 0.0  # its bound then [s]
    largest: Bound = 0.0  # upper limit of computed steps [s]
    halvings: Annotated[int, Within(0, HALVINGS)] = 0  # number of blow-ups; computed steps were halved after each

    @property
    def latest(self) -> float:
        """Critical step at the last review [s]."""
        return self.step * ((self.seen or self.bound) / self.bound)

    def estimate(self, bound: float, steps: int) -> tuple[float, Reviews]:
        """Return the critical step [s], scaled with its bound, and the reviews after this one at step number `steps`.

        The step is NaN if a bound is infinite, because nothing has stiffness.
        """
        if not (isfinite(bound) and isfinite(self.bound)):  # at present nothing has stiffness
            return nan, replace(self, next=steps + FEWEST, interval=FEWEST, seen=0.0)
        moved = abs(bound / (self.seen or self.bound) - 1)
        factor = min(max(MOVES / moved, 0.25), 2.0) if moved else 2.0
        interval = int(min(max(factor * self.interval, FEWEST), MOST))
        return self.step * (bound / self.bound), replace(self, next=steps + interval, interval=interval, seen=bound)


@dataclass
class Counts:
    """Counts of a stepper over the whole motion, including the part before it was resumed."""

    iterations: Count = 0  # of Newton's method, or of the linear solver if a step is one linear solve; otherwise 0
    clamped: Count = 0  # linear steps with the clamped tangent, because K was not positive definite

    def add(self, before: Counts) -> None:
        """Add the counts of the run that is resumed."""
        self.iterations += before.iterations
        self.clamped += before.clamped


@dataclass(frozen=True, eq=False)
class HierarchyOrigin:
    """Matrix from which multigrid built its present hierarchy. A resumed run builds the hierarchy from the same matrix.

    Attributes
    ----------
    u0, w
        (ndofs,) displacements at the beginning of the step, and over it [m].
    t
        Time of the equation [s].
    c, g
        Factors of accelerations and velocities, as in `Coefficients`.
    tangent
        Tangent of Newton's method.
    with_tensions
        Whether the matrix has the tensions of the beginning of the step.
    pace
        Iterations per decade of the residual in the first solve; None before it.
    slow
        Whether the next matrix gets a new hierarchy.
    """

    u0: Vector
    w: Vector
    t: float
    c: Annotated[float, Within(0.0)]
    g: Annotated[float, Within(0.0)]
    tangent: Tangent
    with_tensions: bool
    pace: Annotated[float, Within(0.0)] | None = None
    slow: bool = False


@dataclass
class Snapshot:
    """State after a whole step, from which a run can continue."""

    state: MotionState
    clock: Clock
    reviews: Reviews  # of the critical step
    steps: Count  # number of completed steps; the ledger has one row more
    cuts: Count  # number of steps that were made in parts
    history: tuple[Annotated[Array, Stored(None, finite=False)], ...]  # of the terms that have one, at the state

    def snapshot(self) -> Snapshot:
        """Return a copy."""
        return Snapshot(self.state.copy(), replace(self.clock), self.reviews, self.steps, self.cuts, self.history)


@dataclass
class RunState(Snapshot):
    """Present state of a run, and what a later run needs to continue from it in addition."""

    good: Snapshot | None  # last good state, to which a run returns after a blow-up
    counts: Counts  # iterations of the steps
    origin: HierarchyOrigin | None  # origin of multigrid's hierarchy
    removed: Ids  # removed elements, in order
    removed_at: Annotated[Array, Stored(1, finite=False)]  # time of removal [s]; NaN before the run

    @property
    def parts(self) -> dict[str, Any]:
        """Fields of a `RunState` by name."""
        return {one.name: getattr(self, one.name) for one in fields(RunState)}


@dataclass
class RunRecord(RunState):
    """Complete record from which a run can continue: its present state, and the run so far.

    Counts and times cover the whole motion, including the part before a resume.
    """

    ledger: Ledger  # one row for each step, and one for the beginning
    watch: Stopwatch = field(default_factory=lambda: Stopwatch("write"))  # run time by part

    @classmethod
    def at(cls, state: MotionState, ledger: Ledger, body: Any) -> RunRecord:
        """Return the record of a run that begins with this state of the body."""
        clock, removed = Clock(state.t, 0.0), (np.empty(0, dtype=np.int64), np.empty(0))
        return cls(state, clock, Reviews(), 0, 0, body.first_history(), None, Counts(), None, *removed, ledger)

    def add_removed(self, elements: Ids, t: float) -> None:
        """Record that elements were removed at this time. The last good state is never older than the last removal."""
        self.removed = np.concatenate([self.removed, elements])
        self.removed_at = np.concatenate([self.removed_at, np.full(len(elements), t)])

    @property
    def after_whole_step(self) -> bool:
        """Whether the state is at the end of a whole step. A run can continue only from such a state."""
        return self.state.t == self.clock.t

    def return_to(self, then: Snapshot) -> None:
        """Return to the state of a snapshot, and delete the later rows of the ledger."""
        self.state.copy_from(then.state)
        self.clock, self.reviews, self.steps, self.cuts = replace(then.clock), then.reviews, then.steps, then.cuts
        self.history = then.history
        self.ledger.truncate(min(self.ledger.steps, self.steps + 1))

    def store_good_state(self) -> None:
        """Store the present state as the last good state."""
        self.good = self.snapshot()

    def return_to_good_state(self) -> None:
        """Return to the last good state."""
        assert self.good is not None
        self.return_to(self.good)
