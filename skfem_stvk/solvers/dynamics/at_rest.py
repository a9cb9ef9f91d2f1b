"""The tangent of a body at rest, for many linear solves."""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...errors import SupportError
from ...linear import Factors, Kind, LinearSolver, choose
from ...linear.choose import direct
from ...system import System
from ...system.free_tangent import FreeTangent
from ..newton.newton import usable

#: Residual of linear solves.
PRECISION = 1e-8
#: Largest number of unknowns for a direct solver. It factorises once and then solves for hundreds of right-hand sides.
MANY = 200_000


class AtRest:
    """K at rest over the free degrees of freedom, factorised once."""

    def __init__(self, body: System) -> None:
        self._body, n = body, body.ndofs - len(body.supports.held)
        self.solver: LinearSolver = direct(n) if n <= MANY else choose("auto", n, Kind.SYMMETRIC)
        self._tangent = FreeTangent(body, self.solver, Kind.SYMMETRIC)
        self.free = self._tangent.free.free
        self.K = self._tangent.restricted(self._tangent.matrix(np.zeros(body.ndofs), 0.0, follows=False))
        self._factors: Factors = self._tangent.factorise(self.K)

    def solve(self, force: Array) -> Array:
        """Return the displacements (ndofs,) [m] under a force (ndofs,) [N]. They are 0 at constrained degrees of freedom."""
        u = np.zeros(self._body.ndofs)
        u[self.free] = self.solve_free(force[self.free][:, None])[:, 0]
        return u

    def solve_free(self, forces: Array) -> Array:
        """Return the displacements (n, m) of the n free degrees of freedom under the m columns of forces (n, m)."""
        if hasattr(self._factors, "solve_many"):
            X = self._factors.solve_many(forces)
            misfit = np.abs(self.K @ X - forces).max(axis=0) / np.maximum(np.abs(forces).max(axis=0), np.finfo(float).tiny)
            if np.isfinite(X).all() and misfit.max(initial=0.0) <= PRECISION:
                return np.asarray(X)
        return np.array([self._solve_one(force) for force in forces.T]).T.reshape(forces.shape)

    def _solve_one(self, force: Array) -> Array:
        solution = self._factors.solve(force, PRECISION / 100)
        if not usable(solution):
            raise SupportError(
                f"The linear solver '{self.solver.name}' failed with K at rest: {solution.outcome.value}. Expected "
                "supports that leave no motion without strain. Does a part need more supports?"
            )
        return solution.x

    def follow(self, w: Array) -> Array:
        """Return the displacements (ndofs,) [m] due to the prescribed displacements `w` alone, without any load."""
        force = np.zeros(self._body.ndofs)
        force[self.free] = -self._tangent.force_of(w)
        return self.solve(force) + w
