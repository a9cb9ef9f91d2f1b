"""Eigenpairs of (K, M) next to zero: Lanczos' method on the inverse of a shifted K, or Arnoldi's if K is not symmetric."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.linalg import eig, eigh
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs, eigsh

from ..arguments import Array
from ..errors import StvkError
from ..linear import Factors, Kind, LinearSolver, Outcome
from ..nonlinear.newton import usable
from ..system import FreeOperator, System
from ..system.free_tangent import FreeTangent
from ..system.mass import Mass
from ..terms.load import Time
from .critical_step import bound_on_eigenvalues

#: The shift, as a part of the largest eigenvalue divided by the square of the number of vertices in a row.
SHIFT = 1e-2
#: It grows by this factor until nothing is below it, so many times at most.
GROWTH, MOST = 10.0, 12
#: Modes more than asked for, so that the last ones of a multiple eigenvalue are not missed; of fewer unknowns than so many times
#: the modes, the matrices are dense.
MORE, FEW = 4, 4
#: Eigenvalues, counted from the shift, that are this close together are one.
SAME = 1e-6
#: Directions of which less is left beside the others are rounding.
SHORT = 1e-10
#: Residual of iterative solvers.
PRECISION = 1e-10


class Indefinite(Exception):
    """K has eigenvalues below the shift."""


class ShiftedProblem:
    """`K + shift M` over the free degrees of freedom at `u` (ndofs,), with loads at `t` that depend on it; `kind` is that of K."""

    def __init__(self, system: System, solver: LinearSolver, mass: Mass, kind: Kind, u: Array, t: Time) -> None:
        if solver.matrix_free and mass.kind != "lumped":
            raise StvkError(
                f"Got mass = {mass.kind!r} with solver '{solver.name}', which forms no matrix; expected 'lumped' or another solver."
            )
        self.system, self.mass, self.kind, self.u, self.shift, self._t = system, mass, kind, u, 0.0, t
        self._tangent = FreeTangent(system, solver, kind)
        self._tangent.position = u
        self.free, self.space = self._tangent.free, self._tangent.space

    @property
    def iterative(self) -> bool:
        """Whether linear solves iterate."""
        return self._tangent.solver.iterative

    def matrices(self) -> tuple[Array, Array]:
        """K and M over the free degrees of freedom, dense."""
        ids = np.ix_(self.free.free, self.free.free)
        return self.system.jacobian(self.u, self._t).toarray().astype(np.float64)[ids], self.mass.matrix.toarray()[ids]

    def stiffness(self) -> Any:
        """K of all degrees of freedom, as a matrix or as an operator."""
        return self.system.linear_operator(self.u) if self._tangent.solver.matrix_free else self.system.jacobian(self.u, self._t)

    def inverse(self, shift: float) -> LinearOperator:
        """`r -> (K + shift M)^-1 r`; raises Indefinite where eigenvalues are below `-shift`, now or when it is applied."""
        self.shift = shift
        factors = self._tangent.factorise(self._shifted())
        if factors.negative_pivots:
            raise Indefinite
        return LinearOperator((self.space.n,) * 2, matvec=lambda r: self._answer(factors, np.ravel(r)), dtype=np.float64)

    def momentum(self, x: Array) -> Array:
        """`M x` over the free degrees of freedom."""
        return self.space.restrict(self.mass.multiply(self.space.expand(x)))

    def _shifted(self) -> FreeOperator | csr_matrix:
        if self._tangent.solver.matrix_free:
            vertex = self.free.free // self.system.mesh.d
            return FreeOperator(self._tangent.operator(self.u), self.free, self.shift * self.mass.vertex[vertex])
        K = self._tangent.free_matrix(self.u, self._t)
        self.mass.add_to(K, self.shift, self.free)
        return K

    def _answer(self, factors: Factors, r: Array) -> Array:
        solution = factors.solve(r, PRECISION)
        if solution.outcome is Outcome.NEGATIVE_CURVATURE:
            raise Indefinite
        if not usable(solution):
            name = self._tangent.solver.name
            raise StvkError(f"Modes: solver '{name}' failed: {solution.outcome.value}. Take another solver=.")
        return solution.x


def lowest_vectors(problem: ShiftedProblem, n: int) -> Array:
    """(n_free, m) vectors, m >= n, that span the modes of the n lowest eigenvalues."""
    if problem.space.n < FEW * (n + MORE):
        K, M = problem.matrices()
        return np.asarray(eigh(K, M, subset_by_index=[0, n - 1])[1])
    for shift in first_shift(problem) * GROWTH ** np.arange(MOST):
        try:
            return _all_nearest(problem, problem.inverse(shift), n)
        except Indefinite:
            continue
    raise StvkError("Modes: K has eigenvalues below anything that could be shifted. Is `u` a state of equilibrium?")


def first_shift(problem: ShiftedProblem) -> float:
    """Small against the lowest eigenvalues of a body that is about as long as thick, and large against rounding [1/s^2]."""
    mesh = problem.system.mesh
    bound = bound_on_eigenvalues(problem.system.linear_operator(problem.u), problem.mass.vertex)
    return SHIFT * bound / mesh.nv ** (2 / mesh.k)


def nearest_vectors(problem: ShiftedProblem, n: int) -> Array:
    """(n_free, m) real vectors, m >= n, whose span has the modes of the n eigenvalues nearest to zero.

    Complex modes come in pairs `x, conj(x)`, which the real and the imaginary part of x span.
    """
    if problem.space.n < FEW * (n + MORE):
        values, vectors = eig(*problem.matrices())
        return _real_basis(problem, vectors[:, np.argsort(np.abs(values))[:n]])
    return _all_nearest(problem, problem.inverse(first_shift(problem)), n)


def _all_nearest(problem: ShiftedProblem, inverse: LinearOperator, n: int) -> Array:
    """Vectors that span the n modes nearest to the shift, and some more.

    From one vector Lanczos' method sees one direction of the space of a multiple eigenvalue, and the others by what rounding leaves
    of them. So the search is repeated across all vectors that were found, until no mode there is nearer. These span an invariant
    subspace, so that the eigenvalues which are left are those of the operator across it in M.
    """
    general = problem.kind is Kind.GENERAL
    values, vectors = krylov(problem, inverse, n + MORE, np.empty((inverse.shape[0], 0)))
    basis, distances = _real_basis(problem, vectors) if general else vectors, np.abs(values + problem.shift)
    while True:
        value, vector = krylov(problem, inverse, 1, basis)
        distance = np.abs(value + problem.shift)
        if distance[0] >= (1 - SAME) * np.sort(distances)[n - 1]:
            return basis
        more, distances = np.hstack([basis, vector]), np.append(distances, distance)
        basis = _real_basis(problem, more) if general else more


def _real_basis(problem: ShiftedProblem, vectors: Array) -> Array:
    """(n_free, m) real vectors, orthonormal in M, that span the real and imaginary parts of the columns of `vectors`."""
    parts = np.hstack([vectors.real, vectors.imag])
    momenta = np.array([problem.momentum(part) for part in parts.T]).T
    sizes, c = eigh(parts.T @ momenta)
    kept = sizes > SHORT * sizes.max()
    basis: Array = parts @ (c[:, kept] / np.sqrt(sizes[kept]))
    return basis


def krylov(problem: ShiftedProblem, inverse: LinearOperator, n: int, known: Array) -> tuple[Array, Array]:
    """Eigenvalues and vectors (n_free, n) nearest to the shift, M-orthogonal to those that are known.

    By Lanczos' method, or Arnoldi's where K is not symmetric; values and vectors may be complex then. The start is always the same.
    """
    momenta = np.array([problem.momentum(vector) for vector in known.T]).reshape(known.T.shape)

    def solved(r: Array) -> Array:
        x = inverse @ (np.ravel(r) - momenta.T @ (known.T @ np.ravel(r)))
        return np.asarray(x - known @ (momenta @ x))

    # units in which the shift and the mass are about 1: ARPACK takes eigenvalues of the inverse below 4e-11 for zero
    unit, mass = _power_of_two(problem.shift), _power_of_two(problem.mass.total)
    M = LinearOperator(inverse.shape, matvec=lambda x: problem.momentum(np.ravel(x)) / mass, dtype=np.float64)
    start = problem.space.random(known.shape[1])
    start -= known @ (momenta @ start)
    tolerance = PRECISION if problem.iterative else 0.0
    across = LinearOperator(inverse.shape, matvec=lambda r: unit * mass * solved(r), dtype=np.float64)
    solve = eigs if problem.kind is Kind.GENERAL else eigsh
    try:
        values, vectors = solve(across, n, M, sigma=-problem.shift / unit, OPinv=across, v0=start, tol=tolerance)
        return unit * values, vectors / np.sqrt(mass)
    except ArpackNoConvergence as error:
        raise StvkError(f"Modes: {len(error.eigenvalues)} of {n} were found. Ask for fewer, or for a direct solver=.") from error


def _power_of_two(size: float) -> float:
    """The power of two next to a size, to divide by which costs no digit; 1 of zero."""
    return float(2.0 ** np.round(np.log2(size))) if size > 0 else 1.0
