"""Static stability of an equilibrium, and the eigenvalues of its tangent over the unknowns, whose signs decide it."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs, eigsh, lobpcg

from ...arguments import Array
from ...linear import Factors, Kind, Outcome, Solution, SuperLU, Unknowns
from ...linear.choose import COUNTED, ROUNDING, direct, eigenvalues_below, inertia, shifted, transposition
from ...space import Space
from .newton import usable
from .problem import EigenProblem, Tangent

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


#: Relative precision of the eigenvalue; the error of the mode is its square root.
PRECISION = 1e-6
#: Largest numbers of inverse iterations and of LOBPCG iterations; number of vectors in LOBPCG.
MOST_INVERSE, MOST_LOBPCG, BLOCK = 50, 60, 4
#: The lowest eigenvalue is found when its residual is below this part of it.
GOOD = 0.1


@dataclass(frozen=True)
class Mode:
    """Eigenvalue of K [N/m] with its eigenvector (ndofs,) of length one.

    `error` is an upper bound of the distance from `value` to the nearest eigenvalue.
    """

    value: float
    vector: Array
    error: float = 0.0


def nearest_mode(problem: EigenProblem, u: Array, t: float, without: Sequence[Array] = ()) -> Mode | None:
    """Return the mode with the eigenvalue nearest to zero, by inverse iteration; None if K is exactly singular.

    The search is limited to vectors orthogonal to the modes in `without`.
    """
    factors = problem.factorise(u, t)
    others = [_unit(problem, problem.space.restrict(mode)) for mode in without]
    x = _unit(problem, problem.space.random())
    value = np.inf
    for _ in range(MOST_INVERSE):
        solution = problem.solve(factors, x, 1e-6)
        if not usable(solution, singular=True):
            return None
        y = solution.x
        for other in others:
            y = y - problem.space.dot(other, y) * other
        before, last, value = x, value, problem.space.dot(x, y) / problem.space.dot(y, y)  # the Rayleigh quotient of y, for K y = x
        x = _unit(problem, y)
        if abs(value - last) <= PRECISION * abs(value) or 1 - abs(problem.space.dot(before, x)) <= PRECISION**2:
            break
    return Mode(value, problem.space.expand(x))


def lowest_mode(problem: EigenProblem, u: Array, t: float) -> Mode:
    """Return the lowest eigenvalue by LOBPCG (Knyazev 2001) and its mode.

    The preconditioner is an inexact solve with the tangent without negative tensions.

    LOBPCG may not converge, for example in slender bodies. Then factorisations are used, for up to `COUNTED` unknowns. A value
    below round-off has no sign and is returned as 0.
    """
    mode, floor = _by_lobpcg(problem, u, t), rounding(problem, u, t)
    if mode.error > GOOD * abs(mode.value) and problem.space.n <= COUNTED:
        mode = _by_factorisation(problem, u, t, mode.value, floor)
    return mode if abs(mode.value) > floor else replace(mode, value=0.0)


def rounding(problem: EigenProblem, u: Array, t: float) -> float:
    """Return the round-off limit `8 eps |K|` [N/m]. The sign of an eigenvalue below this limit is round-off."""
    return ROUNDING * problem.stiffness_norm(u, t)


def _by_lobpcg(problem: EigenProblem, u: Array, t: float) -> Mode:
    factors = problem.factorise(u, t, Tangent.CLAMPED)
    K = problem.operator(u, t)
    M = LinearOperator(K.shape, matvec=lambda r: problem.solve(factors, np.ravel(r), 0.1).x, dtype=np.float64)
    X = np.stack([problem.space.random(seed) for seed in range(min(BLOCK, max(K.shape[0] // 5, 1)))], axis=1)
    with warnings.catch_warnings():  # an unconverged value is still an upper bound, and precise enough for a sign
        warnings.simplefilter("ignore")
        values, vectors = lobpcg(K, X, M=M, largest=False, tol=None, maxiter=MOST_LOBPCG)
    first = int(np.argmin(values))
    value, x = float(values[first]), _unit(problem, vectors[:, first])
    y = K @ x - value * x
    return Mode(value, problem.space.expand(x), problem.space.norm(y))


def _by_factorisation(problem: EigenProblem, u: Array, t: float, upper_bound: float, floor: float) -> Mode:
    """Return the lowest mode by inverse iteration with a shift below all eigenvalues.

    `upper_bound` is an upper bound of the lowest eigenvalue.
    """
    K, unknowns = problem.matrix(u, t)
    shift = -max(2 * abs(min(upper_bound, 0.0)), 4 * floor)
    while eigenvalues_below(K, shift, unknowns):
        shift *= 16
    solve = direct(unknowns.n).analyse(unknowns).factorise(shifted(K, shift), Kind.SYMMETRIC).solve
    inverse = LinearOperator(K.shape, matvec=lambda r: solve(np.ravel(r), 1e-10).x, dtype=np.float64)
    start = problem.space.random()
    values, vectors = eigsh(K, 1, sigma=shift, OPinv=inverse, v0=start)
    return Mode(float(values[0]), problem.space.expand(_unit(problem, vectors[:, 0])))


def _unit(problem: EigenProblem, x: Array) -> Array:
    return x / problem.space.norm(x)
