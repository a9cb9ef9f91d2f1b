"""Whether a state of equilibrium is stable: whether its tangent is positive definite."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..linear import Outcome
from .equilibrium import Equilibrium

Array = NDArray[Any]


def is_stable(problem: Equilibrium, u: Array, t: float) -> tuple[bool, int | None]:
    """Whether nothing was found that makes the state unstable, and how many eigenvalues of K are negative if the solver counts them.

    CG does not count; it solves for a random force, in which every mode of buckling takes part, and meets negative curvature if there is
    any. Of follower loads, whose K is not symmetric, nothing is said.
    """
    factors = problem.factorise(u, t)
    negative = problem.negative_pivots()
    if negative is not None:
        return negative == 0, negative
    if not problem.solver.iterative:
        return True, None
    force = np.random.default_rng(0).standard_normal(len(problem.free.free))
    return problem.solve(factors, force, 1e-4).outcome is not Outcome.NEGATIVE_CURVATURE, None
