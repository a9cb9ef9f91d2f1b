"""Whether a state of equilibrium is stable, as far as statics can tell: by the eigenvalues of its tangent."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs

from ..arguments import Array
from ..linear import Factors, Kind, Outcome, SuperLU, Unknowns
from ..linear.choose import direct
from ..linear.inertia import COUNTED, ROUNDING, eigenvalues_below, inertia, transposition
from ..linear.space import Space
from .eigen import lowest_mode, rounding
from .problem import EigenProblem

NO_FLUTTER = "K is not symmetric there: no real eigenvalue of it is negative, so the state does not diverge; flutter not looked at."
NO_SIGN = "Whether the state is stable is not known: the eigenvalue of K nearest to zero is within rounding."
NOT_FOUND = (
    "Whether the state is stable is not known: conjugate gradients did not converge, and the lowest eigenvalue of K was not found "
    "to a digit. Try solver='superlu' or 'pardiso', which count the negative ones."
)
NOT_COUNTED = "Whether the state is stable is not known: pivots of K were too small to have a sign."

#: Unknowns up to which all eigenvalues are worked out; of more, so many nearest to zero, and so many at most.
DENSE, FIRST, MOST = 200, 6, 24
#: An imaginary part below this part of an eigenvalue is what rounding leaves of two real ones that are nearly the same.
REAL = float(np.sqrt(np.finfo(float).eps))


class Verdict(NamedTuple):
    """What is known of the stability of a state."""

    stable: bool  # False where an eigenvalue of K was found to be negative; True also where nothing is known, as `doubt` says then
    negative: int | None  # how many eigenvalues are, of a K that is not symmetric how many real ones; None if not counted
    doubt: str = ""  # what was not looked at or is not known, in a sentence; empty if there is nothing to say


def judged(problem: EigenProblem, u: Array, t: float) -> Verdict:
    """What the tangent says of the state `u` (ndofs,) at `t`.

    The pivots of a direct solver count negative eigenvalues. CG does not count; it solves for a random force, in which every mode
    of buckling takes part, and meets negative curvature if there is any, or its own round-off. So what CG says against a state, or
    does not know, is confirmed before it counts, and so are pivots: by eigenvalues that are negative beyond rounding.
    """
    factors = problem.factorise(u, t)
    if not problem.symmetric:
        return _divergence(problem, u, t)
    negative = problem.negative_pivots()
    if negative == 0:
        return Verdict(True, 0)
    if problem.iterative:
        force = problem.space.random()
        if problem.solve(factors, force, 1e-4).outcome is Outcome.SOLVED:
            return Verdict(True, None)
    return _confirmed(problem, u, t)


def _confirmed(problem: EigenProblem, u: Array, t: float) -> Verdict:
    """The verdict by factorisation, up to `COUNTED` unknowns and with a direct solver; otherwise by the lowest eigenvalue."""
    if not problem.iterative or problem.space.n <= COUNTED:
        counts = inertia(*problem.matrix(u, t))
        if counts is None:
            return Verdict(True, None, NOT_COUNTED)
        return Verdict(not counts.negative, counts.negative, NO_SIGN if counts.unsigned and not counts.negative else "")
    mode, floor = lowest_mode(problem, u, t), rounding(problem, u, t)
    if mode.value < -floor:
        return Verdict(False, None)
    return Verdict(True, None, "" if mode.value - mode.error > floor else NO_SIGN if abs(mode.value) <= floor else NOT_FOUND)


def _divergence(problem: EigenProblem, u: Array, t: float) -> Verdict:
    """The verdict on a tangent that is not symmetric: whether a real eigenvalue is negative."""
    found = real_eigenvalues(*problem.matrix(u, t))
    if found.negative:
        return Verdict(False, found.negative)
    if found.unsigned:
        return Verdict(True, None, f"{NO_SIGN} K is not symmetric there; flutter not looked at.")
    if found.all_of_them:
        return Verdict(True, 0, NO_FLUTTER)
    looked = f"of its eigenvalues only the {found.looked_at} nearest to zero were looked at, none of which is negative"
    return Verdict(True, None, f"K is not symmetric there: {looked}; flutter not looked at.")


class RealEigenvalues(NamedTuple):
    """Numbers of real eigenvalues."""

    negative: int  # below `-8 eps |K|`, those that were found; at least 1 where the determinant is negative
    unsigned: int  # between `-8 eps |K|` and `8 eps |K|`
    all_of_them: bool  # whether no others can be negative
    looked_at: int  # how many eigenvalues, those nearest to zero


def real_eigenvalues(K: csr_matrix, unknowns: Unknowns) -> RealEigenvalues:
    """Numbers of real eigenvalues of `K`, whose pattern is symmetric and whose values are not.

    Every real eigenvalue lies above the lowest one of the symmetric part `S = (K + K')/2`: where that is positive definite, none is
    negative. Otherwise the determinant, the product of all, is negative where their number is odd; and those nearest to zero are
    found by ARPACK, by inverse iteration (shift and invert at 0). They are all within a circle; no others are negative if S has no
    eigenvalue beyond it.
    """
    n = unknowns.n
    S = csr_matrix(((K.data + K.data[transposition(K)]) / 2, K.indices, K.indptr), shape=K.shape)
    counts = inertia(S, unknowns)
    if counts is not None and not counts.negative and not counts.unsigned:
        return RealEigenvalues(0, 0, True, n)
    floor = ROUNDING * float(abs(K).sum(axis=1).max())
    if n <= DENSE:
        return _counted(np.linalg.eigvals(K.toarray()), floor, True)
    factors, odd = _factors(K, unknowns)
    inverse = LinearOperator((n, n), matvec=lambda b: factors.solve(np.ravel(b), 1e-10).x, dtype=np.float64)
    number = FIRST
    while True:
        values = _nearest(K, inverse, number)
        reach = float(np.abs(values).max(initial=0.0))
        found = _counted(values, floor, bool(reach) and eigenvalues_below(S, -reach, unknowns) == 0)
        if found.negative or found.unsigned or found.all_of_them or number == MOST:
            break
        number *= 2
    return found._replace(negative=found.negative + 1) if odd and not found.negative % 2 else found


def _factors(K: csr_matrix, unknowns: Unknowns) -> tuple[Factors, bool | None]:
    """Factors of K, and whether its determinant is negative; None if they do not say."""
    if unknowns.n > COUNTED:
        return direct(unknowns.n).analyse(unknowns).factorise(K, Kind.GENERAL), None
    factors = SuperLU().analyse(unknowns).factorise(K, Kind.GENERAL)
    return factors, factors.negative_determinant


def _counted(values: Array, floor: float, all_of_them: bool) -> RealEigenvalues:
    real = values.real[np.abs(values.imag) <= np.maximum(REAL * np.abs(values), floor)]
    negative, unsigned = int((real < -floor).sum()), int((np.abs(real) <= floor).sum())
    return RealEigenvalues(negative, unsigned, all_of_them, len(values))


def _nearest(K: csr_matrix, inverse: LinearOperator, number: int) -> Array:
    """The eigenvalues nearest to zero, `number` of them or as many as were found."""
    start = Space(K.shape[0]).random()
    try:
        values = eigs(K, number, sigma=0.0, OPinv=inverse, v0=start, tol=1e-8, return_eigenvectors=False)
    except ArpackNoConvergence as error:
        values = error.eigenvalues
    return np.asarray(values)
