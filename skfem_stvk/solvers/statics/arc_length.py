"""Arc-length continuation, which follows a path through limit points, where the load reverses."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from ...arguments import Array
from ...npz import Count
from ..newton.newton import End, Iterations
from .continuation import SMALLEST, Continuation, ContinuationOptions, ContinuationState
from .critical import CriticalPoint, Point, find, turning_point
from .equilibrium import Equilibrium, Hyperplane, PathTangent, correct, path_tangent
from .history import Attempt, Step
from .stop import StopCriterion

#: Number of iterations for which the step size is right; largest growth factor of the step size.
ITERATIONS, GROWTH = 4, 1.5
#: Limits of a step: `LARGEST` times the first step, or `PARTS` times the displacements so far per step in load, whichever is
#: larger.
LARGEST, PARTS = 4.0, 2.0
#: Smallest cosine of the angle between the path directions before and after a step; below `SHARP` the next step shrinks.
SHARPEST, SHARP = 0.5, 0.9
#: Smallest step size, as a fraction of the first step, to which steps are cut while it is uncertain that they stay on the path.
SMALLEST_UNSURE = 0.02
#: Largest ratio of the load change in a step to the change that the tangent predicts. A larger ratio means that a body that was
#: nearly a mechanism has become stiff. Then the first step is shortened, unless the predicted change is below `TINY` times the
#: first load.
LARGEST_RATIO, TINY = 100.0, 1e-15
#: Tolerance for a state sought between two others: this fraction of the distance between them, beyond either end.
BEYOND = 1e-6


@dataclass
class ArcLengthState(ContinuationState):
    """Data for the next step by arc length."""

    turns: Count = 0  # number of limit points so far
    states: Count = 0  # number of states so far
    rate: float = 0.0  # rate of the load factor along the path; 0 before the first step
    goal: list[list[float]] = field(default_factory=list)  # numbers that identify the stop


class ArcLength(Continuation):
    """Arc-length continuation. The length `s` is measured in displacements, and `t` is an unknown like them.

    A step has a predictor and a corrector. The predictor follows the tangent of the path, `K du = -dr/dt dt`. The corrector is
    Newton's method to the equilibrium in the plane orthogonal to the tangent (Riks 1979, in the space of displacements). A step is
    halved if the corrector fails or elements would invert. It is also halved if the path turns sharply, or if the load changes far
    more than the tangent predicts. The orientation of the tangent follows from the previous one. Therefore the method passes
    bifurcations and stays on its path.
    """

    name: ClassVar[str] = "arc-length"
    next: ArcLengthState

    def __init__(self, problem: Equilibrium, u0: Array, t0: float, options: ContinuationOptions, stop: StopCriterion) -> None:
        super().__init__(problem, u0, t0, options)
        self._stop = stop
        self.next = ArcLengthState(size=0.0, first=0.0, goal=stop.saved())
        self._first_load, self._initial = options.first, u0
        self._tangent: PathTangent | None = None

    def resume(self, steps: list[Step], saved: ArcLengthState) -> None:
        start = self.u, self.t
        super().resume(steps, saved)
        self.next.goal = self._stop.saved()
        if saved.goal != self.next.goal:
            self._stop.refuse_passed(*start, steps)
            self.next.reached = self._stop.is_count_reached(saved.turns, saved.states)
        found = path_tangent(self.problem, self.u, self.t)
        if saved.rate and isinstance(found, PathTangent):
            self._set_tangent(found if found.rate * saved.rate > 0 else found.reversed())

    def _begin(self) -> Step | Attempt | None:
        outcome = super()._begin()
        self.next.states = int(isinstance(outcome, Step))
        return outcome

    def _start(self, t: float) -> Array:
        return self.problem.body.prescribe(self.u.copy(), t)

    def _advance(self) -> Step | Attempt | None:
        if self._tangent is None:
            found = path_tangent(self.problem, self.u, self.t)
            if isinstance(found, str):
                self._failed = True
                return Attempt(self.t, End.NO_DESCENT, Iterations(residuals=[], detail=found))
            self._choose_direction(found)
        if self.next.size < SMALLEST * self.next.first or self._stop.is_limit_reached(self.next.states):
            return None
        outcome = self._attempt()
        if isinstance(outcome, Attempt):
            self.next.size /= 2
        return outcome

    def _choose_direction(self, found: PathTangent) -> None:
        """Set the first tangent and the first step size, which corresponds to the first part of the load."""
        self.next.first = self.next.size = self._first_load / found.rate
        ahead = self._stop.sign_towards(self.u, self.t, found.direction, found.rate)
        self._set_tangent(found if ahead > 0 else found.reversed())

    def _set_tangent(self, tangent: PathTangent) -> None:
        self._tangent, self.next.rate = tangent, tangent.rate

    def _attempt(self) -> Step | Attempt:
        problem, tangent, length, plan = self.problem, self._tangent, self.next.size, self.next
        assert tangent is not None
        u = self.u + length * tangent.direction
        offset = problem.states.dot(tangent.direction, self.u) + length  # of the plane orthogonal to the path, along the tangent
        found = self._correct(u, self.t + length * tangent.rate, Hyperplane(tangent.direction, 0.0, offset, length))
        if isinstance(found, Attempt):
            return found
        u, t, end, record = found
        predicted = abs(length * tangent.rate)
        if abs(t - self.t) > LARGEST_RATIO * max(predicted, self._first_load):
            if predicted > TINY * self._first_load:
                plan.first = min(plan.first, length / 2)
            return Attempt(t, End.TOO_SHARP, record)
        ahead = path_tangent(problem, u, t)
        on_level = False
        if not isinstance(ahead, str):
            found_level = self._state_on_level(u, t, ahead.along(tangent.direction, problem).rate * tangent.rate < 0)
            if isinstance(found_level, Attempt):
                return found_level
            if found_level is not None:
                on_level, (u, t, end, record) = True, found_level
                ahead = path_tangent(problem, u, t)
        if isinstance(ahead, str):
            return Attempt(t, End.NO_DESCENT, Iterations(record.residuals, detail=ahead))
        ahead = ahead.along(tangent.direction, problem)
        chord = u - self.u
        dot, reach = problem.states.dot, problem.states.norm(chord)
        cosine = min(
            dot(ahead.direction, tangent.direction), dot(tangent.direction, chord) / reach, dot(ahead.direction, chord) / reach
        )
        if cosine < SHARPEST:
            return Attempt(t, End.TOO_SHARP, record)
        reverses = ahead.rate * tangent.rate < 0
        point = Point(u, t, ahead.negative)
        critical = () if self._point is None else find(problem, self._point, point, reverses, self._rtol)
        if plan.size > SMALLEST_UNSURE * plan.first and self._left_the_path(point, critical):
            return Attempt(t, End.TOO_SHARP, record)
        self._set_tangent(ahead)
        plan.turns, plan.states = plan.turns + reverses, plan.states + 1
        plan.reached = on_level or self._stop.is_count_reached(plan.turns, plan.states)
        self._adapt(len(record), cosine)
        record.negative_pivots = ahead.negative
        return self._accept(t, u, end, record, critical)

    def _left_the_path(self, after: Point, critical: tuple[CriticalPoint, ...]) -> bool:
        """Return whether the step jumped to another path.

        This is so if its critical points are not all found, or do not explain the change of stability.
        """
        if not all(point.resolved for point in critical):
            return True
        if self._point is None or self._point.negative is None or after.negative is None:
            return False
        return (len(critical) - abs(after.negative - self._point.negative)) % 2 == 1

    def _state_on_level(self, u: Array, t: float, reverses: bool) -> tuple[Array, float, End, Iterations] | Attempt | None:
        """Return the first state on a level within the step to `(u, t)`; None if the step crosses no level.

        If the load reverses in the step, the parts before and after the limit point are searched separately.
        """
        ends, begin = [(u, t)], (self.u, self.t)
        if reverses and self._stop.has_levels:
            top = turning_point(self.problem, Point(*begin), Point(u, t), self._rtol)
            if top is None:
                return Attempt(t, End.TOO_SHARP, Iterations(residuals=[]))
            ends.insert(0, top)
        for end in ends:
            crossing = self._stop.first_crossing(*begin, *end)
            if crossing is not None:
                part, plane = crossing
                chord = end[0] - begin[0]
                found = self._correct(begin[0] + part * chord, begin[1] + part * (end[1] - begin[1]), plane)
                if isinstance(found, Attempt):
                    return found
                along = self.problem.states.dot(found[0] - begin[0], chord) / self.problem.states.dot(chord, chord)
                if not -BEYOND <= along <= 1 + BEYOND:
                    return Attempt(found[1], End.TOO_SHARP, found[3])
                return found
            begin = end
        return None

    def _correct(self, u: Array, t: float, plane: Hyperplane) -> tuple[Array, float, End, Iterations] | Attempt:
        """Find the equilibrium in a plane with no more inverted elements than allowed; return a failed attempt otherwise."""
        limit, contact = self.problem.contact_limit(self.u, u - self.u, self.t)
        if limit <= 1:
            return Attempt(t, End.CONTACT, Iterations(residuals=[], detail=f"{contact!r}"))
        u, t, end, record = correct(self.problem, u, t, plane, self._rtol, self._options.iterating)
        if not end.converged:
            return Attempt(t, end, record)
        return self._blocked(u, t, record) or (u, t, end, record)

    def _adapt(self, iterations: int, cosine: float) -> None:
        factor = float(np.clip(np.sqrt(ITERATIONS / max(iterations, 1)), 1 / GROWTH, GROWTH))
        if cosine < SHARP:
            factor = min(factor, 1 / GROWTH)
        part = PARTS * self._first_load * self.problem.states.norm(self.u - self._initial)
        longest, shortest = max(LARGEST * self.next.first, part), SMALLEST * self.next.first  # only failed attempts end the path
        self.next.size = max(min(factor * self.next.size, longest), shortest)
