"""Eigenvalues of the tangent over the free degrees of freedom. Their signs say whether a state is stable."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse.linalg import LinearOperator, eigsh, lobpcg

from ...arguments import Array
from ...linear import Kind
from ...linear.choose import COUNTED, ROUNDING, direct, eigenvalues_below, shifted
from .newton import usable
from .problem import EigenProblem, Tangent

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
