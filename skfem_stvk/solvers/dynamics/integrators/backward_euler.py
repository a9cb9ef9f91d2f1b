"""Backward Euler: solved to convergence, or with one linear solve per step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, cast

import numpy as np
from scipy.linalg.lapack import dposv

from ....arguments import Array
from ....edges import ALL, TENSILE
from ....errors import StvkError
from ....linear.dense import DenseFactors
from ....mesh.displacements import by_vertex
from ....system import System, TangentOperator
from ....system.coordinates import Coordinates
from ....system.operator import at_all_times
from ....terms.loads.load import Moment
from ...newton.newton import usable
from ...newton.problem import Tangent
from ..forces import damped_beside_edges
from ..motion import Motion
from ..record import MotionState
from ..step_matrix import Coefficients, StepTangent
from .implicit import Implicit, ImplicitStepper
from .integrator import ANGULAR_MOMENTUM, LINEAR_MOMENTUM, StepFailed


@dataclass(frozen=True)
class BackwardEuler(Implicit):
    """Backward Euler, converged: the displacements `w` over a step minimise the energy below.

    ::

        W(u + w) + potential of the loads + 1/(2 T^2) (w - T v)' M (w - T v) + 1/(2 T) w' D w        v <- w / T

    `D` is that of `Rayleigh`. `EdgeDamping` adds `tau/(4 T) (zeta1 - zeta)' L (zeta1 - zeta)` to the energy, with the squared
    elongations `zeta` and `zeta1` at both ends of the step. Its force is `tau/T p(u1) L (zeta1 - zeta)`.

    It is stable for any step and loses energy in each, more in larger steps.

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

    Examples
    --------
    >>> import skfem
    >>> from skfem_stvk import StVK, System, simulate
    >>> bar = System(skfem.MeshLine(), StVK(young=4.0, poisson=0.3, density=2.0), fixed={lambda x: x[0] == 0: "x"})
    >>> run = simulate(bar, BackwardEuler(dt=1.0), until=1.0, v0=[0.0, 1e-6], quiet=True)
    >>> (run.u / 1e-6).round(3), round(run.gained, 3)     # v0 T/(1 + (omega T)^2) with omega = 2/s, at a fifth of the energy
    (array([0. , 0.2]), -0.8)
    """

    order: ClassVar[int] = 1
    conserves: ClassVar[frozenset[str]] = frozenset({LINEAR_MOMENTUM})
    reversible: ClassVar[bool] = False
    secant: ClassVar[bool] = True

    def coefficients(self, state: MotionState, h: float, stepper: ImplicitStepper) -> Coefficients:
        return Coefficients(1 / h**2, np.divide(state.v, h, out=stepper.scratch), 1 / h, 0.0)

    def update(self, state: MotionState, w: Array, h: float) -> None:
        np.divide(w, h, out=state.v)


@dataclass(frozen=True)
class LinearBackwardEuler(BackwardEuler):
    """Linearised backward Euler as in Kikuuwe (2009), eq. 9: one linear solve per step.

    ::

        v <- 1/T (M/T^2 + D/T + K)^-1 (h - F(p) + M v/T)        p <- p + T v

    The default solver is conjugate gradients, preconditioned by SSOR, started from the prediction by the last velocity and
    acceleration. With follower loads, which make K unsymmetric, a direct solver is used. If K is indefinite, the matrix may not be
    positive definite. If conjugate gradients detect this, the step uses the clamped tangent.

    Parameters
    ----------
    dt, tangent, solver
        As in `BackwardEuler`.
    rtol
        Relative tolerance of the linear solve.

    Notes
    -----
    Source: Kikuuwe (2009), eq. 9.

    Examples
    --------
    >>> sorted(LinearBackwardEuler(dt=0.1).conserves), sorted(LinearBackwardEuler(dt=0.1, tangent="gauss-newton").conserves)
    (['linear momentum'], ['angular momentum', 'linear momentum'])
    """

    starts_near: ClassVar[bool] = True

    rtol: float = 1e-4

    @property
    def conserves(self) -> frozenset[str]:  # type: ignore[override]
        """Conserved quantities, which depend on the tangent.

        With "gauss-newton" forces act along edges, without a torque. Diagonal blocks alone resist any motion.
        """
        if self.tangent == StepTangent.GAUSS_NEWTON.value:
            return frozenset({LINEAR_MOMENTUM, ANGULAR_MOMENTUM})
        return frozenset() if self.tangent == StepTangent.DIAGONAL.value else frozenset({LINEAR_MOMENTUM})

    def iterates(self, system: System) -> bool:
        """Return whether to use conjugate gradients: yes, unless factors are retained for the whole run.

        A step has a single solve, which starts near its solution.

        Parameters
        ----------
        system
            Body of the motion.
        """
        return not system.constant_tangent

    def stepper(self, motion: Motion) -> LinearStepper:
        self._refuse_incomplete_tangents(motion)
        return DenseLinearStepper(motion, self) if isinstance(motion.body, Coordinates) else LinearStepper(motion, self)

    def _refuse_incomplete_tangents(self, motion: Motion) -> None:
        """Refuse tangents that omit a part of M or D. Unlike a part of K, the result would be wrong even for the smallest steps."""
        diagonal, rest = self.tangent == StepTangent.DIAGONAL.value, self.tangent == StepTangent.REST.value
        if diagonal and motion.mass.kind == "consistent":
            raise StvkError("LinearBackwardEuler: tangent='diagonal' would leave out masses between vertices. Take mass='lumped'.")
        if diagonal and (motion.beta or motion.tau):
            raise StvkError(
                "LinearBackwardEuler: tangent='diagonal' would leave out damping between vertices. Take Rayleigh(alpha) or "
                "another tangent."
            )
        if motion.tau and (others := damped_beside_edges(motion.system)):
            raise StvkError(
                f"LinearBackwardEuler: EdgeDamping would also damp {', '.join(dict.fromkeys(others))}; expected laws on edges "
                "alone. Take Rayleigh(beta=tau), or BackwardEuler."
            )
        if rest and motion.system.contacts:
            raise StvkError(
                "LinearBackwardEuler: tangent='rest' would leave out the stiffness of contacts. Take another tangent, or "
                "BackwardEuler."
            )
        if rest and motion.tau:
            raise StvkError(
                "LinearBackwardEuler: tangent='rest' would damp as if the body had not rotated. Take Rayleigh(beta=tau), or "
                "another tangent."
            )


class LinearStepper(ImplicitStepper):
    """Stepper with one Newton iteration per step, from the present state."""

    def __init__(self, motion: Motion, integrator: LinearBackwardEuler) -> None:
        super().__init__(motion, integrator)
        n, free = motion.states.n, len(motion.free.free)
        self._w, self._predicted, self._zero = (np.zeros(n) for _ in range(3))
        self._b, self._start, self._x = (np.zeros(free) for _ in range(3))
        self._held = np.zeros(len(motion.free.fixed))
        self._retained = ALL  # tensions in the tangent of the last step

    @property
    def remark(self) -> str:
        """Remark on the number of steps with the clamped tangent."""
        clamped = self.counts.clamped
        return f", {clamped} of them with the clamped tangent, because K was not positive definite" if clamped else ""

    def start(self, state: MotionState) -> None:
        """Evaluate the strain energy and the internal force."""
        self.problem.forget()
        self._energy = self.problem.store_internal_force(state.u, self.motion.moment(state.t))

    def step(self, state: MotionState, t: float) -> None:
        h, problem, motion = self.length(state, t), self.problem, self.motion
        free, fixed, w = motion.free.free, motion.free.fixed, self._w
        problem.begin(state, self.integrator.coefficients(state, h, self))
        predicted = self.predicted(state, t)
        if motion.system.working_contacts:
            if motion.step is not None:
                motion.begin_step(motion.step.history, (state.u + predicted).reshape(-1, motion.system.mesh.d))
            self.problem.store_internal_force(
                state.u, motion.moment(t)
            )  # with the force per slip, times the slip of the moved shape
        moment = motion.moment(t)
        np.take(problem.before_step(t), free, out=self._b, mode="clip")
        np.negative(self._b, out=self._b)
        np.take(predicted, free, out=self._start, mode="clip")
        w[:] = 0
        w[fixed] = predicted[fixed]
        w[free] = self._solution(w, moment)
        self.accept(state, w, h, moment)

    def predicted(self, state: MotionState, t: float) -> Array:
        """Return the prediction with the acceleration of the previous step, which saves a fifth of the iterations."""
        h, w, fixed = t - state.t, self._predicted, self.motion.free.fixed
        np.multiply(state.a, h, out=w)
        w += state.v
        w *= h
        w[fixed] = self.motion.constrained_displacements(t) - state.u[fixed]
        return w

    def accept(self, state: MotionState, w: Array, h: float, moment: Moment) -> None:
        """Update the state, and evaluate the internal force: the next step begins with it, and the reactions contain it."""
        state.t = moment.time  # from here on, the state is no longer that of the previous step
        np.divide(w, h, out=state.a)
        state.a -= state.v
        state.a /= h
        self.integrator.update(state, w, h)
        state.u += w
        self._energy = self.problem.store_internal_force(state.u, moment)
        state.reaction[self.motion.free.fixed] = self.problem.reactions(w, state.u, moment.time, self._held)

    def store_forces(self, before: MotionState, state: MotionState) -> None:
        """Store `F + K w` of each contact, with the K of the step."""
        super().store_forces(before, state)
        system, w, moment = self.motion.system, state.u - before.u, self.motion.moment(state.t)
        contacts, every = system.contacts_at(moment), system.pairs_at(moment)
        for contact, i, force in zip(contacts, system.contact_numbers, state.forces, strict=False):
            force[:] = 0
            contact.energy_and_force(by_vertex(system.mesh, before.u), force.reshape(-1, system.mesh.d))
            K = TangentOperator(system.mesh, at_all_times([every[i]]), before.u, system.dtype, self._retained)
            if self.integrator.tangent == StepTangent.DIAGONAL.value:
                force += np.einsum("nij,nj->ni", K.diagonal_blocks(), w.reshape(-1, system.mesh.d)).ravel()
            else:
                force += K @ w
            force *= -1

    def strain_energy(self, state: MotionState) -> float:
        return self._energy

    def _solution(self, w: Array, moment: Moment) -> Array:
        """Solve for the free degrees of freedom with the chosen tangent, or the clamped one if that is not positive definite."""
        problem, moving = self.problem, self.motion.moving
        for attempted in (Tangent.EXACT, Tangent.CLAMPED):
            factors = problem.factorise(self._zero, moment, attempted)
            b = self._b - problem.force_of(w) if moving else self._b
            with self.watch("solve"):
                solution = factors.solve(b, self.integrator.rtol, self._start, self._x)
            self.counts.iterations += solution.iterations
            if usable(solution):
                self.counts.clamped += attempted is Tangent.CLAMPED
                self._retained = StepTangent(self.integrator.tangent).retained if attempted is Tangent.EXACT else TENSILE
                return solution.x
        raise StepFailed(f"the linear solve failed: {solution.outcome.value}")


class DenseLinearStepper(LinearStepper):
    """Stepper of a motion on a basis under constant loads: one evaluation of W, F and K per step, and as few calls as possible."""

    def start(self, state: MotionState) -> None:
        super().start(state)
        self._linearize(state)

    def step(self, state: MotionState, t: float) -> None:
        motion, h, n = self.motion, self.length(state, t), len(self.motion.free.free)
        if motion.constant_loads is None:
            super().step(state, t)
            return
        matrix: Any = self.problem.matrix
        matrix.begin(state.u, 1 / h**2, 1 / h)
        w, constant = self._w, motion.mass.multiply(state.v)
        constant /= h
        constant += motion.loads(state.u, t)
        b = constant[:n] - self._F[:n]
        K = self._K + matrix.inertia
        if motion.moving:
            w[n:] = motion.constrained_displacements(t)
            w[n:] -= state.u[n:]
            b -= K[:n, n:] @ w[n:]
        with self.watch("solve"):
            w[:n] = self._solved(K[:n, :n], b)
        state.t = t  # from here on, the state is no longer that of the previous step
        v = w / h
        np.subtract(v, state.v, out=state.a)
        state.a /= h
        state.v[:] = v
        state.u += w
        self._linearize(state)
        if motion.moving:
            state.reaction[n:] = matrix.inertia[n:] @ w + self._F[n:] - constant[n:]

    def _linearize(self, state: MotionState) -> None:
        with self.watch("assemble"):
            self._energy, self._F, self._K = cast(Coordinates, self.motion.body).linearize(state.u)

    def _solved(self, K: Array, b: Array) -> Array:
        """Return the solution by Cholesky's factors; by absolute values of the eigenvalues if K is not positive definite."""
        _, x, failed = dposv(K, b, lower=1)
        if not failed:
            return np.asarray(x)
        solution = DenseFactors(K, absolute=True).solve(b)
        if not usable(solution):
            raise StepFailed(f"the linear solve failed: {solution.outcome.value}")
        self.counts.clamped += 1
        return solution.x
