"""The eigenpairs of (K, M) nearest to zero where K is not symmetric, by Arnoldi's method on the inverse of what is shifted a little."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eig, eigh
from scipy.sparse.linalg import LinearOperator

from ..arguments import Array
from .shift_invert import FEW, MORE, SAME, ShiftedProblem, first_shift, krylov

#: Directions of which less is left beside the others are rounding.
SHORT = 1e-10


def nearest_vectors(problem: ShiftedProblem, u: Array, n: int) -> Array:
    """(n_free, m) real vectors, m >= n, whose span has the modes of the n eigenvalues nearest to zero at `u` (ndofs,).

    Complex modes come in pairs `x, conj(x)`, which the real and the imaginary part of x span.
    """
    unknowns = len(problem.free.free)
    if unknowns < FEW * (n + MORE):
        values, vectors = eig(*problem.matrices(u))
        return _real_basis(problem, vectors[:, np.argsort(np.abs(values))[:n]])
    return _all_nearest(problem, problem.inverse(u, first_shift(problem, u)), n)


def _all_nearest(problem: ShiftedProblem, inverse: LinearOperator, n: int) -> Array:
    """As `nearest_vectors`; searched again across all that was found until nothing there is nearer, as where K is symmetric.

    What is found spans an invariant subspace, so that the eigenvalues which are left are those of the operator across it in M.
    """
    values, vectors = krylov(problem, inverse, n + MORE, np.empty((inverse.shape[0], 0)))
    basis, distances = _real_basis(problem, vectors), np.abs(values + problem.shift)
    while True:
        value, vector = krylov(problem, inverse, 1, basis)
        distance = np.abs(value + problem.shift)
        if distance[0] >= (1 - SAME) * np.sort(distances)[n - 1]:
            return basis
        basis, distances = _real_basis(problem, np.hstack([basis, vector])), np.append(distances, distance)


def _real_basis(problem: ShiftedProblem, vectors: Array) -> Array:
    """(n_free, m) real vectors, orthonormal in M, that span the real and imaginary parts of the columns of `vectors`."""
    parts = np.hstack([vectors.real, vectors.imag])
    momenta = np.array([problem.momentum(part) for part in parts.T]).T
    sizes, c = eigh(parts.T @ momenta)
    kept = sizes > SHORT * sizes.max()
    basis: Array = parts @ (c[:, kept] / np.sqrt(sizes[kept]))
    return basis
