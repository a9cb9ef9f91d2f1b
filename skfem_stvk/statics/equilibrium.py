"""The equilibrium of a body as a nonlinear problem: its residual, its tangents and how it moves as the load factor grows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ..arguments import Array
from ..edges import ALL, TENSILE
from ..errors import StateError
from ..linear import Factors, LinearSolver, Unknowns
from ..linear.choose import direct
from ..linear.inertia import COUNTED, inertia
from ..nonlinear.problem import Residual, Tangent
from ..nonlinear.stopwatch import Stopwatch
from ..results.monitors import named_elements
from ..system import FreeOperator, System
from ..system.coordinates import Coordinates, DenseTangent
from ..system.equation import Equation
from ..system.free_tangent import FreeTangent, kind_of
from ..system.round_off import EPS
from ..terms.load import Time

#: Loads and reactions below this part of the largest on the path count as this part: where they go back to zero, nothing else is
#: left to be small against.
NOTHING = 1e-6
#: How often on a path it is asked whether CG met negative curvature or its own round-off.
MOST_DOUBTS = 3
#: Linear solves of a body that is linear are as precise as this at least: one of them is all there is.
PRECISE = 1e-10
#: Part of the load factor, or of 1, over which loads and prescribed displacements are differenced; exact for what grows linearly.
DIFFERENCE = 1e-6


class Equilibrium(Equation):
    """`F(u) = f_ext(u, t)` over the free entries of the states of a body, an `EigenProblem`; its states form a path as t grows.

    Parameters
    ----------
    solver : the linear solver; None for a body on a basis, whose factors are dense.

    Attributes
    ----------
    largest : the largest of the forces on the path so far [N].
    """

    def __init__(self, body: System | Coordinates, solver: LinearSolver | None, watch: Stopwatch) -> None:
        with watch("factor"):
            tangent = DenseTangent(body) if isinstance(body, Coordinates) else _tangent(body, solver)
        super().__init__(body, tangent, watch)
        if body.constant_tangent:
            self.precise = PRECISE
        self.largest, self._doubts = 0.0, MOST_DOUBTS

    @property
    def symmetric(self) -> bool:
        return self.tangent.symmetric

    @property
    def quartic(self) -> bool:
        return self.system.dead and self.body.quartic

    def residual(self, u: Array, t: Time) -> Residual:
        with self._watch("assemble"):
            external = self.body.external_force(u, t)
            force = self.body.internal_force(u)
            force -= external
            free = self.space.restrict(force)
            size, scale = self.space.norm(free), self.tangent.scale(external, force)
            if not np.isfinite(size + scale):
                raise StateError(f"The residual overflows at displacements of up to {np.abs(self.states.expand(u)).max():.1e}.")
            return Residual(free, size, max(scale, NOTHING * self.largest))

    def round_off(self, u: Array, t: Time) -> float:
        with self._watch("assemble"):
            sums = self.tangent.round_off(u) + np.abs(self.body.external_force(u, t))
            return EPS * self.space.norm(self.space.restrict(sums))

    def factorise(self, u: Array, t: Time, tangent: Tangent = Tangent.EXACT) -> Factors:
        exact = tangent is Tangent.EXACT
        if exact and self.tangent.lasting is not None:
            return self.tangent.lasting
        with self._watch("assemble"):
            K = self.tangent.at(u, t, ALL if exact else TENSILE, tangent is Tangent.SHIFTED)
        with self._watch("factor"):
            return self.tangent.factorise(K, exact)

    def take_over(self, u: Array, t: Time) -> bool:
        """As in `Problem`: if a factorisation, up to `COUNTED` unknowns and a few times on a path, finds no negative eigenvalue."""
        if not self.iterative or self.space.n > COUNTED or not self._doubts:
            return False
        self._doubts -= 1
        counts = inertia(*self.matrix(u, t))
        if counts is None or counts.negative:
            return False
        with self._watch("factor"):
            self.tangent.take(direct(self.space.n))
        return True

    def matrix(self, u: Array, t: Time) -> tuple[csr_matrix, Unknowns]:
        with self._watch("assemble"):
            return self.tangent.beside(u, t)

    def operator(self, u: Array, t: Time) -> FreeOperator | csr_matrix:
        if not isinstance(self.tangent, FreeTangent) or not self.system.dead:  # the stiffness of loads is a matrix
            return self.matrix(u, t)[0]
        with self._watch("assemble"):
            return FreeOperator(self.system.linear_operator(u), self.tangent.free)

    def stiffness_norm(self, u: Array, t: Time) -> float:
        """The largest sum of a row of K, or twice that of the blocks of its diagonal [N/m]."""
        K = self.operator(u, t)
        if isinstance(K, csr_matrix):
            return float(abs(K).sum(axis=1).max())
        return 2 * float(np.abs(K.diagonal_blocks()).sum(axis=2).max())

    def energy_along(self, u: Array, v: Array, t: Time) -> Array:
        with self._watch("assemble"):
            c = self.body.energy_along(u, v)
            c[1] -= self.states.dot(self.body.external_force(u, t), v)
            return c

    def named(self, inside_out: NDArray[np.int64]) -> str:
        return named_elements(self.system.mesh, inside_out)

    def rate(self, u: Array, t: float) -> tuple[Array, Array]:
        """(n,) `-dr/dt` and the motion of constrained entries, a direction; by the tangent that was made last."""
        dt = DIFFERENCE * max(abs(t), 1.0) * (1 if t < 0.5 else -1)  # functions of t may end at 0 and 1
        forces, moves = self.change(u, t, t + dt)
        return forces / dt, moves / dt

    def change(self, u: Array, t: float, later: float) -> tuple[Array, Array]:
        """The change to `later`, as in `rate`: (n,) forces [N], and the motion of constrained entries."""
        with self._watch("assemble"):
            loads = self.body.external_force(u, later) - self.body.external_force(u, t)
        moves = self.body.prescribe(np.zeros(self.states.n), later) - self.body.prescribe(np.zeros(self.states.n), t)
        return self.space.restrict(loads) - self.force_of(moves), moves

    def accept(self, u: Array, t: Time) -> None:
        """Note that `u` is a state of the path: its forces are something that others are small against."""
        residual = self.residual(u, t)
        self.largest = max(self.largest, residual.scale, residual.size)

    def forget(self) -> None:
        """Drop what a solver keeps from the steps before, so that a path resumed here has the same numbers."""
        if self.tangent.lasting is None:
            self.tangent.forget()

    def energies(self, u: Array, t: Time) -> tuple[float, float]:
        """Strain energy and potential [J]; NaN if a term has no energy, or a load no potential."""
        with self._watch("assemble"):
            return sum(self.body.elastic_energies(u)), self.body.potential(u, t) if self.system.conservative else float("nan")


def _tangent(system: System, solver: LinearSolver | None) -> FreeTangent:
    assert solver is not None
    return FreeTangent(system, solver, kind_of(system))
