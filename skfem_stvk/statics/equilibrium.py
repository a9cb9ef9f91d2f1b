"""The equilibrium of a system as a nonlinear problem: its residual, its tangents and how it moves as the load factor grows."""

from __future__ import annotations

from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ..arguments import Array
from ..edges import ALL, TENSILE
from ..errors import StateError
from ..linear import Factors, LinearSolver, Solution, Unknowns
from ..linear.choose import direct
from ..linear.inertia import COUNTED, inertia
from ..nonlinear.problem import PathProblem, Residual, Tangent
from ..nonlinear.stopwatch import Stopwatch
from ..results.monitors import named_elements
from ..system import FreeOperator, System
from ..system.free_tangent import FreeTangent, kind_of
from ..system.round_off import EPS, below, largest_error
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


class Named(Protocol):
    """What has a name."""

    @property
    def name(self) -> str: ...


class StaticProblem(PathProblem, Protocol):
    """A path of states of a body, of all its displacements or of the few coordinates of a basis."""

    @property
    def system(self) -> System:
        """The body with all its displacements."""

    @property
    def solver(self) -> LinearSolver | Named:
        """What solves linear systems now, by its name."""


class Equilibrium:
    """`F(u) = f_ext(u, t)` over the free degrees of freedom, a `PathProblem` whose states are displacements (ndofs,)."""

    def __init__(self, system: System, solver: LinearSolver, watch: Stopwatch) -> None:
        self.system, self._watch, self._u = system, watch, np.zeros(system.ndofs)
        self.largest, self._doubts = 0.0, MOST_DOUBTS
        with watch("factor"):
            self.tangent = FreeTangent(system, solver, kind_of(system), lambda: self._u)
        self.free, self.states = self.tangent.free, system.space
        self.space, self._held = self.states.on(self.free.free), self.states.on(self.free.fixed)

    @property
    def solver(self) -> LinearSolver:
        """What solves linear systems now."""
        return self.tangent.solver

    @property
    def iterative(self) -> bool:
        return self.solver.iterative

    @property
    def symmetric(self) -> bool:
        return self.tangent.symmetric

    @property
    def quartic(self) -> bool:
        return self.system.dead and self.system.quartic

    @property
    def dead(self) -> bool:
        return self.system.dead

    def residual(self, u: Array, t: Time) -> Residual:
        with self._watch("assemble"):
            external = self.system.external_force(u, t)
            force = self.system.internal_force(u)
            force -= external
            free = self.space.restrict(force)
            size, scale = self.space.norm(free), self.states.norm(external) + self._held.norm(self._held.restrict(force))
            if not np.isfinite(size + scale):
                raise StateError(f"The residual overflows at displacements of up to {np.abs(u).max():.1e}.")
            return Residual(free, size, max(scale, NOTHING * self.largest))

    def round_off(self, u: Array, t: Time) -> float:
        with self._watch("assemble"):
            sums = below(self._largest_error, self.system.round_off(u)) + np.abs(self.system.external_force(u, t))
            return EPS * self.space.norm(self.space.restrict(sums))

    @cached_property
    def _largest_error(self) -> Array:
        return largest_error(self.system)

    def factorise(self, u: Array, t: Time, tangent: Tangent = Tangent.EXACT) -> Factors:
        if tangent is Tangent.EXACT and self.tangent.lasting is not None:
            return self.tangent.lasting
        K: Any
        kept, shifted = ALL if tangent is Tangent.EXACT else TENSILE, tangent is Tangent.SHIFTED
        self._u = u
        with self._watch("assemble"):
            if self.solver.matrix_free:
                operator = self.tangent.operator(u, kept)
                shift = self.tangent.shift(self.tangent.diagonal_of(operator)) if shifted else None
                K = FreeOperator(operator, self.free, shift)
            else:
                K = self.tangent.free_matrix(u, t, kept)
                if shifted:
                    K.setdiag(K.diagonal() + self.tangent.shift(K.diagonal()))
        with self._watch("factor"):
            return self.tangent.factorise(K, exact=tangent is Tangent.EXACT)

    def solve(self, factors: Factors, b: Array, rtol: float) -> Solution:
        with self._watch("solve"):
            return factors.solve(b, min(rtol, PRECISE) if self.system.constant_tangent else rtol)

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

    def negative_pivots(self) -> int | None:
        with self._watch("factor"):
            return None if self.tangent.exact is None else self.tangent.exact.negative_pivots

    def matrix(self, u: Array, t: Time) -> tuple[csr_matrix, Unknowns]:
        with self._watch("assemble"):
            return self.tangent.beside(u, t)

    def operator(self, u: Array, t: Time) -> FreeOperator | csr_matrix:
        with self._watch("assemble"):
            return self.tangent.operator_beside(u, t)

    def stiffness_norm(self, u: Array, t: Time) -> float:
        """The largest sum of a row of K, or twice that of the blocks of its diagonal [N/m]."""
        K = self.operator(u, t)
        if isinstance(K, csr_matrix):
            return float(abs(K).sum(axis=1).max())
        return 2 * float(np.abs(K.diagonal_blocks()).sum(axis=2).max())

    def energy_along(self, u: Array, v: Array, t: Time) -> Array:
        with self._watch("assemble"):
            c = self.system.energy_along(u, v)
            c[1] -= self.states.dot(self.system.external_force(u, t), v)
            return c

    def step_limit(self, u: Array, v: Array) -> float:
        if self.system.constant_tangent:
            return float("inf")
        with self._watch("assemble"):
            return self.system.step_limit(u, v)

    def on_this_side(self, u: Array, found: Array) -> bool:
        """As in `Problem`; always true of states with elements inside out, which have to turn."""
        return len(self.inside_out(u)) > 0 or self.step_limit(u, found - u) > 1

    def inside_out(self, u: Array) -> NDArray[np.int64]:
        """As in `Problem`; none of a body that is linear: its one state is what it is, and no other way leads there."""
        if self.system.constant_tangent:
            return np.empty(0, dtype=np.int64)
        with self._watch("assemble"):
            return self.system.inside_out(u)

    def named(self, inside_out: NDArray[np.int64]) -> str:
        return named_elements(self.system.mesh, inside_out)

    def state(self, u: Array, t: Time) -> Array:
        return u

    def place(self, u: Array, t: float) -> Array:
        u[self.free.fixed] = self.system.supports.values(t)
        return u

    def rate(self, u: Array, t: float) -> tuple[Array, Array]:
        dt = DIFFERENCE * max(abs(t), 1.0) * (1 if t < 0.5 else -1)  # functions of t may end at 0 and 1
        forces, moves = self.change(u, t, t + dt)
        return forces / dt, moves / dt

    def change(self, u: Array, t: float, later: float) -> tuple[Array, Array]:
        with self._watch("assemble"):
            loads = self.system.external_force(u, later) - self.system.external_force(u, t)
        moves, held = np.zeros(self.system.ndofs), self.system.supports.values
        moves[self.free.fixed] = held(later) - held(t)
        return self.space.restrict(loads) - self.force_of(moves), moves

    def force_of(self, w: Array) -> Array:
        with self._watch("assemble"):
            return self.tangent.force_of(w)

    def accept(self, u: Array, t: Time) -> None:
        residual = self.residual(u, t)
        self.largest = max(self.largest, residual.scale, residual.size)

    def forget(self) -> None:
        if self.tangent.lasting is None:
            self.tangent.forget()

    def commit(self, u: Array) -> None:
        self.system.commit(u)

    def restore(self) -> None:
        self.system.restore()

    def energies(self, u: Array, t: Time) -> tuple[float, float]:
        with self._watch("assemble"):
            return sum(self.system.elastic_energies(u)), self.system.potential(u, t) if self.system.conservative else float("nan")

    def elastic_along(self, u: Array, v: Array) -> Array | None:
        return self.system.energy_along(u, v) if self.system.quartic else None

    def smallest_volume_ratio(self, u: Array) -> float:
        with self._watch("assemble"):
            return self.system.smallest_volume_ratio(u)
