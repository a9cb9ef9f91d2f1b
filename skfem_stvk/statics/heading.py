"""Which way a path of equilibria goes on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arguments import Array
from ..nonlinear.newton import usable
from ..nonlinear.problem import PathProblem


@dataclass(frozen=True)
class Heading:
    """The tangent of the path at a state, `du/ds` and `dt/ds`, `s` the length of the path in displacements.

    Attributes
    ----------
    direction : (ndofs,) `du/ds`, of length one.
    rate : `dt/ds` [1/m]; it changes its sign at limit points.
    negative : how many eigenvalues of K are negative; None if K is not symmetric or a pivot says nothing.
    """

    direction: Array
    rate: float
    negative: int | None

    def reversed(self) -> Heading:
        """The other way."""
        return Heading(-self.direction, -self.rate, self.negative)

    def along(self, v: Array, problem: PathProblem) -> Heading:
        """This way or the other, whichever does not point against `v` (ndofs,)."""
        return self if problem.dot(self.direction, v) >= 0 else self.reversed()


def heading(problem: PathProblem, u: Array, t: float, singular: bool = False) -> Heading | str:
    """Towards growing t at an equilibrium: `K du = -dr/dt dt`; or why there is none. `singular`: as of `usable`."""
    factors = problem.factorise(u, t)
    forces, held = problem.rate(u, t)
    solution = problem.solve(factors, forces, 1e-10)
    if not usable(solution, singular):
        return solution.outcome.value
    rate = held + problem.direction(solution.x)
    length = float(np.sqrt(problem.dot(rate, rate)))
    if length == 0:
        return "nothing moves as the load grows"
    return Heading(rate / length, 1 / length, problem.negative_pivots())
