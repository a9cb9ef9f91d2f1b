"""Predictor and corrector of arc-length continuation: the tangent of a path, and the equilibrium in a plane across it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...arguments import Array
from ...errors import StateError
from ..newton.newton import End, Iterations, equilibrium_end, usable
from .equilibrium import Equilibrium

#: Largest number of iterations. A step that needs more is too long.
MOST_IN_PLANE = 12
#: Tolerance of a state's distance from the plane, as a fraction of the step.
IN_PLANE = 1e-10


@dataclass(frozen=True)
class PathTangent:
    """Unit tangent of the path at a state: `du/ds` and `dt/ds`, with the path length `s` measured in displacements."""

    direction: Array  # (ndofs,) `du/ds`, of length one
    rate: float  # `dt/ds` [1/m]; it changes its sign at limit points
    negative: int | None  # number of negative eigenvalues of K; None if K is not symmetric or a pivot is too small

    def reversed(self) -> PathTangent:
        """Return the opposite tangent."""
        return PathTangent(-self.direction, -self.rate, self.negative)

    def along(self, v: Array, problem: Equilibrium) -> PathTangent:
        """Return this tangent or the opposite one, so that the result does not point against `v` (ndofs,)."""
        return self if problem.states.dot(self.direction, v) >= 0 else self.reversed()


def path_tangent(problem: Equilibrium, u: Array, t: float, singular: bool = False) -> PathTangent | str:
    """Return the path tangent towards growing `t` at an equilibrium, from `K du = -dr/dt dt`.

    If there is no tangent, return the reason. `singular` as in `usable`.
    """
    factors = problem.factorise(u, t)
    forces, constrained = problem.rate(u, t)
    solution = problem.solve(factors, forces, 1e-10)
    if not usable(solution, singular):
        return solution.outcome.value
    rate = constrained + problem.space.expand(solution.x)
    length = problem.states.norm(rate)
    if length == 0:
        return "no displacement changes as the load grows"
    return PathTangent(rate / length, 1 / length, problem.negative_pivots())


@dataclass(frozen=True)
class Hyperplane:
    """Set of states with `normal . u + weight t = value`.

    With `weight` 0 and the tangent as `normal`, it is the plane of Riks (1979) across the path. This plane crosses limit points,
    where `t` reverses and displacements do not. With `normal` 0 the plane prescribes the load. With `weight` 0 and `normal` an
    average of displacements, it prescribes this average.
    """

    normal: Array
    weight: float
    value: float
    reach: float  # distance of the plane from the previous state, in the units of `value`

    def miss(self, u: Array, t: float, problem: Equilibrium) -> float:
        """Return the distance of the state `(u, t)` from the plane, in the units of `value`."""
        return self.value - problem.states.dot(self.normal, u) - self.weight * t


def correct(
    problem: Equilibrium, u: Array, t: float, plane: Hyperplane, rtol: float, watch: Callable[[float, Iterations], None]
) -> tuple[Array, float, End, Iterations]:
    """Find the equilibrium in the plane by full steps of the exact tangent, starting from `u` (ndofs,) and `t` near it.

    Each step solves `K a = -r` and `K b = -dr/dt` with one factorisation. The update is `du = a + dt b`, with `dt` from the
    equation of the plane. At a limit point K may be nearly singular. There `a` and `b` are large, but their sum is not. A step
    that would pass through a contact ends the iteration.
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
                end = equilibrium_end(problem, u, t, residual, before, rtol)
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
            if not np.isfinite(t + dt):
                return u, t, End.OVERFLOW, record
            limit, contact = problem.contact_limit(u, x + dt * y, t)
            if limit <= 1:
                record.detail = f"{contact!r}"
                return u, t, End.CONTACT, record
            u, t, before = u + x + dt * y, t + dt, residual
            record.lengths.append(1.0)
            record.tangents.append("exact")
            record.linear.append(a.iterations + b.iterations)
    except StateError as error:
        record.detail = str(error)
        return u, t, End.OVERFLOW, record
