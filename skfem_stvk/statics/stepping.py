"""The path from no load to the full one, in steps that adapt."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .equilibrium import Equilibrium, Tangent
from .history import Attempt, Step
from .newton import MOST_FULL, End, Iterations, newton, usable
from .status import Status

Array = NDArray[Any]

#: A step that took no more iterations lets the next one grow, by this factor, up to this many times the first one.
FEW, GROWTH, LARGEST = 5, 1.5, 4.0
#: Steps are halved down to this part of the first one.
SMALLEST = 1 / 1024


def follow(
    problem: Equilibrium, u0: Array, steps: int, rtol: float, iterating: Callable[[float, Iterations], None]
) -> Iterator[Step | Attempt]:
    """The states on the way from `u0` at t = 0 to t = 1, as far as there are any, and the attempts that failed in between.

    A step starts where the two before it point to, or, after one that failed, from the last state, with the tangent's answer to the
    prescribed displacements. It is halved when Newton's method fails or would turn elements inside out. `iterating(t, record)` is called
    at each iteration.
    """
    walk = _Walk(problem, rtol, iterating)
    at_zero = walk.begin(u0)
    if at_zero is not None:
        yield at_zero
    first = size = 1 / steps
    while walk.t < 1 and size >= SMALLEST * first and not isinstance(at_zero, Attempt):
        t = walk.t + size if walk.t + 1.001 * size < 1 else 1.0
        size = t - walk.t
        outcome = walk.to(t)
        yield outcome
        if isinstance(outcome, Attempt):
            size /= 2
        elif len(outcome.iterations) <= FEW:
            size = min(GROWTH * size, LARGEST * first)


class _Walk:
    """Where the path stands."""

    def __init__(self, problem: Equilibrium, rtol: float, iterating: Callable[[float, Iterations], None]) -> None:
        self._problem, self._rtol, self._iterating = problem, rtol, iterating
        self.t, self._clock = 0.0, perf_counter()
        self._before: tuple[float, Array] | None = None
        self._full_first, self._unstable = True, False

    def begin(self, u0: Array) -> Step | Attempt | None:
        """The state at t = 0: `u0`, unless something acts there already."""
        self._u, self._allowed = u0, len(self._problem.inside_out(u0))
        self._problem.accept(u0, 0.0)
        u = self._start(0.0)
        if not u.any() and self._problem.residual(u, 0.0).size == 0:
            return None
        return self._try(u, 0.0)

    def to(self, t: float) -> Step | Attempt:
        """The state at `t`; if the step fails, everything stays as it was."""
        return self._try(self._start(t), t)

    def _try(self, start: Array, t: float) -> Step | Attempt:
        problem = self._problem
        turned = problem.inside_out(start)
        if len(turned) > self._allowed:
            u, end, record = start, End.INSIDE_OUT, Iterations(detail=problem.named(turned))
        else:
            watch = partial(self._iterating, t)
            u, end, record = newton(problem, start, t, self._rtol, self._allowed, watch, self._full_first)
            self._full_first = record.restarted is None and len(record) <= MOST_FULL
        if not end.converged:
            self._before, self._full_first = None, True
            return Attempt(t, end, record)
        self._before = None if t == 0 else (self.t, self._u)
        self.t, self._u = t, u
        return self._step(end, record)

    def _step(self, end: End, record: Iterations) -> Step:
        """The state that was found, with what there is to say of it."""
        problem, u = self._problem, self._u
        problem.accept(u, self.t)
        self._allowed = len(problem.inside_out(u))
        if len(record):  # without a tangent it is as stable as the state before
            self._unstable = bool(record.negative_pivots)
        status = Status.INVERTED if self._allowed else Status.UNSTABLE if self._unstable else end.status
        now, before = perf_counter(), self._clock
        self._clock = now
        return Step(self.t, u, status, end, record, *problem.energies(u, self.t), problem.smallest_volume_ratio(u), now - before)

    def _start(self, t: float) -> Array:
        """Where Newton's method starts; its held degrees of freedom are where they belong at `t`."""
        held, goal = self._problem.free.fixed, self._problem.system.supports.values(t)
        if self._before is not None:
            t_before, u_before = self._before
            u = self._u + (t - self.t) / (self.t - t_before) * (self._u - u_before)
            u[held] = goal
            if len(self._problem.inside_out(u)) <= self._allowed:
                return u
        move = np.zeros_like(self._u)
        move[held] = goal - self._u[held]
        return self._u + move if not move.any() else self._carried(move, t)

    def _carried(self, move: Array, t: float) -> Array:
        """The state moved by `move` at the held degrees of freedom, and the others as the tangent answers it."""
        problem = self._problem
        for tangent in Tangent:
            factors = problem.factorise(self._u, t, tangent)
            solution = problem.solve(factors, -problem.force_of(move), 1e-3)
            if usable(solution):
                move = move + problem.free.vector(solution.x)
                break
        return self._u + move
