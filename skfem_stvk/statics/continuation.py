"""Continuation of a path: its tangent, and the equilibrium in a plane across it, in displacements and load factor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..arguments import Array
from ..errors import StateError
from ..nonlinear.newton import End, Iterations, arrived, usable
from .equilibrium import Equilibrium

#: Iterations at most; a step that needs more is too long.
MOST_IN_PLANE = 12
#: A state is in the plane if it is no further from it than this part of the step.
IN_PLANE = 1e-10


@dataclass(frozen=True)
class Heading:
    """The tangent of the path at a state, `du/ds` and `dt/ds`, `s` the length of the path in displacements."""

    direction: Array  # (ndofs,) `du/ds`, of length one
    rate: float  # `dt/ds` [1/m]; it changes its sign at limit points
    negative: int | None  # how many eigenvalues of K are negative; None if K is not symmetric or a pivot says nothing

    def reversed(self) -> Heading:
        """The heading that goes the other way."""
        return Heading(-self.direction, -self.rate, self.negative)

    def along(self, v: Array, problem: Equilibrium) -> Heading:
        """This heading or the reversed one, whichever does not point against `v` (ndofs,)."""
        return self if problem.states.dot(self.direction, v) >= 0 else self.reversed()


def heading(problem: Equilibrium, u: Array, t: float, singular: bool = False) -> Heading | str:
    """Towards growing t at an equilibrium: `K du = -dr/dt dt`; or why there is none. `singular` as in `usable`."""
    factors = problem.factorise(u, t)
    forces, held = problem.rate(u, t)
    solution = problem.solve(factors, forces, 1e-10)
    if not usable(solution, singular):
        return solution.outcome.value
    rate = held + problem.space.expand(solution.x)
    length = problem.states.norm(rate)
    if length == 0:
        return "nothing moves as the load grows"
    return Heading(rate / length, 1 / length, problem.negative_pivots())


@dataclass(frozen=True)
class Hyperplane:
    """The states with `normal . u + weight t = value`.

    Across the path it is that of Riks (1979), `weight` 0: it goes through limit points, where t turns back and displacements do
    not. With `normal` 0 it holds the load, with `weight` 0 and a mean of displacements as `normal` it holds those.
    """

    normal: Array
    weight: float
    value: float
    reach: float  # how far it is from the state before, in the units of `value`

    def miss(self, u: Array, t: float, problem: Equilibrium) -> float:
        """How far the state is from it."""
        return self.value - problem.states.dot(self.normal, u) - self.weight * t


def correct(
    problem: Equilibrium, u: Array, t: float, plane: Hyperplane, rtol: float, watch: Callable[[float, Iterations], None]
) -> tuple[Array, float, End, Iterations]:
    """The equilibrium in the plane, from `u` (ndofs,) and `t` near it, by full steps of the exact tangent.

    Each solves `K a = -r` and `K b = -dr/dt` with one factorisation, `du = a + dt b`, and `dt` from the plane: K alone may be as
    good as singular, at a limit point, where `a` and `b` are large and their sum is not.
    """
    record, before = Iterations(), None
    try:
        while True:
            u = problem.body.prescribe(u.copy(), t)
            residual = problem.residual(u, t)
            record.residuals.append(residual.relative)
            watch(t, record)
            miss = plane.miss(u, t, problem)
            if abs(miss) <= IN_PLANE * abs(plane.reach):
                end = arrived(problem, u, t, residual, before, rtol)
                if end is not None:
                    return u, t, end, record
            if len(record) == MOST_IN_PLANE:
                return u, t, End.OUT_OF_ITERATIONS, record
            factors = problem.factorise(u, t)
            forces, moves = problem.rate(u, t)
            a, b = (problem.solve(factors, right, 1e-8) for right in (-residual.vector, forces))
            if not (usable(a, singular=True) and usable(b, singular=True)):
                record.detail = (b if usable(a, singular=True) else a).outcome.value
                return u, t, End.NO_DESCENT, record
            x, y = problem.space.expand(a.x), moves + problem.space.expand(b.x)
            slope = problem.states.dot(plane.normal, y) + plane.weight
            if slope == 0:
                return u, t, End.NO_LENGTH, record
            dt = (miss - problem.states.dot(plane.normal, x)) / slope
            u, t, before = u + x + dt * y, t + dt, residual
            if not np.isfinite(t):
                return u, t, End.OVERFLOW, record
            record.lengths.append(1.0)
            record.tangents.append("exact")
            record.linear.append(a.iterations + b.iterations)
    except StateError as error:
        record.detail = str(error)
        return u, t, End.OVERFLOW, record
