"""The path from the first load to the full one, in steps of the load that adapt."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from ..arguments import Array
from ..nonlinear.newton import MOST_FULL, newton, usable
from ..nonlinear.problem import Tangent
from .between import Between, State
from .history import JUMPED, Attempt, Step
from .walk import SMALLEST, Walk

#: A step that took no more iterations lets the next one grow, by this factor, up to this many times the first one.
FEW, GROWTH, LARGEST = 5, 1.5, 4.0
#: From here on a state is so far from where the path pointed that it is looked at what happened in between, with residuals below `LOOSE`.
FAR, LOOSE = 2.0, 1e-6


class LoadSteps(Walk):
    """States under loads that grow up to t = 1, the first step `first`.

    A step starts where the two states before it point to, or, after one that failed, from the last state, with the tangent's answer to the
    prescribed displacements. It is halved when Newton's method fails or would turn elements inside out.
    """

    name: ClassVar[str] = "load-steps"

    def __init__(self, first: float, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._first = self._size = first
        self._before: tuple[float, Array] | None = None
        self._full_first = True

    def saved(self) -> dict[str, Any]:
        return super().saved() | {"straight": self._before is not None, "full_first": self._full_first}

    def resume(self, steps: list[Step], saved: dict[str, Any]) -> None:
        start = self.t, self.u
        super().resume(steps, saved)
        self._full_first = saved["full_first"]
        before = (steps[-2].t, steps[-2].u) if len(steps) > 1 else start
        self._before = before if saved["straight"] else None

    def _advance(self) -> Step | Attempt | None:
        if self._size < SMALLEST * self._first:
            return None
        t = self.t + self._size if self.t + 1.001 * self._size < 1 else 1.0
        self._size = t - self.t
        start, pointed = self._start(t), self._pointed(t)
        found = self._newton(start, t, self._full_first)
        if isinstance(found, Attempt):
            self._before, self._full_first = None, True
            self._size /= 2
            return found
        u, end, record = found
        jump = None if pointed is None else self.problem.norm(u - pointed) / self.problem.norm(pointed - self.u)
        if jump is None or jump > FAR:
            looked = Between(self.problem, self._equilibrium).jump(State(self.t, self.u), State(t, u))
            jump = looked if looked is not None or (jump or 0.0) > JUMPED else jump
        self._full_first = record.restarted is None and len(record) <= MOST_FULL
        self._before = self.t, self.u
        if len(record) <= FEW:
            self._size = min(GROWTH * self._size, LARGEST * self._first)
        self.reached = t == 1
        return self._accept(t, u, end, record, jump=jump)

    def _equilibrium(self, before: State, start: Array, t: float) -> Array | None:
        """The state at `t` on the way from one before, to the precision that telling a jump takes."""
        if len(self.problem.inside_out(start)) > self._allowed or not self.problem.on_this_side(before.u, start):
            start = self.problem.place(before.u.copy(), t)
        u, end, _ = newton(self.problem, start, t, max(self._rtol, LOOSE), self._allowed, lambda record: None, full_first=True)
        return u if end.converged else None

    def _pointed(self, t: float) -> Array | None:
        """Where the last two states point to, if they are not the same."""
        if self._before is None or np.array_equal(self.u, self._before[1]):
            return None
        t_before, u_before = self._before
        return self.u + (t - self.t) / (self.t - t_before) * (self.u - u_before)

    def _start(self, t: float) -> Array:
        u = self._pointed(t)
        if u is not None:
            self.problem.place(u, t)
            if len(self.problem.inside_out(u)) <= self._allowed and self.problem.on_this_side(self.u, u):
                return u
        move = self.problem.place(self.u.copy(), t) - self.u
        return self.u + move if not move.any() else self._carried(move, t)

    def _carried(self, move: Array, t: float) -> Array:
        """The state moved by `move` at the held degrees of freedom, and the others as the tangent answers it."""
        problem = self.problem
        for tangent in Tangent:
            factors = problem.factorise(self.u, t, tangent)
            solution = problem.solve(factors, -problem.force_of(move), 1e-3)
            if usable(solution):
                move = move + problem.direction(solution.x)
                break
        return self.u + move
