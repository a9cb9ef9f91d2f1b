"""The lowest eigenpairs of (K, M), by Lanczos' method on the inverse of what is shifted below all of them."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.linalg import eigh
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs, eigsh

from ..arguments import Array
from ..edges import Tensions
from ..errors import StvkError
from ..linear import Factors, Kind, LinearSolver, Outcome
from ..nonlinear.newton import usable
from ..nonlinear.stopwatch import Stopwatch
from ..statics.equilibrium import Equilibrium
from ..system import FreeOperator, System
from ..system.mass import Mass
from ..terms.load import Time
from .largest import bound_on_eigenvalues

#: The shift, as a part of the largest eigenvalue divided by the square of the number of vertices in a row.
SHIFT = 1e-2
#: It grows by this factor until nothing is below it, so many times at most.
GROWTH, MOST = 10.0, 12
#: Modes more than asked for, so that the last ones of a multiple eigenvalue are not missed; of fewer unknowns than so many times the modes,
#: the matrices are dense.
MORE, FEW = 4, 4
#: Eigenvalues, counted from the shift, that are this close together are one.
SAME = 1e-6
#: Residual of iterative solvers.
PRECISION = 1e-10


class Indefinite(Exception):
    """There are eigenvalues below the shift."""


class ShiftedProblem(Equilibrium):
    """`K + shift M` over the free degrees of freedom, with the part in K of loads that depend on the displacements.

    Parameters
    ----------
    kind : what K is; "symmetric" also where loads follow the body, if it comes out so.
    t : when those loads act.
    """

    def __init__(self, system: System, solver: LinearSolver, mass: Mass, kind: Kind, t: Time) -> None:
        if solver.matrix_free and mass.kind != "lumped":
            raise StvkError(
                f"mass = {mass.kind!r} came with solver '{solver.name}', which forms no matrix; expected 'lumped', or another solver."
            )
        self.mass, self.shift, self._t = mass, 0.0, t
        super().__init__(system, solver, Stopwatch())
        self._kind = kind

    @property
    def kind(self) -> Kind:
        """What K is."""
        return self._kind

    def matrices(self, u: Array) -> tuple[Array, Array]:
        """K and M over the free degrees of freedom, dense."""
        ids = np.ix_(self.free.free, self.free.free)
        return self.system.jacobian(u, self._t).toarray().astype(np.float64)[ids], self.mass.matrix.toarray()[ids]

    def stiffness(self, u: Array) -> Any:
        """K, as a matrix or as an operator."""
        return self.system.linear_operator(u) if self.solver.matrix_free else self.system.jacobian(u, self._t)

    def inverse(self, u: Array, shift: float) -> LinearOperator:
        """`r -> (K + shift M)^-1 r`; raises Indefinite where eigenvalues are below `-shift`, now or when it is applied."""
        self.shift = shift
        factors = self.factorise(u, self._t)
        if factors.negative_pivots:
            raise Indefinite
        n = len(self.free.free)
        return LinearOperator((n, n), matvec=lambda r: self._answer(factors, np.ravel(r)), dtype=np.float64)

    def momentum(self, x: Array) -> Array:
        """`M x` over the free degrees of freedom."""
        everywhere = np.zeros(self.system.ndofs)
        everywhere[self.free.free] = x
        return self.mass.multiply(everywhere)[self.free.free]

    def _answer(self, factors: Factors, r: Array) -> Array:
        solution = self.solve(factors, r, PRECISION)
        if solution.outcome is Outcome.NEGATIVE_CURVATURE:
            raise Indefinite
        if not usable(solution):
            raise StvkError(f"Modes: solver '{self.solver.name}' failed: {solution.outcome.value}. Take another solver=.")
        return solution.x

    def _jacobian(self, u: Array, t: Any, kept: Tensions) -> csr_matrix:
        K = super()._jacobian(u, t, kept)
        self.mass.add_to(K, self.shift)
        return K

    def _free_operator(self, u: Array, kept: Tensions, shifted: bool) -> FreeOperator:
        vertex = self.free.free // self.system.mesh.d
        return FreeOperator(self._prepare(u, kept), self.free, self.shift * self.mass.vertex[vertex])


def lowest_vectors(problem: ShiftedProblem, u: Array, n: int) -> Array:
    """(n_free, m) vectors, m >= n, that span the modes of the n lowest eigenvalues at `u` (ndofs,)."""
    unknowns = len(problem.free.free)
    if unknowns < FEW * (n + MORE):
        K, M = problem.matrices(u)
        return np.asarray(eigh(K, M, subset_by_index=[0, n - 1])[1])
    for shift in first_shift(problem, u) * GROWTH ** np.arange(MOST):
        try:
            return _all_lowest(problem, problem.inverse(u, shift), n)
        except Indefinite:
            continue
    raise StvkError("Modes: K has eigenvalues below anything that could be shifted. Is `u` a state of equilibrium?")


def first_shift(problem: ShiftedProblem, u: Array) -> float:
    """Small against the lowest eigenvalues of a body that is about as long as thick, and large against rounding [1/s^2]."""
    mesh = problem.system.mesh
    bound = bound_on_eigenvalues(problem.system.linear_operator(u), problem.mass.vertex)
    return SHIFT * bound / mesh.nv ** (2 / mesh.k)


def _all_lowest(problem: ShiftedProblem, inverse: LinearOperator, n: int) -> Array:
    """Vectors that span the n lowest modes and some more.

    From one vector Lanczos' method sees one direction of the space of a multiple eigenvalue, and the others by what rounding leaves of them. So it is
    asked again for what is across all that it has found, until nothing there belongs to the n lowest.
    """
    values, vectors = krylov(problem, inverse, n + MORE, np.empty((inverse.shape[0], 0)))
    while True:
        value, vector = krylov(problem, inverse, 1, vectors)
        last = np.sort(values)[n - 1] + problem.shift  # above zero, however many rigid modes there are
        if value[0] + problem.shift >= (1 - SAME) * last:
            return vectors
        values, vectors = np.append(values, value), np.hstack([vectors, vector])


def krylov(problem: ShiftedProblem, inverse: LinearOperator, n: int, known: Array) -> tuple[Array, Array]:
    """Eigenvalues and vectors (n_free, n) nearest to the shift, M-orthogonal to those that are known, from always the same start on.

    By Lanczos' method, or Arnoldi's where K is not symmetric; values and vectors may be complex then.
    """
    momenta = np.array([problem.momentum(vector) for vector in known.T]).reshape(known.T.shape)

    def solved(r: Array) -> Array:
        x = inverse @ (np.ravel(r) - momenta.T @ (known.T @ np.ravel(r)))
        return np.asarray(x - known @ (momenta @ x))

    M = LinearOperator(inverse.shape, matvec=lambda x: problem.momentum(np.ravel(x)), dtype=np.float64)
    start = np.random.default_rng(known.shape[1]).standard_normal(inverse.shape[0])
    start -= known @ (momenta @ start)
    tolerance = PRECISION if problem.solver.iterative else 0.0
    across = LinearOperator(inverse.shape, matvec=solved, dtype=np.float64)
    solve = eigs if problem.kind is Kind.GENERAL else eigsh
    try:
        values, vectors = solve(across, n, M, sigma=-problem.shift, OPinv=across, v0=start, tol=tolerance)
        return values, vectors
    except ArpackNoConvergence as error:
        raise StvkError(f"Modes: {len(error.eigenvalues)} of {n} were found. Ask for fewer, or for a direct solver=.") from error
