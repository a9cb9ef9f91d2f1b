"""Whether a state of equilibrium is stable, as far as statics can tell: by the eigenvalues of its tangent."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arguments import Array
from ..linear import Outcome
from ..linear.inertia import COUNTED, inertia
from .divergence import real_eigenvalues
from .eigen import lowest_mode, rounding
from .problem import EigenProblem

NO_FLUTTER = "K is not symmetric there: no real eigenvalue of it is negative, so the state does not diverge; flutter not looked at."
NO_SIGN = "Whether the state is stable is not known: the eigenvalue of K nearest to zero is within rounding."
NOT_FOUND = (
    "Whether the state is stable is not known: conjugate gradients did not get through, and the lowest eigenvalue of K was not found "
    "to a digit. Try solver='superlu' or 'pardiso', which count the negative ones."
)
NOT_COUNTED = "Whether the state is stable is not known: pivots of K were too small to have a sign."


class Verdict(NamedTuple):
    """What is known of the stability of a state.

    Attributes
    ----------
    stable : False where an eigenvalue of K was found to be negative. True also where nothing is known; `doubt` says so then.
    negative : how many eigenvalues are negative, of a K that is not symmetric how many real ones; None if they were not counted.
    doubt : what was not looked at or is not known, in a sentence; empty if there is nothing to say.
    """

    stable: bool
    negative: int | None
    doubt: str = ""


def judged(problem: EigenProblem, u: Array, t: float) -> Verdict:
    """What the tangent says of the state `u` (ndofs,) at `t`.

    The pivots of a direct solver count negative eigenvalues. CG does not count; it solves for a random force, in which every mode of buckling
    takes part, and meets negative curvature if there is any, or its own round-off. So what CG says against a state, or does not know, is
    confirmed before it counts, and so are pivots: by eigenvalues that are negative beyond rounding.
    """
    factors = problem.factorise(u, t)
    if not problem.symmetric:
        return _divergence(problem, u, t)
    negative = problem.negative_pivots()
    if negative == 0:
        return Verdict(True, 0)
    if problem.iterative:
        force = np.random.default_rng(0).standard_normal(problem.n)
        if problem.solve(factors, force, 1e-4).outcome is Outcome.SOLVED:
            return Verdict(True, None)
    return _confirmed(problem, u, t)


def _confirmed(problem: EigenProblem, u: Array, t: float) -> Verdict:
    """By factorisation, up to `COUNTED` unknowns and where that is how the problem is solved; otherwise by the lowest eigenvalue."""
    if not problem.iterative or problem.n <= COUNTED:
        counts = inertia(*problem.matrix(u, t))
        if counts is None:
            return Verdict(True, None, NOT_COUNTED)
        return Verdict(not counts.negative, counts.negative, NO_SIGN if counts.unsigned and not counts.negative else "")
    mode, floor = lowest_mode(problem, u, t), rounding(problem, u, t)
    if mode.value < -floor:
        return Verdict(False, None)
    return Verdict(True, None, "" if mode.value - mode.error > floor else NO_SIGN if abs(mode.value) <= floor else NOT_FOUND)


def _divergence(problem: EigenProblem, u: Array, t: float) -> Verdict:
    """Of a tangent that is not symmetric: whether a real eigenvalue is negative."""
    found = real_eigenvalues(*problem.matrix(u, t))
    if found.negative:
        return Verdict(False, found.negative)
    if found.unsigned:
        return Verdict(True, None, f"{NO_SIGN} K is not symmetric there; flutter not looked at.")
    if found.all_of_them:
        return Verdict(True, 0, NO_FLUTTER)
    looked = f"of its eigenvalues only the {found.looked_at} nearest to zero were looked at, none of which is negative"
    return Verdict(True, None, f"K is not symmetric there: {looked}; flutter not looked at.")
