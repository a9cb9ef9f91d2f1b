"""Static stability of an equilibrium, from the eigenvalues of its tangent."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs

from ...arguments import Array
from ...linear import Factors, Kind, Outcome, Solution, SuperLU, Unknowns
from ...linear.choose import COUNTED, ROUNDING, direct, eigenvalues_below, inertia, transposition
from ...space import Space
from .eigen import lowest_mode, rounding
from .problem import EigenProblem

NO_FLUTTER = "K is not symmetric there: no real eigenvalue of it is negative, so the state does not diverge; flutter not checked."
NO_SIGN = "Whether the state is stable is not known: the eigenvalue of K nearest to zero is within rounding."
NOT_FOUND = (
    "Whether the state is stable is not known: conjugate gradients did not converge, and the lowest eigenvalue of K was not found "
    "to one digit. Try solver='superlu' or 'pardiso', which count the negative ones."
)
ON_PARTS = (
    "Eigenvalues of K were not counted, because K is distributed over the parts of the body: only a linear solve with a random "
    "force looked for a direction in which the body gives way, and the path may have passed a branch."
)
UNKNOWN_ON_PARTS = (
    "Whether the state is stable is not known: {reason}, and eigenvalues of K were not counted, because K is distributed over the "
    "parts of the body. The path may have passed a branch."
)
NOT_COUNTED = "Whether the state is stable is not known: pivots of K were too small to have a sign."

#: Number of unknowns up to which all eigenvalues are computed. For larger problems: first and largest number of eigenvalues near
#: zero.
DENSE, FIRST, MOST = 200, 6, 24
#: An imaginary part below this fraction of the eigenvalue is the round-off of two nearly equal real eigenvalues.
REAL = float(np.sqrt(np.finfo(float).eps))


class Verdict(NamedTuple):
    """Result of a stability check of a state."""

    stable: bool  # False if a negative eigenvalue of K was found; True also if nothing is known, see `doubt`
    negative: int | None  # number of negative eigenvalues, only real ones if K is not symmetric; None if not counted
    doubt: str = ""  # sentence on what was not checked or is not known; empty if there is nothing to report


def stability_of(problem: EigenProblem, u: Array, t: float) -> Verdict:
    """Return the stability of the state `u` (ndofs,) at `t`, from its tangent.

    The pivots of a direct solver count negative eigenvalues, those of PETSc in a divided body, too. CG does not count them. Instead
    it solves for a random force, which excites every buckling mode. CG then meets negative curvature if there is any, or its own
    round-off. A negative or undecided result, of CG or of the pivots, is therefore confirmed by eigenvalues. They must be negative
    beyond round-off.
    """
    factors = problem.factorise(u, t)
    negative = problem.negative_pivots()
    if problem.space.comm.divided:
        if negative is not None:
            return Verdict(not negative, negative)
        return _on_parts(problem, problem.solve(factors, problem.space.random(), 1e-4), u, t)
    if not problem.symmetric:
        return _divergence(problem, u, t)
    if negative == 0:
        return Verdict(True, 0)
    if problem.iterative and negative is None:
        force = problem.space.random()
        if problem.solve(factors, force, 1e-4).outcome is Outcome.SOLVED:
            return Verdict(True, None)
    return _confirmed(problem, u, t)


def _on_parts(problem: EigenProblem, solution: Solution, u: Array, t: float) -> Verdict:
    """Return the verdict for a divided body, from the solution for a random force alone.

    A quotient `p'Kp / p'p` is an upper bound of the lowest eigenvalue. If it is negative beyond round-off, the state is unstable.
    """
    if not problem.symmetric:
        return Verdict(True, None, UNKNOWN_ON_PARTS.format(reason="K is not symmetric"))
    if solution.outcome is Outcome.SOLVED:
        return Verdict(True, None, ON_PARTS)
    negative = solution.outcome is Outcome.NEGATIVE_CURVATURE
    if negative and (np.isnan(solution.curvature) or solution.curvature < -rounding(problem, u, t)):
        return Verdict(False, None)
    return Verdict(True, None, UNKNOWN_ON_PARTS.format(reason="a linear solve with a random force did not converge"))


def _confirmed(problem: EigenProblem, u: Array, t: float) -> Verdict:
    """Return the verdict by factorisation, for a direct solver or up to `COUNTED` unknowns; otherwise by the lowest eigenvalue."""
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
    """Return the verdict for a tangent that is not symmetric: unstable if a real eigenvalue is negative."""
    found = real_eigenvalues(*problem.matrix(u, t))
    if found.negative:
        return Verdict(False, found.negative)
    if found.unsigned:
        return Verdict(True, None, f"{NO_SIGN} K is not symmetric there; flutter not checked.")
    if found.complete:
        return Verdict(True, 0, NO_FLUTTER)
    computed = f"only its {found.computed} eigenvalues nearest to zero were computed, and none of them is negative"
    return Verdict(True, None, f"K is not symmetric there: {computed}; flutter not checked.")


class RealEigenvalues(NamedTuple):
    """Numbers of real eigenvalues by sign."""

    negative: int  # found below `-8 eps |K|`; at least 1 where the determinant is negative
    unsigned: int  # between `-8 eps |K|` and `8 eps |K|`
    complete: bool  # whether no other eigenvalue can be negative
    computed: int  # number of eigenvalues checked, those nearest to zero


def real_eigenvalues(K: csr_matrix, unknowns: Unknowns) -> RealEigenvalues:
    """Return the numbers of real eigenvalues of `K`, which has a symmetric pattern and unsymmetric values.

    Every real eigenvalue lies above the lowest eigenvalue of the symmetric part `S = (K + K')/2`. If `S` is positive definite, no
    real eigenvalue is negative. Otherwise ARPACK finds the eigenvalues nearest to zero by inverse iteration (shift and invert at
    0). They all lie in a circle around 0. No other real eigenvalue is negative if `S` has no eigenvalue below minus the radius. The
    determinant is the product of all eigenvalues. If it is negative, the number of negative real eigenvalues is odd.
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
        if found.negative or found.unsigned or found.complete or number == MOST:
            break
        number *= 2
    return found._replace(negative=found.negative + 1) if odd and not found.negative % 2 else found


def _factors(K: csr_matrix, unknowns: Unknowns) -> tuple[Factors, bool | None]:
    """Return the factors of K, and whether its determinant is negative; None if the factors do not provide the sign."""
    if unknowns.n > COUNTED:
        return direct(unknowns.n).analyse(unknowns).factorise(K, Kind.GENERAL), None
    factors = SuperLU().analyse(unknowns).factorise(K, Kind.GENERAL)
    return factors, factors.negative_determinant


def _counted(values: Array, floor: float, complete: bool) -> RealEigenvalues:
    real = values.real[np.abs(values.imag) <= np.maximum(REAL * np.abs(values), floor)]
    negative, unsigned = int((real < -floor).sum()), int((np.abs(real) <= floor).sum())
    return RealEigenvalues(negative, unsigned, complete, len(values))


def _nearest(K: csr_matrix, inverse: LinearOperator, number: int) -> Array:
    """Return the `number` eigenvalues nearest to zero, or fewer if ARPACK does not find all of them."""
    start = Space(K.shape[0]).random()
    try:
        values = eigs(K, number, sigma=0.0, OPinv=inverse, v0=start, tol=1e-8, return_eigenvectors=False)
    except ArpackNoConvergence as error:
        values = error.eigenvalues
    return np.asarray(values)
