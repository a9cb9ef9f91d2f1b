"""Continuation along a path of equilibria: its current state, and the evaluation of each state."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from time import perf_counter
from typing import Annotated, Any, ClassVar

from ...arguments import Array
from ...mesh.displacements import by_vertex
from ...npz import Within
from ...results.monitors import Monitors
from ...results.penetration import contact_findings_at
from ..newton.newton import End, Iterations, NewtonOptions, newton
from ..newton.outcome import Status
from ..newton.stability import lowest_mode, stability_of
from .critical import CriticalPoint, Point, find
from .equilibrium import Equilibrium
from .history import Attempt, Step

#: Smallest step, as a fraction of the first one.
SMALLEST = 1 / 1024


@dataclass(frozen=True)
class ContinuationOptions:
    """Options of a continuation that all methods share."""

    first: float  # first step, as a fraction of the load
    rtol: float  # relative tolerance of the residual against loads and reactions
    monitors: Monitors  # checks of each state
    stability: bool  # compute the lowest eigenvalue where the solver does not count negative ones
    iterating: Callable[[float, Iterations], None]  # called at the beginning of each iteration


@dataclass
class ContinuationState:
    """Data for the next step of a continuation, from which a later run resumes in addition to its states."""

    size: Annotated[float, Within(0.0)]  # the next step, in the measure of the method
    first: Annotated[float, Within(0.0)]  # the first step
    reached: bool = False  # whether the requested end is reached
    largest: Annotated[float, Within(0.0)] = 0.0  # the largest reference force so far


class Continuation(ABC):
    """Continuation from the state `u0` at `t0`. `t` and `u` are the last state, `next` the data for the next step."""

    name: ClassVar[str]

    next: ContinuationState

    def __init__(self, problem: Equilibrium, u0: Array, t0: float, options: ContinuationOptions) -> None:
        self.problem, self._options, self._rtol = problem, options, options.rtol
        self.t, self.u = t0, u0
        self._failed, self._clock = False, perf_counter()
        self._allowed = len(problem.inside_out(u0))
        self._point: Point | None = None  # user-supplied displacements may not be a state of the path
        if not problem.states.comm.any(bool(u0.any())):
            self._point = Point(u0, t0, None if problem.iterative else self._negative_at_rest(), None)
        problem.accept(u0, t0)

    def _negative_at_rest(self) -> int | None:
        """Return the number of negative eigenvalues of K at zero displacements: 0 unless loads have a stiffness.

        Membranes and cables without tension have zero transverse stiffness. Their pivots are round-off, so the count is checked
        with eigenvalues.
        """
        if self.problem.system.dead:
            return 0
        self.problem.factorise(self.u, self.t)
        found = self.problem.negative_pivots()
        return stability_of(self.problem, self.u, self.t).negative if found else found

    def states(self, resumed: bool) -> Iterator[Step | Attempt]:
        """Yield the states of the path, and the failed attempts between them."""
        if not resumed:
            outcome = self._begin()
            if outcome is not None:
                yield outcome
                self._reset_reference_force()
        body = self.problem.body
        while not self._failed and not self.next.reached:
            history = self.history
            self.problem.begin_step(body.advanced(history, self.u, self.problem.moment(self.t)))
            outcome = self._advance()
            if not isinstance(outcome, Step):
                body.return_to(history)
                self.problem.begin_step(history)
            if outcome is None:
                return
            yield outcome

    @property
    def history(self) -> tuple[Array, ...]:
        """History of the terms after the last step."""
        step = self.problem.step
        return () if step is None else self.problem.body.after_step(step.history)

    def _begin(self) -> Step | Attempt | None:
        """Return the equilibrium at `t0`; None if the start is zero and in equilibrium."""
        problem, u = self.problem, self._start(self.t)
        if self._allowed:  # the supports may invert more elements
            self._allowed = max(self._allowed, len(problem.inside_out(u)))
        if not problem.states.comm.any(bool(u.any())) and problem.residual(u, self.t).size == 0:
            return None
        problem.accept(u, self.t)  # the supports may disturb the balance of `u0`
        outcome = self._newton(u, self.t, full_first=True)
        self._failed, self._point = isinstance(outcome, Attempt), None
        return outcome if isinstance(outcome, Attempt) else self._accept(self.t, *outcome)

    def _reset_reference_force(self) -> None:
        """Set the reference force from the last state alone, without that of the start.

        The forces of a start with inverted elements may be a million times as large.
        """
        self.problem.largest = 0.0
        self.problem.accept(self.u, self.t)

    @abstractmethod
    def _start(self, t: float) -> Array:
        """Return the state from which Newton's method starts; it satisfies the prescribed displacements at `t`."""

    @abstractmethod
    def _advance(self) -> Step | Attempt | None:
        """Return the next state, or a failed attempt, which changes no state; None if there is nothing left to try."""

    def saved(self) -> ContinuationState:
        """Return the data from which a later run resumes, in addition to its states."""
        return replace(self.next, largest=self.problem.largest)

    def resume(self, steps: list[Step], saved: Any) -> None:
        """Resume from the states and the saved data of an earlier run with the same method."""
        last, t0 = steps[-1], self.t
        self.next, self.problem.largest, self.t, self.u = replace(saved), saved.largest, last.t, last.u
        self._allowed = len(self.problem.inside_out(self.u))
        self._point = Point(self.u, last.t, last.negative, last.lowest)
        if len(steps) == 1 and last.t == t0:
            self._reset_reference_force()

    def _newton(self, start: Array, t: float, full_first: bool) -> tuple[Array, End, Iterations] | Attempt:
        """Apply Newton's method at the load factor `t`; fail at once if the start is beyond a contact or has inverted elements."""
        if blocked := self._blocked(start, t, Iterations()):
            return blocked
        watch = partial(self._options.iterating, t)
        u, end, record = newton(self.problem, start, t, NewtonOptions(self._rtol, self._allowed, full_first, watch))
        if not end.converged:
            return Attempt(t, end, record)
        system = self.problem.system
        for contact in system.contacts_at(self.problem.moment(t)) if system.contacts else ():
            if contact.shape is not None and contact.passes(*(by_vertex(system.mesh, state) for state in (self.u, u))):
                record.detail = f"{contact.name!r}"  # its moving shape is passed on the way from the last state
                return Attempt(t, End.CONTACT, record)
        return u, end, record

    def _blocked(self, u: Array, t: float, record: Iterations) -> Attempt | None:
        """Return a failed attempt if `u` has more inverted elements than allowed, or cannot be reached on a straight line."""
        inverted = self.problem.inside_out(u)
        if len(inverted) <= self._allowed:
            limit, contact = self.problem.contact_limit(self.u, u - self.u, self.t)
            if limit <= 1:
                record.detail = f"{contact!r}"
                return Attempt(t, End.CONTACT, record)
            if self.problem.way_is_free(self.u, u, self.t):
                return None
        record.detail = self.problem.named(inverted)
        return Attempt(t, End.INSIDE_OUT, record)

    def _accept(
        self,
        t: float,
        u: Array,
        end: End,
        record: Iterations,
        critical: tuple[CriticalPoint, ...] | None = None,
        jump: float | None = None,
    ) -> Step:
        """Accept a state of the path and return its step; `critical` are the points before it, if they are known."""
        problem, before = self.problem, self._point
        problem.accept(u, t)
        inverted, full = problem.inside_out(u), problem.states.expand(u)
        if critical is None and not problem.iterative and not (before and record.negative_pivots == before.negative):
            problem.factorise(u, t)  # the last tangent of Newton's method, if any, belongs to the iterate before
            record.negative_pivots = problem.negative_pivots()
        if self._options.stability and record.negative_pivots is None and not problem.iterative:
            record.negative_pivots = stability_of(problem, u, t).negative
        lowest = lowest_mode(problem, u, t).value if self._options.stability and problem.iterative else None
        point = Point(u, t, record.negative_pivots, lowest)
        if critical is None:
            critical = () if before is None else find(problem, before, point, False, self._rtol)
        status = Status.INVERTED if len(inverted) else Status.UNSTABLE if point.unstable else end.status
        energies, smallest = problem.energies(u, t), problem.system.smallest_volume_ratio(full)
        findings = (*self._options.monitors.at(full), *contact_findings_at(problem.system, full, problem.moment(t)))
        now, clock = perf_counter(), self._clock
        self.t, self.u, self._point, self._allowed, self._clock = t, u, point, len(inverted), now
        return Step(t, full, status, end, record, *energies, smallest, lowest, jump, findings, critical, now - clock)
