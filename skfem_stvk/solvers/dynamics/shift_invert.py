"""Eigenpairs of (K, M) next to zero: Lanczos' method on the inverse of a shifted K, or Arnoldi's if K is not symmetric."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.linalg import eig, eigh
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs, eigsh

from ...arguments import Array
from ...errors import StvkError
from ...linear import Factors, Kind, LinearSolver, Outcome
from ...system import FreeOperator, System
from ...system.free_tangent import FreeTangent
from ...system.mass import Mass
from ...terms.loads.load import Time
from ..newton.newton import usable
from .critical_step import bound_on_eigenvalues

#: First shift, as a part of the largest eigenvalue divided by the square of the number of vertices in a row.
SHIFT = 1e-2
#: Factor by which the shift grows until no eigenvalue is below it, and largest number of trials.
GROWTH, MOST = 10.0, 12
#: Number of additional modes to compute, so that the last ones of a multiple eigenvalue are not missed. The matrices are dense if
#: the number of unknowns is less than `FEW` times the number of modes.
MORE, FEW = 4, 4
#: Relative difference below which eigenvalues, measured from the shift, are treated as equal.
SAME = 1e-6
#: Relative length below which a direction, made orthogonal to the others, is only round-off.
SHORT = 1e-10
#: Relative residual of iterative solvers.
PRECISION = 1e-10


class Indefinite(Exception):
    """Error for a K with eigenvalues below the shift."""


class ShiftedProblem:
    """Matrix `K + shift M` over the free degrees of freedom at `u` (ndofs,). `kind` is that of K.

    K includes the stiffness of loads at `t` that depend on the displacements.
    """

    def __init__(self, system: System, solver: LinearSolver, mass: Mass, kind: Kind, u: Array, t: Time) -> None:
        if solver.matrix_free and mass.kind != "lumped":
            raise StvkError(
                f"Got mass = {mass.kind!r} with solver '{solver.name}', which forms no matrix; expected 'lumped' or another solver."
            )
        self.system, self.mass, self.kind, self.u, self.shift, self.t = system, mass, kind, u, 0.0, t
        self._tangent = FreeTangent(system, solver, kind)
        self._tangent.position = u
        self.free, self.space = self._tangent.free, self._tangent.space

    @property
    def iterative(self) -> bool:
        """Whether the linear solver is iterative."""
        return self._tangent.solver.iterative

    def matrices(self) -> tuple[Array, Array]:
        """Return K and M over the free degrees of freedom as dense arrays."""
        ids = np.ix_(self.free.free, self.free.free)
        return self.system.jacobian(self.u, self.t).toarray().astype(np.float64)[ids], self.mass.matrix.toarray()[ids]

    def stiffness(self) -> Any:
        """Return K of all degrees of freedom, as a matrix or as an operator."""
        return (
            self.system.linear_operator(self.u, t=self.t)
            if self._tangent.solver.matrix_free
            else self.system.jacobian(self.u, self.t)
        )

    def inverse(self, shift: float) -> LinearOperator:
        """Return the operator `r -> (K + shift M)^-1 r`.

        It raises Indefinite if there are eigenvalues below `-shift`, now or when it is applied.
        """
        self.shift = shift
        factors = self._tangent.factorise(self._shifted())
        if factors.negative_pivots:
            raise Indefinite
        return LinearOperator((self.space.n,) * 2, matvec=lambda r: self._answer(factors, np.ravel(r)), dtype=np.float64)

    def momentum(self, x: Array) -> Array:
        """Return `M x` over the free degrees of freedom."""
        return self.space.restrict(self.mass.multiply(self.space.expand(x)))

    def _shifted(self) -> FreeOperator | csr_matrix:
        if self._tangent.solver.matrix_free:
            vertex = self.free.free // self.system.mesh.d
            return FreeOperator(self._tangent.operator(self.u, self.t), self.free, self.shift * self.mass.vertex[vertex])
        K = self._tangent.free_matrix(self.u, self.t)
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
    """Return vectors (n_free, m), m >= n, that span the modes of the n lowest eigenvalues."""
    if problem.space.n < FEW * (n + MORE):
        K, M = problem.matrices()
        return np.asarray(eigh(K, M, subset_by_index=[0, n - 1])[1])
    for shift in first_shift(problem) * GROWTH ** np.arange(MOST):
        try:
            return _all_nearest(problem, problem.inverse(shift), n)
        except Indefinite:
            continue
    raise StvkError("Modes: K has eigenvalues below every shift that was tried. Is `u` a state of equilibrium?")


def first_shift(problem: ShiftedProblem) -> float:
    """Return the first shift [1/s^2].

    It is small compared with the lowest eigenvalues of a body that is about as long as thick, and large compared with round-off.
    """
    mesh = problem.system.mesh
    bound = bound_on_eigenvalues(problem.system.linear_operator(problem.u, t=problem.t), problem.mass.vertex)
    return SHIFT * bound / mesh.nv ** (2 / mesh.k)


def nearest_vectors(problem: ShiftedProblem, n: int) -> Array:
    """Return real vectors (n_free, m), m >= n, whose span contains the modes of the n eigenvalues nearest to zero.

    Complex modes form pairs `x, conj(x)`, which the real and the imaginary part of x span.
    """
    if problem.space.n < FEW * (n + MORE):
        values, vectors = eig(*problem.matrices())
        return _real_basis(problem, vectors[:, np.argsort(np.abs(values))[:n]])
    return _all_nearest(problem, problem.inverse(first_shift(problem)), n)


def _all_nearest(problem: ShiftedProblem, inverse: LinearOperator, n: int) -> Array:
    """Return vectors that span the n modes nearest to the shift, and some more.

    From one start vector, Lanczos' method finds one direction of the eigenspace of a multiple eigenvalue. It finds the others only
    through round-off. Therefore the search is repeated orthogonally to all vectors found, until no other mode is nearer. The
    vectors found span an invariant subspace. Hence the remaining eigenvalues are those of the operator on its complement,
    orthogonal in M.
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
    """Return real vectors (n_free, m), orthonormal in M, that span the real and imaginary parts of the columns of `vectors`."""
    parts = np.hstack([vectors.real, vectors.imag])
    momenta = np.array([problem.momentum(part) for part in parts.T]).T
    sizes, c = eigh(parts.T @ momenta)
    retained = sizes > SHORT * sizes.max()
    basis: Array = parts @ (c[:, retained] / np.sqrt(sizes[retained]))
    return basis


def krylov(problem: ShiftedProblem, inverse: LinearOperator, n: int, known: Array) -> tuple[Array, Array]:
    """Return the eigenvalues nearest to the shift and their vectors (n_free, n), M-orthogonal to the `known` vectors.

    The method is Lanczos', or Arnoldi's if K is not symmetric; then values and vectors may be complex. The start vector is always
    the same.
    """
    momenta = np.array([problem.momentum(vector) for vector in known.T]).reshape(known.T.shape)

    def solved(r: Array) -> Array:
        x = inverse @ (np.ravel(r) - momenta.T @ (known.T @ np.ravel(r)))
        return np.asarray(x - known @ (momenta @ x))

    # units in which the shift and the mass are about 1, because ARPACK treats eigenvalues of the inverse below 4e-11 as zero
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
        raise StvkError(f"Modes: {len(error.eigenvalues)} of {n} were found. Use a smaller n, or a direct solver=.") from error


def _power_of_two(size: float) -> float:
    """Return the power of two next to a size; 1 for zero. Division by it is exact."""
    return float(2.0 ** np.round(np.log2(size))) if size > 0 else 1.0
