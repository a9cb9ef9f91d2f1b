"""Arc-length continuation, which follows a path through limit points, where the load reverses."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from ..arguments import Array
from ..nonlinear.newton import End, Iterations
from .continuation import Heading, Hyperplane, correct, heading
from .critical import CriticalPoint, Point, find, turning_point
from .equilibrium import Equilibrium
from .history import Attempt, Step
from .stop import Goal
from .walk import SMALLEST, Course, Walk

#: Number of iterations for which the step size is right; largest growth factor of the step size.
ITERATIONS, GROWTH = 4, 1.5
#: Limits of a step: `LARGEST` times the first step, or `PARTS` times the displacements so far per step in load, whichever is
#: larger.
LARGEST, PARTS = 4.0, 2.0
#: Smallest cosine of the angle between the path directions before and after a step; below `SHARP` the next step shrinks.
SHARPEST, SHARP = 0.5, 0.9
#: Smallest step size, as a fraction of the first step, to which steps are cut while it is uncertain that they stay on the path.
SURE = 0.02
#: Largest ratio of the load change in a step to the change that the tangent predicts. A larger ratio means that a body that was
#: nearly a mechanism has become stiff. Then the first step is shortened, unless the predicted change is below `TINY` times the
#: first load.
FORETOLD, TINY = 100.0, 1e-15
#: Tolerance for a state sought between two others: this fraction of the distance between them, beyond either end.
BESIDE = 1e-6


class ArcLength(Walk):
    """Arc-length continuation. The length `s` is measured in displacements, and `t` is an unknown like them.

    A step has a predictor and a corrector. The predictor follows the tangent of the path, `K du = -dr/dt dt`. The corrector is
    Newton's method to the equilibrium in the plane orthogonal to the tangent (Riks 1979, in the space of displacements). A step is
    halved if the corrector fails or elements would invert. It is also halved if the path turns sharply, or if the load changes far
    more than the tangent predicts. The orientation of the tangent follows from the previous one. Therefore the method passes
    bifurcations and stays on its path.
    """

    name: ClassVar[str] = "arc-length"

    def __init__(self, problem: Equilibrium, u0: Array, t0: float, course: Course, goal: Goal) -> None:
        super().__init__(problem, u0, t0, course)
        self._goal = goal
        self._first_load, self._first, self._size = course.first, 0.0, 0.0
        self._heading: Heading | None = None
        self._turns = self._states = 0
        self._from = self.u

    def saved(self) -> dict[str, Any]:
        rate = 0.0 if self._heading is None else self._heading.rate
        return super().saved() | {"turns": self._turns, "states": self._states, "rate": rate, "goal": self._goal.saved()}

    def resume(self, steps: list[Step], saved: dict[str, Any]) -> None:
        start = self.u, self.t
        super().resume(steps, saved)
        self._turns, self._states = saved["turns"], saved["states"]
        if saved["goal"] != self._goal.saved():
            self._goal.refuse_passed(*start, steps)
            self.reached = self._goal.counted(self._turns, self._states)
        found = heading(self.problem, self.u, self.t)
        if saved["rate"] and isinstance(found, Heading):
            self._heading = found if found.rate * saved["rate"] > 0 else found.reversed()

    def _begin(self) -> Step | Attempt | None:
        outcome = super()._begin()
        self._states = int(isinstance(outcome, Step))
        return outcome

    def _start(self, t: float) -> Array:
        return self.problem.body.prescribe(self.u.copy(), t)

    def _advance(self) -> Step | Attempt | None:
        if self._heading is None:
            found = heading(self.problem, self.u, self.t)
            if isinstance(found, str):
                self._lost = True
                return Attempt(self.t, End.NO_DESCENT, Iterations(residuals=[], detail=found))
            self._set_out(found)
        if self._size < SMALLEST * self._first or self._goal.exhausted(self._states):
            return None
        outcome = self._try()
        if isinstance(outcome, Attempt):
            self._size /= 2
        return outcome

    def _set_out(self, found: Heading) -> None:
        """Set the first heading and the first step size, which corresponds to the first part of the load."""
        self._first = self._size = self._first_load / found.rate
        ahead = self._goal.towards(self.u, self.t, found.direction, found.rate)
        self._heading = found if ahead > 0 else found.reversed()

    def _try(self) -> Step | Attempt:
        problem, way, length = self.problem, self._heading, self._size
        assert way is not None
        u = self.u + length * way.direction
        place = problem.states.dot(way.direction, self.u) + length  # offset of the plane orthogonal to the path, along the tangent
        found = self._correct(u, self.t + length * way.rate, Hyperplane(way.direction, 0.0, place, length))
        if isinstance(found, Attempt):
            return found
        u, t, end, record = found
        foretold = abs(length * way.rate)
        if abs(t - self.t) > FORETOLD * max(foretold, self._first_load):
            if foretold > TINY * self._first_load:
                self._first = min(self._first, length / 2)
            return Attempt(t, End.TOO_SHARP, record)
        ahead = heading(problem, u, t)
        landed = False
        if not isinstance(ahead, str):
            landing = self._landed(u, t, ahead.along(way.direction, problem).rate * way.rate < 0)
            if isinstance(landing, Attempt):
                return landing
            if landing is not None:
                landed, (u, t, end, record) = True, landing
                ahead = heading(problem, u, t)
        if isinstance(ahead, str):
            return Attempt(t, End.NO_DESCENT, Iterations(record.residuals, detail=ahead))
        ahead = ahead.along(way.direction, problem)
        chord = u - self.u
        dot, reach = problem.states.dot, problem.states.norm(chord)
        cosine = min(dot(ahead.direction, way.direction), dot(way.direction, chord) / reach, dot(ahead.direction, chord) / reach)
        if cosine < SHARPEST:
            return Attempt(t, End.TOO_SHARP, record)
        turned = ahead.rate * way.rate < 0
        point = Point(u, t, ahead.negative, None)
        critical = () if self._point is None else find(problem, self._point, point, turned, self._rtol)
        if self._size > SURE * self._first and self._hopped(point, critical):
            return Attempt(t, End.TOO_SHARP, record)
        self._heading, self._turns, self._states = ahead, self._turns + turned, self._states + 1
        self.reached = landed or self._goal.counted(self._turns, self._states)
        self._adapt(len(record), cosine)
        record.negative_pivots = ahead.negative
        return self._accept(t, u, end, record, critical)

    def _hopped(self, after: Point, critical: tuple[CriticalPoint, ...]) -> bool:
        """Return whether the step jumped to another path.

        This is so if its critical points are not all found, or do not explain the change of stability.
        """
        if not all(point.resolved for point in critical):
            return True
        if self._point is None or self._point.negative is None or after.negative is None:
            return False
        return (len(critical) - abs(after.negative - self._point.negative)) % 2 == 1

    def _landed(self, u: Array, t: float, turned: bool) -> tuple[Array, float, End, Iterations] | Attempt | None:
        """Return the first state on a level within the step to `(u, t)`; None if the step crosses no level.

        If the load reverses in the step, the parts before and after the limit point are searched separately.
        """
        ends, begin = [(u, t)], (self.u, self.t)
        if turned and self._goal.has_levels:
            top = turning_point(self.problem, Point(*begin, None, None), Point(u, t, None, None), self._rtol)
            if top is None:
                return Attempt(t, End.TOO_SHARP, Iterations(residuals=[]))
            ends.insert(0, top)
        for end in ends:
            crossing = self._goal.crossed(*begin, *end)
            if crossing is not None:
                part, plane = crossing
                chord = end[0] - begin[0]
                found = self._correct(begin[0] + part * chord, begin[1] + part * (end[1] - begin[1]), plane)
                if isinstance(found, Attempt):
                    return found
                along = self.problem.states.dot(found[0] - begin[0], chord) / self.problem.states.dot(chord, chord)
                if not -BESIDE <= along <= 1 + BESIDE:
                    return Attempt(found[1], End.TOO_SHARP, found[3])
                return found
            begin = end
        return None

    def _correct(self, u: Array, t: float, plane: Hyperplane) -> tuple[Array, float, End, Iterations] | Attempt:
        """Find the equilibrium in a plane with no more inverted elements than allowed; return a failed attempt otherwise."""
        u, t, end, record = correct(self.problem, u, t, plane, self._rtol, self._course.iterating)
        if not end.converged:
            return Attempt(t, end, record)
        turned = self.problem.inside_out(u)
        if len(turned) > self._allowed or not self.problem.on_this_side(self.u, u):
            record.detail = self.problem.named(turned)
            return Attempt(t, End.INSIDE_OUT, record)
        return u, t, end, record

    def _adapt(self, iterations: int, cosine: float) -> None:
        factor = float(np.clip(np.sqrt(ITERATIONS / max(iterations, 1)), 1 / GROWTH, GROWTH))
        if cosine < SHARP:
            factor = min(factor, 1 / GROWTH)
        part = PARTS * self._first_load * self.problem.states.norm(self.u - self._from)
        longest, shortest = max(LARGEST * self._first, part), SMALLEST * self._first  # only failed attempts end the path
        self._size = max(min(factor * self._size, longest), shortest)
