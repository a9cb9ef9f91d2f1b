"""Equilibrium of a body as a nonlinear problem: residual and tangents, the tangent of its path, states in a plane across it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ...arguments import Array
from ...edges import ALL, TENSILE
from ...errors import StateError
from ...linear import Factors, LinearSolver, Unknowns
from ...linear.choose import COUNTED, direct, inertia
from ...results.monitors import named_elements
from ...system import FreeOperator, System
from ...system.coordinates import Coordinates, DenseTangent
from ...system.equation import Equation
from ...system.free_tangent import EPS, FreeTangent, kind_of
from ...terms.loads.load import Moment, StepStart, Time
from ..newton.newton import End, Iterations, equilibrium_end, usable
from ..newton.problem import Residual, Tangent
from ..newton.stopwatch import Stopwatch

#: Lower bound of the scale of the residual, as a fraction of the largest loads and reactions on the path. It applies where loads
#: and reactions return to zero.
SMALLEST_SCALE = 1e-6
#: Largest number of checks on a path whether CG met negative curvature or only its own round-off.
MOST_CHECKS = 3
#: Largest relative tolerance of the linear solves of a linear body, which needs only one solve.
PRECISE = 1e-10
#: Relative step of the load factor for finite differences of loads and prescribed displacements. They are exact for linear growth.
DIFFERENCE = 1e-6
#: Largest number of iterations. A step that needs more is too long.
MOST_IN_PLANE = 12
#: Tolerance of a state's distance from the plane, as a fraction of the step.
IN_PLANE = 1e-10


class Equilibrium(Equation):
    """Equilibrium `F(u) = f_ext(u, t)` over the free entries of the states of a body, an `EigenProblem`.

    Its states form a path as `t` grows.

    Parameters
    ----------
    solver
        The linear solver; None for a body on a basis, whose factors are dense.

    Attributes
    ----------
    largest
        Largest force scale on the path so far [N].
    step
        Beginning of the present step; None if no term has a history.
    """

    def __init__(self, body: System | Coordinates, solver: LinearSolver | None, watch: Stopwatch) -> None:
        with watch("factor"):
            tangent = DenseTangent(body) if isinstance(body, Coordinates) else _tangent(body, solver)
        super().__init__(body, tangent, watch)
        if body.constant_tangent:
            self.largest_rtol = PRECISE
        self.largest, self._checks_left = 0.0, MOST_CHECKS
        self.begin_step(body.first_history())

    def begin_step(self, history: tuple[Array, ...]) -> None:
        """Begin a step of the path with this history of the terms, such as friction."""
        self.step = StepStart(history, in_time=False) if history else None

    def moment(self, t: Time) -> Moment:
        """Return the load factor `t` within the present step."""
        return Moment.of(t)._replace(step=self.step)

    @property
    def symmetric(self) -> bool:
        return self.tangent.symmetric

    @property
    def quartic(self) -> bool:
        return self.system.dead and self.body.quartic

    def residual(self, u: Array, t: Time) -> Residual:
        with self._watch("assemble"):
            external = self.body.external_force(u, t)
            force = self.body.internal_force(u, self.moment(t))
            force -= external
            free = self.space.restrict(force)
            size, scale = self.space.norm(free), self.tangent.scale(external, force)
            if self.system.contacts:
                scale += self.states.norm(self.system.contact_force(u, self.moment(t)))
            if not np.isfinite(size + scale):
                largest = self.states.comm.most(float(np.abs(self.states.expand(u)).max()))
                raise StateError(f"The residual overflows at displacements of up to {largest:.1e}.")
            return Residual(free, size, max(scale, SMALLEST_SCALE * self.largest))

    def round_off(self, u: Array, t: Time) -> float:
        with self._watch("assemble"):
            sums = self.tangent.round_off(u, self.moment(t)) + np.abs(self.body.external_force(u, t))
            return EPS * self.space.norm(self.space.restrict(sums))

    def factorise(self, u: Array, t: Time, tangent: Tangent = Tangent.EXACT) -> Factors:
        exact = tangent is Tangent.EXACT
        if exact and self.tangent.constant_factors is not None:
            return self.tangent.constant_factors
        with self._watch("assemble"):
            K = self.tangent.at(u, self.moment(t), ALL if exact else TENSILE, tangent is Tangent.SHIFTED)
        with self._watch("factor"):
            return self.tangent.factorise(K, exact)

    def switch_to_direct(self, u: Array, t: Time) -> bool:
        """Switch to a direct solver if a factorisation finds no negative eigenvalue; return whether it switched.

        The check is made for up to `COUNTED` unknowns, and `MOST_CHECKS` times on a path, but not for a divided body.
        """
        if not self.iterative or self.space.n > COUNTED or not self._checks_left or self.space.comm.divided:
            return False
        self._checks_left -= 1
        counts = inertia(*self.matrix(u, t))
        if counts is None or counts.negative:
            return False
        with self._watch("factor"):
            self.tangent.use_solver(direct(self.space.n))
        return True

    def matrix(self, u: Array, t: Time) -> tuple[csr_matrix, Unknowns]:
        with self._watch("assemble"):
            return self.tangent.new_matrix(u, self.moment(t))

    def operator(self, u: Array, t: Time) -> FreeOperator | csr_matrix:
        if not isinstance(self.tangent, FreeTangent) or not self.system.dead:  # the load stiffness exists only as a matrix
            return self.matrix(u, t)[0]
        with self._watch("assemble"):
            return FreeOperator(self.system.linear_operator(u, t=self.moment(t)), self.tangent.free)

    def stiffness_norm(self, u: Array, t: Time) -> float:
        """Return the largest absolute row sum of K [N/m]; for an operator, twice the largest row sum of its diagonal blocks."""
        K = self.operator(u, t)
        if isinstance(K, csr_matrix):
            return self.space.comm.most(float(np.asarray(abs(K).sum(axis=1)).max(initial=0.0)))
        return 2 * self.space.comm.most(float(np.abs(K.diagonal_blocks()).sum(axis=2).max()))

    def energy_along(self, u: Array, v: Array, t: Time) -> Array:
        with self._watch("assemble"):
            c = self.body.energy_along(u, v)
            c[1] -= self.states.dot(self.body.external_force(u, t), v)
            return c

    def named(self, inside_out: NDArray[np.int64]) -> str:
        return named_elements(self.system.mesh, inside_out)

    def rate(self, u: Array, t: float) -> tuple[Array, Array]:
        """Return `-dr/dt` (n,) and the rate of the constrained entries, a direction.

        The force of the constrained entries uses the tangent that was made last.
        """
        dt = DIFFERENCE * max(abs(t), 1.0) * (1 if t < 0.5 else -1)  # functions of t may end at 0 and 1
        forces, moves = self.change(u, t, t + dt)
        return forces / dt, moves / dt

    def change(self, u: Array, t: float, later: float) -> tuple[Array, Array]:
        """Return the change from `t` to `later`, as in `rate`: forces (n,) [N], and the motion of constrained entries."""
        with self._watch("assemble"):
            loads = self.body.external_force(u, later) - self.body.external_force(u, t)
        moves = self.body.prescribe(np.zeros(self.states.n), later) - self.body.prescribe(np.zeros(self.states.n), t)
        return self.space.restrict(loads) - self.force_of(moves), moves

    def accept(self, u: Array, t: Time) -> None:
        """Record `u` as a state of the path: update the largest force, the reference for small residuals."""
        residual = self.residual(u, t)
        self.largest = max(self.largest, residual.scale, residual.size)

    def forget(self) -> None:
        """Drop solver data of earlier steps, so that a resumed path gives the same numbers as this one."""
        if self.tangent.constant_factors is None:
            self.tangent.forget()

    def energies(self, u: Array, t: Time) -> tuple[float, float]:
        """Return the strain energy and the potential [J]; NaN if a term has no energy, or a load has no potential."""
        with self._watch("assemble"):
            return sum(self.body.elastic_energies(u, t)), self.body.potential(u, t) if self.system.conservative else float("nan")


def _tangent(system: System, solver: LinearSolver | None) -> FreeTangent:
    assert solver is not None
    return FreeTangent(system, solver, kind_of(system))


@dataclass(frozen=True)
class PathTangent:
    """Unit tangent of the path at a state: `du/ds` and `dt/ds`, with the path length `s` measured in displacements."""

    direction: Array  # (ndofs,) `du/ds`, of length one
    rate: float  # `dt/ds` [1/m]; it changes its sign at limit points
    negative: int | None  # number of negative eigenvalues of K; None if K is not symmetric or a pivot is too small

    def reversed(self) -> PathTangent:
        """Return the opposite tangent."""
        return PathTangent(-self.direction, -self.rate, self.negative)

    def along(self, v: Array, problem: Equilibrium) -> PathTangent:
        """Return this tangent or the opposite one, so that the result does not point against `v` (ndofs,)."""
        return self if problem.states.dot(self.direction, v) >= 0 else self.reversed()


def path_tangent(problem: Equilibrium, u: Array, t: float, singular: bool = False) -> PathTangent | str:
    """Return the path tangent towards growing `t` at an equilibrium, from `K du = -dr/dt dt`.

    If there is no tangent, return the reason. `singular` as in `usable`.
    """
    factors = problem.factorise(u, t)
    forces, constrained = problem.rate(u, t)
    solution = problem.solve(factors, forces, 1e-10)
    if not usable(solution, singular):
        return solution.outcome.value
    rate = constrained + problem.space.expand(solution.x)
    length = problem.states.norm(rate)
    if length == 0:
        return "no displacement changes as the load grows"
    return PathTangent(rate / length, 1 / length, problem.negative_pivots())


@dataclass(frozen=True)
class Hyperplane:
    """Set of states with `normal . u + weight t = value`.

    With `weight` 0 and the tangent as `normal`, it is the plane of Riks (1979) across the path. This plane crosses limit points,
    where `t` reverses and displacements do not. With `normal` 0 the plane prescribes the load. With `weight` 0 and `normal` an
    average of displacements, it prescribes this average.
    """

    normal: Array
    weight: float
    value: float
    reach: float  # distance of the plane from the previous state, in the units of `value`

    def miss(self, u: Array, t: float, problem: Equilibrium) -> float:
        """Return the distance of the state `(u, t)` from the plane, in the units of `value`."""
        return self.value - problem.states.dot(self.normal, u) - self.weight * t


def correct(
    problem: Equilibrium, u: Array, t: float, plane: Hyperplane, rtol: float, watch: Callable[[float, Iterations], None]
) -> tuple[Array, float, End, Iterations]:
    """Find the equilibrium in the plane by full steps of the exact tangent, starting from `u` (ndofs,) and `t` near it.

    Each step solves `K a = -r` and `K b = -dr/dt` with one factorisation. The update is `du = a + dt b`, with `dt` from the
    equation of the plane. At a limit point K may be nearly singular. There `a` and `b` are large, but their sum is not. A step
    that would pass through a contact ends the iteration.
    """
    record, before = Iterations(), None
    try:
        while True:
            u = problem.body.prescribe(u.copy(), t)
            residual = problem.residual(u, t)
            record.residuals.append(residual.relative)
            watch(t, record)
            miss = plane.miss(u, t, problem)
            if abs(miss) <= IN_PLANE * abs(plane.reach):
                end = equilibrium_end(problem, u, t, residual, before, rtol)
                if end is not None:
                    return u, t, end, record
            if len(record) == MOST_IN_PLANE:
                return u, t, End.OUT_OF_ITERATIONS, record
            factors = problem.factorise(u, t)
            forces, moves = problem.rate(u, t)
            a, b = (problem.solve(factors, right, 1e-8) for right in (-residual.vector, forces))
            if not (usable(a, singular=True) and usable(b, singular=True)):
                record.detail = (b if usable(a, singular=True) else a).outcome.value
                return u, t, End.NO_DESCENT, record
            x, y = problem.space.expand(a.x), moves + problem.space.expand(b.x)
            slope = problem.states.dot(plane.normal, y) + plane.weight
            if slope == 0:
                return u, t, End.NO_LENGTH, record
            dt = (miss - problem.states.dot(plane.normal, x)) / slope
            if not np.isfinite(t + dt):
                return u, t, End.OVERFLOW, record
            limit, contact = problem.contact_limit(u, x + dt * y, t)
            if limit <= 1:
                record.detail = f"{contact!r}"
                return u, t, End.CONTACT, record
            u, t, before = u + x + dt * y, t + dt, residual
            record.lengths.append(1.0)
            record.tangents.append("exact")
            record.linear.append(a.iterations + b.iterations)
    except StateError as error:
        record.detail = str(error)
        return u, t, End.OVERFLOW, record
