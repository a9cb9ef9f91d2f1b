"""Common parts of implicit integrators: one equation per step, solved by Newton's method."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, replace
from math import sqrt
from typing import Any, ClassVar

import numpy as np
from scipy.linalg.lapack import dposv

from ....arguments import Array, choice, number
from ....edges.bound_term import couples_pairs_of
from ....linear import BlockJacobiCg, Kind, LinearSolver, SsorCg, choose
from ....linear.choose import is_auto
from ....linear.dense import DenseSolver
from ....mesh.displacements import by_vertex
from ....system import System
from ....system.coordinates import Coordinates
from ....system.free_tangent import entries_of, with_loads
from ....terms.loads.load import Moment
from ...newton.newton import BEFORE_THE_LIMIT, Iterations, NewtonOptions, newton
from ..forces import passes_inversion
from ..motion import Motion
from ..record import SLACK, HierarchyOrigin, MotionState
from ..step_matrix import Coefficients, DenseStepMatrix, StepMatrix, StepTangent, kind_of_step
from ..step_problem import StepProblem
from .integrator import Integrator, StepFailed, Stepper, checked_step

#: Largest number of full Newton steps on a basis before `newton` takes over. A step usually takes two.
MOST_DENSE = 6


@dataclass(frozen=True)
class Implicit(Integrator):
    """Integrator that solves an equation for the displacements over each step.

    Parameters
    ----------
    dt
        Time step [s].
    tangent
        Tangent of its solves, "exact", "clamped", "gauss-newton", "warped", "diagonal" or "rest"; see `StepTangent`.
    solver
        Linear solver, as in `solve_static`; by default "ssor-cg" for tetrahedra if forces have a potential, otherwise by size.
    rtol
        Tolerance of the residual, relative to the forces, including those of inertia.
    """

    explicit: ClassVar[bool] = False
    conserves_reduced: ClassVar[frozenset[str] | None] = frozenset()

    dt: float
    tangent: str = "exact"
    solver: str | LinearSolver = "auto"
    rtol: float = 1e-8

    def __post_init__(self) -> None:
        object.__setattr__(self, "dt", checked_step(self.dt))
        object.__setattr__(self, "tangent", choice("tangent", self.tangent, [one.value for one in StepTangent]))
        object.__setattr__(self, "rtol", number("rtol", self.rtol, "a number between 0 and 1, such as 1e-8", 0.0, 1.0))

    def linear_solver(self, motion: Motion) -> LinearSolver:
        """Return the linear solver. It uses a matrix if the mass couples vertices, or for SSOR with several terms."""
        kind, divided = kind_of_step(motion.system, StepTangent(self.tangent)), motion.system.space.comm.divided
        named, entries = self._named(motion.system, kind), entries_of(motion.system)
        solver = choose(named, len(motion.free.free), kind, entries=entries, divided=divided)
        if StepTangent(self.tangent) not in (StepTangent.DIAGONAL, StepTangent.REST):
            solver = with_loads(solver, motion.system)
        if not solver.matrix_free:
            return solver
        if motion.mass.kind == "consistent":
            what = f"mass = 'consistent' with solver = '{solver.name}'"
            motion.system.space.comm.refuse_divided(what, "'lumped', or solver='petsc'", "a consistent mass requires a matrix.")
        own = solver if isinstance(solver, BlockJacobiCg) else SsorCg()
        first, *others = motion.system.bound_terms
        several = isinstance(solver, SsorCg) and not all(couples_pairs_of(first, term) for term in others)
        return replace(own, assembled=True) if several or motion.mass.kind == "consistent" else solver

    def _named(self, system: System, kind: Kind) -> str | LinearSolver:
        """Return the requested solver: conjugate gradients for diagonal blocks, and by default if they are fast."""
        if StepTangent(self.tangent) is StepTangent.DIAGONAL:
            return "block-jacobi-cg"
        if system.space.comm.divided:
            return "block-jacobi-cg" if is_auto(self.solver) and kind is Kind.SYMMETRIC and self.starts_near else self.solver
        return "ssor-cg" if is_auto(self.solver) and kind is Kind.SYMMETRIC and self.iterates(system) else self.solver

    def iterates(self, system: System) -> bool:
        """Return whether conjugate gradients are fast: for tetrahedra, whose factors are large, unless factors are retained."""
        return system.mesh.k == 3 and StepTangent(self.tangent) is not StepTangent.REST and not system.constant_tangent

    @abstractmethod
    def coefficients(self, state: MotionState, h: float, stepper: ImplicitStepper) -> Coefficients:
        """Return the coefficients of the equation of a step of length `h`."""

    @abstractmethod
    def update(self, state: MotionState, w: Array, h: float) -> None:
        """Set velocities and accelerations after the step, from the displacements `w` over it.

        On entry, `state.u` is still that before the step.
        """

    #: Factor from the reactions of the solved equation to those of the equation of motion, if reactions are computed from the
    #: former.
    weight: ClassVar[float] = 1.0
    secant: ClassVar[bool] = False
    #: Whether a step is one linear solve that starts near its solution, so that it takes few iterations.
    starts_near: ClassVar[bool] = False
    needs_acceleration: ClassVar[bool] = False

    def stepper(self, motion: Motion) -> ImplicitStepper:
        return DenseStepper(motion, self) if isinstance(motion.body, Coordinates) else ImplicitStepper(motion, self)


class ImplicitStepper(Stepper):
    """Stepper with Newton's method, one equation per step; `scratch` (ndofs,) is a scratch array."""

    def __init__(self, motion: Motion, integrator: Implicit) -> None:
        super().__init__(motion)
        self.integrator = integrator
        self.problem = StepProblem(motion, self._matrix(), self.watch, integrator.mean, integrator.secant)
        self._most_inside_out = motion.system.mesh.element_count if passes_inversion(motion.system) else None
        self.scratch = np.zeros(motion.states.n)
        self._led: tuple[Array, Array] | None = None  # displacements for inertia where they are prescribed, and velocities there
        self._met = ""  # remark on the contact that cut the first guess of the step

    def _matrix(self) -> StepMatrix | DenseStepMatrix:
        motion, integrator = self.motion, self.integrator
        if isinstance(motion.body, Coordinates):
            return DenseStepMatrix(motion, motion.body, integrator.mean, self.watch)
        solver, tangent = integrator.linear_solver(motion), StepTangent(integrator.tangent)
        return StepMatrix(motion, solver, tangent, integrator.mean, self.watch, 1 / integrator.weight)

    @property
    def solver(self) -> LinearSolver | DenseSolver:
        return self.problem.tangent.solver

    @property
    def origin(self) -> HierarchyOrigin | None:
        return self.problem.matrix.origin

    def rebuild(self, origin: HierarchyOrigin) -> None:
        self.problem.matrix.rebuild(origin)

    def start(self, state: MotionState) -> None:
        """Evaluate the acceleration if the integrator needs it."""
        self.problem.forget()
        if self.integrator.needs_acceleration and not self.motion.states.comm.any(bool(state.a.any())):
            state.a[:] = self.motion.accelerations(state.u, state.v, state.t)

    def step(self, state: MotionState, t: float) -> None:
        h, problem, moment = self.length(state, t), self.problem, self.motion.moment(t)
        self._begin(state, t, h)
        w = self.predicted(state, t)
        most_inverted = self._most_inside_out or len(problem.inside_out(np.zeros_like(w)))
        w, found, record = self.solve(w, moment, most_inverted)
        self.counts.iterations += len(record)
        if found:
            raise StepFailed(found + self._met)
        self.accept(state, w, h, moment)

    def _begin(self, state: MotionState, t: float, h: float) -> None:
        """Begin a step of length `h` to `t`.

        The velocities of an integrator whose forces are at both ends would ring for ever after a kink in a prescribed displacement.
        So prescribed degrees of freedom have the velocities of their functions. Inertia, and damping that acts on velocities, are
        those of the displacements `led` that lead to these velocities.
        """
        coefficients, integrator, motion = self.integrator.coefficients(state, h, self), self.integrator, self.motion
        self._led = None
        if motion.moving and (integrator.needs_acceleration or integrator.mean):
            fixed, (c, m, g, d, _), still = motion.free.fixed, coefficients, state.copy()
            integrator.update(still, np.zeros_like(state.u), h)
            v = motion.constrained_velocities(t, -h)
            led = (v - still.v[fixed]) / g
            excess = led - (motion.constrained_displacements(t) - state.u[fixed])
            m[fixed] -= c * excess
            if not integrator.mean:
                np.asarray(d)[fixed] -= g * excess
            self._led = led, v
        self.problem.begin(state, coefficients)

    def length(self, state: MotionState, t: float) -> float:
        """Return the length of the step to `t` [s]. For a whole step it is exactly `dt`, so that factors can be reused."""
        h, dt = t - state.t, self.integrator.dt
        return dt if abs(h - dt) < SLACK * dt else h

    def solve(self, w: Array, moment: Moment, inside_out: int) -> tuple[Array, str, Iterations]:
        """Return the displacements over the step, a message if they were not found, and the record of the iterations."""
        rtol = self.integrator.rtol
        w, end, record = newton(self.problem, w, moment, NewtonOptions(rtol, inside_out))
        return w, "" if end.converged else f"{end.value}{': ' * bool(record.detail)}{record.detail}", record

    def predicted(self, state: MotionState, t: float) -> Array:
        """Return the first guess of the displacements over the step.

        It assumes constant velocities, and uses the values prescribed at `t` for constrained degrees of freedom.
        Free degrees of freedom stop before a contact is passed or an element becomes flat.
        """
        w = (t - state.t) * state.v
        fixed = self.motion.free.fixed
        w[fixed] = self.motion.constrained_displacements(t) - state.u[fixed]
        start = np.zeros_like(w)
        limit, name = self.problem.contact_limit(start, w, self.motion.moment(state.t))
        self._met = f"; its speed would carry the body through the contact {name!r} within the step" if limit <= 1 else ""
        limit = min(limit, self.problem.step_limit(start, w))
        if limit <= 1:  # beyond the limit, the body might be in equilibrium on the other side, or its energy might be infinite
            w[self.motion.free.free] *= BEFORE_THE_LIMIT * limit
        return w

    def accept(self, state: MotionState, w: Array, h: float, moment: Moment) -> None:
        """Update the state by the displacements `w`. The last residual must be that of `w`."""
        fixed, motion = self.motion.free.fixed, self.motion
        before = state.copy() if motion.moving and self.integrator.needs_acceleration else None
        state.t = moment.time  # from here on, the state is no longer that of the previous step
        u1 = state.u + w
        if self._led is None:
            self.integrator.update(state, w, h)
        else:
            w = w.copy()
            w[fixed], v = self._led
            self.integrator.update(state, w, h)
            state.v[fixed] = v
        np.copyto(state.u, u1)
        if before is None:
            state.reaction[fixed] = self.integrator.weight * self.problem.full[fixed]
        else:  # forces at the end differ from the mean over the step by O(h); friction is zero at the beginning
            forces = motion.force(before.u, before.v, before.t)
            forces += motion.force(state.u, state.v, state.t, friction=2.0)
            state.reaction[fixed] = (motion.mass.multiply(state.v - before.v) / h - forces / 2)[fixed]

    def store_forces(self, before: MotionState, state: MotionState) -> None:
        super().store_forces(before, state)
        if not self.integrator.mean:
            return
        motion, mesh, u0, u1 = self.motion, self.motion.system.mesh, before.u, state.u
        contacts = motion.system.contacts_at(motion.moment(state.t))
        for contact, force in zip(contacts, state.forces, strict=False):
            force[:] = 0
            contact.mean_force(by_vertex(mesh, u0), by_vertex(mesh, u1), (0.5, 0.5), 0.5, force.reshape(-1, mesh.d))
            force *= -1
        if len(state.forces) > len(contacts):
            state.forces[-1] = motion.system.foundation_force((u0 + u1) / 2 + motion.beta / (state.t - before.t) * (u1 - u0))

    def strain_energy(self, state: MotionState) -> float:
        return self.motion.energy(state.u, state.t)


class DenseStepper(ImplicitStepper):
    """Stepper of a motion on a basis: full Newton steps with as few calls as possible around W, F and K.

    If they do not lead to a solution with a positive definite matrix, or loads change, `newton` solves the equation.
    """

    def solve(self, w: Array, moment: Moment, inside_out: int) -> tuple[Array, str, Iterations]:
        record = Iterations()
        found = None if self.motion.constant_loads is None else self._full_steps(w, moment, record)
        return super().solve(w, moment, inside_out) if found is None else (found, "", record)

    def _full_steps(self, w: Array, moment: Moment, record: Iterations) -> Array | None:
        """Return the solution of full Newton steps from `w` (m,); None if they do not converge."""
        problem, n = self.problem, len(self.motion.free.free)
        matrix: Any = problem.matrix
        loads, offset = self.motion.loads(w, moment.time), problem.offset
        before, scale = np.inf, 0.0
        for _ in range(MOST_DENSE):
            with self.watch("assemble"):
                F, K = matrix.response(w)
                inertia = matrix.inertia @ w
                full = inertia + F
                full -= offset
                full -= loads
                r = full[:n]
                size = sqrt(r @ r)
                if not record.lengths:  # the sizes of the forces are those at the first guess, which is close to the solution
                    scale = sum(sqrt(one[:n] @ one[:n]) for one in (inertia, offset, F, loads))
            stalled = not size < before / 2
            if size <= self.integrator.rtol * scale or (stalled and size <= problem.round_off(w, moment)):
                problem.full = full
                return w
            if stalled:
                return None
            with self.watch("solve"):
                K = K + matrix.inertia
                _, x, failed = dposv(K[:n, :n], r, lower=1)
            if failed:
                return None
            w = w.copy()
            w[:n] -= x
            before = size
            record.lengths.append(1.0)
        return None
