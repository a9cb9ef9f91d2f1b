"""Whether a step of the load, however large, follows the path: whether the body snapped or buckled on the way."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..arguments import Array
from ..errors import StateError
from ..nonlinear.newton import usable
from ..nonlinear.problem import PathProblem
from .history import JUMPED

#: A force along the straight way to the next state that is off a straight line by less than this part of its growth tells of no snap.
STRAIGHT = 0.1
#: States this near to where the tangents at both of them point, as a part of the way, lie on one path.
NEAR = 0.5
#: A step is halved so often, and so many states in between are looked for at most.
HALVED, MOST = 6, 16


class State(NamedTuple):
    """An equilibrium on the path: load factor and displacements (ndofs,)."""

    t: float
    u: Array


#: The equilibrium at a load factor, looked for from a state before it and from displacements (ndofs,) near it; None if it is not found.
Solve = Callable[[State, Array, float], "Array | None"]


class Between:
    """The way between two states that a step of the load led from and to.

    A body that follows its path is where the tangents at both ends say, once the step is small enough. One that snapped is not, however
    small it is. So a step that is not is halved: the equilibrium in the middle is found, and both halves are looked at, those before first.
    """

    def __init__(self, problem: PathProblem, solve: Solve) -> None:
        self._problem, self._solve, self._left = problem, solve, MOST

    def jump(self, before: State, after: State) -> float | None:
        """How far the state that the body jumped to is from where the path pointed, as `Step.jump` has it; None where no jump is found."""
        if self._is_straight(before, after):
            return None
        try:
            return self._jump(before, after, HALVED)
        except StateError:
            return None

    def _is_straight(self, before: State, after: State) -> bool:
        """Whether the elastic force along the straight way, a cubic, is about linear: no load had to fall on it."""
        c = self._problem.elastic_along(before.u, after.u - before.u)
        return c is not None and bool(0.75 * abs(c[3]) + 1.54 * abs(c[4]) <= STRAIGHT * abs(2 * c[2] + 3 * c[3] + 4 * c[4]))

    def _jump(self, before: State, after: State, halved: int, most: float = 0.0) -> float | None:
        """`most`: how far off states were in the longer parts of the step that hold this one."""
        norm, forward = self._problem.norm, self._answer(before, after.t)
        if forward is None or not norm(forward):
            return None
        off = norm(after.u - before.u - forward) / norm(forward)
        if off <= NEAR and self._points_back(before, after):
            return None
        most = max(most, off)
        middle = self._middle(before, after, forward) if halved and self._left else None
        if middle is None:
            return most if most > JUMPED else None
        first = self._jump(before, middle, halved - 1, most)
        return self._jump(middle, after, halved - 1, most) if first is None else first

    def _points_back(self, before: State, after: State) -> bool:
        backward = self._answer(after, before.t)
        norm = self._problem.norm
        return backward is not None and norm(before.u - after.u - backward) <= NEAR * norm(backward)

    def _middle(self, before: State, after: State, forward: Array) -> State | None:
        self._left -= 1
        t = (before.t + after.t) / 2
        start = self._problem.place(before.u + forward / 2, t)
        u = self._solve(before, start, t)
        return None if u is None else State(t, u)

    def _answer(self, state: State, t: float) -> Array | None:
        """(ndofs,) the displacements with which the tangent at a state answers loads and supports at `t`; None if it cannot."""
        problem = self._problem
        factors = problem.factorise(state.u, state.t)
        forces, moves = problem.change(state.u, state.t, t)
        solution = problem.solve(factors, forces, 1e-3)
        return moves + problem.direction(solution.x) if usable(solution) and np.isfinite(solution.x).all() else None
