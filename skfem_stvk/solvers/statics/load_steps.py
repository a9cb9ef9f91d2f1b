"""Path from the first load to the full load, in load steps of adaptive size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...arguments import Array
from ...errors import StateError
from ..newton.newton import MOST_FULL, End, Iterations, NewtonOptions, newton, usable
from ..newton.problem import Tangent
from ..newton.stability import lowest_mode, stability_of
from .continuation import SMALLEST, Continuation, ContinuationOptions, ContinuationState
from .critical import Point
from .equilibrium import Equilibrium
from .history import JUMPED, Attempt, Step

#: A step with at most `FEW` iterations lets the next one grow by `GROWTH`, up to `LARGEST` times the first step.
FEW, GROWTH, LARGEST = 5, 1.5, 4.0
#: Value of `jump` above which intermediate states are computed, with the residual tolerance `LOOSE`.
FAR, LOOSE = 2.0, 1e-6
#: Largest relative deviation from linear growth of the force along the straight line to the next state; below it there is no
#: snap-through.
STRAIGHT = 0.1
#: Two states lie on one path if each is this near to the prediction by the tangent at the other, relative to the predicted change.
NEAR = 0.5
#: Push along the mode of an unstable state, as a part of the distance below which surfaces repel each other.
PUSH = 0.1
#: Remark on the state that a push leads to.
SETTLED = (
    "The equilibrium found first is unstable, but only between the facets of a contact: pushed along its mode, the body finds a "
    "stable one {moved:.2g} {m} away, less than half of the contact's distance. This state is the result."
)
#: Largest number of halvings of a step, and of intermediate states.
MOST_HALVINGS, MOST_SOLVES = 6, 16


@dataclass
class LoadStepsState(ContinuationState):
    """Data for the next load step."""

    straight: bool = False  # whether it starts from the extrapolation of the last two states
    full_first: bool = True  # whether it tries full steps of Newton's method first


class LoadSteps(Continuation):
    """Continuation in load steps up to t = 1, with the first step `first`.

    A step starts from the extrapolation of the two states before it. After a failed step it starts from the last state, moved by
    the tangent's response to the prescribed displacements. A step is halved if Newton's method fails or elements would invert.
    """

    name: ClassVar[str] = "load-steps"
    next: LoadStepsState

    def __init__(self, problem: Equilibrium, u0: Array, t0: float, options: ContinuationOptions) -> None:
        super().__init__(problem, u0, t0, options)
        self.next = LoadStepsState(size=options.first, first=options.first)
        self._previous = Point(u0, t0)

    def resume(self, steps: list[Step], saved: LoadStepsState) -> None:
        start = Point(self.u, self.t)
        super().resume(steps, saved)
        self._previous = Point(steps[-2].u, steps[-2].t) if len(steps) > 1 else start

    def _advance(self) -> Step | Attempt | None:
        plan = self.next
        if plan.size < SMALLEST * plan.first:
            return None
        t = self.t + plan.size if self.t + 1.001 * plan.size < 1 else 1.0
        plan.size = t - self.t
        start, extrapolated = self._start(t), self._extrapolated(t)
        found = self._newton(start, t, plan.full_first)
        if isinstance(found, Attempt):
            plan.straight, plan.full_first, plan.size = False, True, plan.size / 2
            return found
        u, end, record = found
        jump = (
            None
            if extrapolated is None
            else self.problem.states.norm(u - extrapolated) / self.problem.states.norm(extrapolated - self.u)
        )
        if jump is None or jump > FAR:
            detected = JumpDetector(self.problem, self._equilibrium).jump(Point(self.u, self.t), Point(u, t))
            jump = detected if detected is not None or (jump or 0.0) > JUMPED else jump
        plan.full_first = record.restarted is None and len(record) <= MOST_FULL
        plan.straight, self._previous = True, Point(self.u, self.t)
        if len(record) <= FEW:
            plan.size = min(GROWTH * plan.size, LARGEST * plan.first)
        plan.reached = t == 1
        if plan.reached and self.problem.system.contacts:
            u, end, record = self._settled(t, u) or found
        return self._accept(t, u, end, record, jump=jump)

    def _settled(self, t: float, u: Array) -> tuple[Array, End, Iterations] | None:
        """Return the stable state near an unstable one to which pushes along its lowest mode lead; None if there is none.

        Where surfaces slip from vertex to vertex, the energy of their barrier falls by a small amount and rises again. Without
        friction, K then has a negative eigenvalue, but the body moves less than the surfaces are apart. Both directions of the mode
        must lead to such a state.
        """
        problem, mesh = self.problem, self.problem.system.mesh
        distance = min(contact.distance for contact in problem.system.contacts)
        if np.isinf(distance) or stability_of(problem, u, t).stable:
            return None
        mode, states = lowest_mode(problem, u, t).vector, []
        for push in (PUSH * distance, -PUSH * distance):
            found = self._newton(u + push / np.abs(mode).max() * mode, t, False)
            if isinstance(found, Attempt):
                return None
            moved = np.sqrt(((found[0] - u).reshape(-1, mesh.d) ** 2).sum(axis=1).max())
            if moved > distance / 2 or not stability_of(problem, found[0], t).stable:
                return None
            found[2].detail = SETTLED.format(moved=moved, m=problem.system.units.of("m"))
            states.append(found)
        return states[0]

    def _equilibrium(self, before: Point, start: Array, t: float) -> Array | None:
        """Find the state at `t` after the state `before`, to the precision needed to detect a jump; None if it is not found."""
        if len(self.problem.inside_out(start)) > self._allowed or not self.problem.way_is_free(before.u, start, before.t):
            start = self.problem.body.prescribe(before.u.copy(), t)
        u, end, _ = newton(self.problem, start, t, NewtonOptions(max(self._rtol, LOOSE), self._allowed))
        return u if end.converged else None

    def _extrapolated(self, t: float) -> Array | None:
        """Extrapolate the last two states to `t`; None if they are equal, or after a failed step."""
        before = self._previous
        if not self.next.straight or not self.problem.states.comm.any(not np.array_equal(self.u, before.u)):
            return None
        return self.u + (t - self.t) / (self.t - before.t) * (self.u - before.u)

    def _start(self, t: float) -> Array:
        u = self._extrapolated(t)
        if u is not None:
            self.problem.body.prescribe(u, t)
            if len(self.problem.inside_out(u)) <= self._allowed and self.problem.way_is_free(self.u, u, self.t):
                return u
        move = self.problem.body.prescribe(self.u.copy(), t) - self.u
        return self._moved_with_supports(move, t) if self.problem.states.comm.any(bool(move.any())) else self.u + move

    def _moved_with_supports(self, move: Array, t: float) -> Array:
        """Return the state with constrained degrees of freedom moved by `move`, and the others by the tangent's response."""
        problem = self.problem
        for tangent in Tangent:
            factors = problem.factorise(self.u, t, tangent)
            solution = problem.solve(factors, -problem.force_of(move), 1e-3)
            if usable(solution):
                move = move + problem.space.expand(solution.x)
                break
        return self.u + move


#: Function that finds the equilibrium at a load factor, from a state before it and a starting point near it; it returns None on
#: failure.
Solve = Callable[[Point, Array, float], "Array | None"]


class JumpDetector:
    """Jump detection between two states at the ends of a load step.

    If the body follows its path, the tangents at both ends predict the other end, once the step is small enough. After a snap they
    do not, for any step size. Therefore a step without this agreement is halved: the equilibrium in the middle is computed, and the
    first half is checked before the second.
    """

    def __init__(self, problem: Equilibrium, solve: Solve) -> None:
        self._problem, self._solve, self._remaining = problem, solve, MOST_SOLVES

    def jump(self, before: Point, after: Point) -> float | None:
        """Return the size of the jump, as in `Step.jump`; None if no jump is found."""
        if self._is_straight(before, after):
            return None
        try:
            return self._jump(before, after, MOST_HALVINGS)
        except StateError:
            return None

    def _is_straight(self, before: Point, after: Point) -> bool:
        """Return whether the elastic force along the straight line between the states, a cubic, is nearly linear.

        Then the load never had to decrease.
        """
        body = self._problem.body
        if not body.quartic:
            return False
        c = body.energy_along(before.u, after.u - before.u)
        return bool(0.75 * abs(c[3]) + 1.54 * abs(c[4]) <= STRAIGHT * abs(2 * c[2] + 3 * c[3] + 4 * c[4]))

    def _jump(self, before: Point, after: Point, halvings: int, largest: float = 0.0) -> float | None:
        """Return the size of the jump as in `jump`, by recursive halving.

        `largest` is the largest prediction error over the longer parts that contain this part.
        """
        norm, forward = self._problem.states.norm, self._tangent_response(before, after.t)
        if forward is None or not norm(forward):
            return None
        error = norm(after.u - before.u - forward) / norm(forward)
        if error <= NEAR and self._predicts_before(before, after):
            return None
        largest = max(largest, error)
        middle = self._middle(before, after, forward) if halvings and self._remaining else None
        if middle is None:
            return largest if largest > JUMPED else None
        first = self._jump(before, middle, halvings - 1, largest)
        return self._jump(middle, after, halvings - 1, largest) if first is None else first

    def _predicts_before(self, before: Point, after: Point) -> bool:
        backward = self._tangent_response(after, before.t)
        norm = self._problem.states.norm
        return backward is not None and norm(before.u - after.u - backward) <= NEAR * norm(backward)

    def _middle(self, before: Point, after: Point, forward: Array) -> Point | None:
        self._remaining -= 1
        t = (before.t + after.t) / 2
        u = self._solve(before, self._problem.body.prescribe(before.u + forward / 2, t), t)
        return None if u is None else Point(u, t)

    def _tangent_response(self, state: Point, t: float) -> Array | None:
        """Return the tangent's response (ndofs,) at a state to loads and supports at `t`; None if the solve fails."""
        problem = self._problem
        factors = problem.factorise(state.u, state.t)
        forces, moves = problem.change(state.u, state.t, t)
        solution = problem.solve(factors, forces, 1e-3)
        finite = not problem.space.comm.any(not np.isfinite(solution.x).all())
        return moves + problem.space.expand(solution.x) if usable(solution) and finite else None
