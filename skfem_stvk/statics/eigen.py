"""Eigenvalues of the tangent over the free degrees of freedom: those that say whether a state is stable."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, lobpcg

from .equilibrium import Equilibrium, Tangent, dot
from .newton import usable

Array = NDArray[Any]

#: Of the eigenvalue; the mode is good to its square root.
PRECISION = 1e-6
#: Iterations at most, of the inverse iteration and of LOBPCG; vectors of LOBPCG.
MOST_INVERSE, MOST_LOBPCG, BLOCK = 50, 60, 4


@dataclass(frozen=True)
class Mode:
    """An eigenvalue of K [N/m] and its eigenvector (ndofs,), of length one."""

    value: float
    vector: Array


def nearest_mode(problem: Equilibrium, u: Array, t: float, without: Sequence[Array] = ()) -> Mode | None:
    """The eigenvalue nearest to zero, by inverse iteration with a direct solver; None if K is exactly singular.

    `without` are modes (ndofs,) at right angles to which it is looked for.
    """
    factors = problem.factorise(u, t)
    others = [_unit(mode[problem.free.free]) for mode in without]
    x = _unit(np.random.default_rng(0).standard_normal(len(problem.free.free)))
    value = np.inf
    for _ in range(MOST_INVERSE):
        solution = problem.solve(factors, x, 1e-6)
        if not usable(solution, singular=True):
            return None
        y = solution.x
        for other in others:
            y = y - dot(other, y) * other
        before, last, value = x, value, dot(x, y) / dot(y, y)  # the Rayleigh quotient of y, for K y = x
        x = _unit(y)
        if abs(value - last) <= PRECISION * abs(value) or 1 - abs(dot(before, x)) <= PRECISION**2:
            break
    return Mode(value, problem.free.vector(x))


def lowest_mode(problem: Equilibrium, u: Array, t: float) -> Mode:
    """The lowest eigenvalue by LOBPCG (Knyazev 2001), preconditioned by loose solves with the tangent without negative tensions."""
    factors = problem.factorise(u, t, Tangent.CLAMPED)
    K = problem.operator(u)
    M = LinearOperator(K.shape, matvec=lambda r: problem.solve(factors, np.ravel(r), 0.1).x, dtype=np.float64)
    X = np.random.default_rng(0).standard_normal((K.shape[0], min(BLOCK, max(K.shape[0] // 5, 1))))
    with warnings.catch_warnings():  # what it has when it stops is an upper bound, and good enough for a sign
        warnings.simplefilter("ignore")
        values, vectors = lobpcg(K, X, M=M, largest=False, tol=None, maxiter=MOST_LOBPCG)
    first = int(np.argmin(values))
    return Mode(float(values[first]), problem.free.vector(_unit(vectors[:, first])))


def _unit(x: Array) -> Array:
    return x / np.sqrt(dot(x, x))
