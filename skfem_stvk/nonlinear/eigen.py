"""Eigenvalues of the tangent over the free degrees of freedom: those that say whether a state is stable."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse.linalg import LinearOperator, eigsh, lobpcg

from ..arguments import Array
from ..linear import Kind
from ..linear.choose import direct
from ..linear.inertia import COUNTED, ROUNDING, eigenvalues_below, shifted
from .newton import usable
from .problem import EigenProblem, Tangent

#: Of the eigenvalue; the mode is good to its square root.
PRECISION = 1e-6
#: Iterations at most, of the inverse iteration and of LOBPCG; vectors of LOBPCG.
MOST_INVERSE, MOST_LOBPCG, BLOCK = 50, 60, 4
#: The lowest eigenvalue is found when its residual is below this part of it.
GOOD = 0.1


@dataclass(frozen=True)
class Mode:
    """An eigenvalue of K [N/m] and its eigenvector (ndofs,), of length one; `error` is how far from an eigenvalue it is at most."""

    value: float
    vector: Array
    error: float = 0.0


def nearest_mode(problem: EigenProblem, u: Array, t: float, without: Sequence[Array] = ()) -> Mode | None:
    """The mode nearest to zero, at right angles to those `without`, by inverse iteration; None if K is exactly singular."""
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
    """The lowest eigenvalue by LOBPCG (Knyazev 2001), preconditioned by loose solves with the tangent without negative tensions.

    Where that does not converge, as in slender bodies, up to `COUNTED` unknowns by factorisations. A value within rounding is 0: it
    has no sign.
    """
    mode, floor = _by_lobpcg(problem, u, t), rounding(problem, u, t)
    if mode.error > GOOD * abs(mode.value) and problem.space.n <= COUNTED:
        mode = _by_factorisation(problem, u, t, mode.value, floor)
    return mode if abs(mode.value) > floor else replace(mode, value=0.0)


def rounding(problem: EigenProblem, u: Array, t: float) -> float:
    """`8 eps |K|` [N/m]: eigenvalues below have no sign but that of rounding."""
    return ROUNDING * problem.stiffness_norm(u, t)


def _by_lobpcg(problem: EigenProblem, u: Array, t: float) -> Mode:
    factors = problem.factorise(u, t, Tangent.CLAMPED)
    K = problem.operator(u, t)
    M = LinearOperator(K.shape, matvec=lambda r: problem.solve(factors, np.ravel(r), 0.1).x, dtype=np.float64)
    X = np.stack([problem.space.random(seed) for seed in range(min(BLOCK, max(K.shape[0] // 5, 1)))], axis=1)
    with warnings.catch_warnings():  # what it has when it stops is an upper bound, and good enough for a sign
        warnings.simplefilter("ignore")
        values, vectors = lobpcg(K, X, M=M, largest=False, tol=None, maxiter=MOST_LOBPCG)
    first = int(np.argmin(values))
    value, x = float(values[first]), _unit(problem, vectors[:, first])
    y = K @ x - value * x
    return Mode(value, problem.space.expand(x), problem.space.norm(y))


def _by_factorisation(problem: EigenProblem, u: Array, t: float, above: float, floor: float) -> Mode:
    """The lowest mode by inverse iteration from a shift below all eigenvalues; `above` is not below the lowest one."""
    K, unknowns = problem.matrix(u, t)
    shift = -max(2 * abs(min(above, 0.0)), 4 * floor)
    while eigenvalues_below(K, shift, unknowns):
        shift *= 16
    solve = direct(unknowns.n).analyse(unknowns).factorise(shifted(K, shift), Kind.SYMMETRIC).solve
    inverse = LinearOperator(K.shape, matvec=lambda r: solve(np.ravel(r), 1e-10).x, dtype=np.float64)
    start = problem.space.random()
    values, vectors = eigsh(K, 1, sigma=shift, OPinv=inverse, v0=start)
    return Mode(float(values[0]), problem.space.expand(_unit(problem, vectors[:, 0])))


def _unit(problem: EigenProblem, x: Array) -> Array:
    return x / problem.space.norm(x)
