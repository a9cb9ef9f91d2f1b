"""Explicit integrators, which need forces only: symplectic Euler and velocity Verlet."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ....arguments import Array
from ....errors import StvkError
from ....kernels import motion_updates as kernels
from ..motion import Motion
from ..record import MotionState
from .integrator import ANGULAR_MOMENTUM, LINEAR_MOMENTUM, Integrator, Stepper, checked_step


@dataclass(frozen=True)
class Explicit(Integrator):
    """Integrator that needs forces only. `ForwardEuler` documents its parameters."""

    explicit: ClassVar[bool] = True
    #: Factor of damping in the computation of the critical step.
    damping_weight: ClassVar[float] = 1.0

    dt: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "dt", checked_step(self.dt, optional=True))


class ExplicitStepper(Stepper):
    """Stepper that evaluates the forces on the body, `h - D v` and `F`, in arrays that are allocated once."""

    def __init__(self, motion: Motion, name: str) -> None:
        if motion.mass.kind != "lumped":
            raise StvkError(
                f"mass = {motion.mass.kind!r}; expected 'lumped' for {name}, because another mass needs a solve in each step."
            )
        super().__init__(motion)
        n = motion.system.ndofs
        self.inverse = np.zeros(n)
        self.internal, self._damped = np.zeros(n), np.zeros(n)
        self._energy = 0.0

    def start(self, state: MotionState) -> None:
        """Evaluate the internal force at the first state, and copy the inverse masses, and the masses of the supports."""
        motion = self.motion
        self.inverse[:] = motion.mass.solve(np.ones(len(self.inverse)))
        self._fixed = motion.free.fixed
        self.masses = motion.mass.vertex[self._fixed // motion.system.mesh.d]
        self._held, self._loaded = np.zeros(len(self._fixed)), np.zeros(len(self._fixed))
        self.evaluate(state)

    def external(self, u: Array, v: Array, t: float) -> Array:
        """Return `h(u, t) - D v` (ndofs,) [N]. The array is valid until the next call."""
        loads = self.motion.loads(u, t)
        if not self.motion.damped:
            return loads
        self._damped[:] = 0
        self.motion.add_damping(u, v, self._damped)
        return np.subtract(loads, self._damped, out=self._damped)

    def hold(self, state: MotionState, external: Array) -> None:
        """Set the reactions of supports that do not move, `F - h`."""
        np.take(self.internal, self._fixed, out=self._held, mode="clip")
        self._held -= np.take(external, self._fixed, out=self._loaded, mode="clip")
        state.reaction[self._fixed] = self._held

    def move_supports(self, state: MotionState, t: float) -> None:
        """Set the time of the state to `t`, and constrained degrees of freedom to their prescribed displacements."""
        if self.motion.moving:
            state.u[self.motion.free.fixed] = self.motion.constrained_displacements(t)
        state.t = t

    def evaluate(self, state: MotionState) -> None:
        """Evaluate the internal force at the state, and the strain energy of the terms that have one."""
        with self.watch("assemble"):
            self._energy = self.motion.energy_and_force(state.u, self.motion.moment(state.t), self.internal)

    def strain_energy(self, state: MotionState) -> float:
        return self._energy


@dataclass(frozen=True)
class ForwardEuler(Explicit):
    """Forward Euler as in Kikuuwe (2009), eq. 4: the new velocity moves the body.

    ::

        v <- v + T M^-1 (h - D v - F(p))        p <- p + T v

    Other authors call it semi-implicit or symplectic Euler. The error of its energy is O(T), but does not drift. It is stable below
    `T = 2 / omega_max`.

    Parameters
    ----------
    dt
        Time step [s]. By default it is 0.85 of the critical step, updated as the body deforms, and shorter after a motion has blown
        up.

    Notes
    -----
    Source: Kikuuwe (2009), eq. 4.

    Examples
    --------
    >>> ForwardEuler(dt=1e-4).order, sorted(ForwardEuler.conserves)
    (1, ['angular momentum', 'linear momentum'])
    """

    order: ClassVar[int] = 1
    conserves: ClassVar[frozenset[str]] = frozenset({LINEAR_MOMENTUM, ANGULAR_MOMENTUM})
    reversible: ClassVar[bool] = False

    def stepper(self, motion: Motion) -> ForwardEulerStepper:
        return ForwardEulerStepper(motion, self.name)


class ForwardEulerStepper(ExplicitStepper):
    """Stepper of `ForwardEuler`, with one force per step."""

    def step(self, state: MotionState, t: float) -> None:
        h, fixed = t - state.t, self.motion.free.fixed
        external = self.external(state.u, state.v, t)
        if self.motion.moving:
            before, velocities, force = state.u[fixed], state.v[fixed], external[fixed] - self.internal[fixed]
        else:
            self.hold(state, external)
        kernels.push_and_drift(self.inverse, external, self.internal, h, state.v, state.u)
        self.move_supports(state, t)
        if self.motion.moving:
            state.v[fixed] = (state.u[fixed] - before) / h
            state.reaction[fixed] = self.masses * (state.v[fixed] - velocities) / h - force
        self.evaluate(state)


@dataclass(frozen=True)
class VelocityVerlet(Explicit):
    """Velocity Verlet, the central differences of structural dynamics (Newmark's beta = 0, gamma = 1/2).

    ::

        v(1/2) = v + T/2 a        u <- u + T v(1/2)        a <- M^-1 (h - D (v + T a) - F(u))        v <- v(1/2) + T/2 a

    It needs one force per step, is symplectic, and is reversible without damping. It is stable below `T = 2 / omega_max`. With
    damping, which is evaluated at a predicted velocity, the limit is `2/omega (sqrt(1 + 4 xi^2) - 2 xi)`, because damping counts
    twice. Friction of a node of mass m that rises by `c` per speed limits it to `2 m/c`, because it would do work in longer steps.

    Parameters
    ----------
    dt
        As in `ForwardEuler`.

    Examples
    --------
    >>> VelocityVerlet().order, VelocityVerlet.reversible
    (2, True)
    """

    order: ClassVar[int] = 2
    conserves: ClassVar[frozenset[str]] = frozenset({LINEAR_MOMENTUM, ANGULAR_MOMENTUM})
    reversible: ClassVar[bool] = True
    damping_weight: ClassVar[float] = 2.0

    def stepper(self, motion: Motion) -> VelocityVerletStepper:
        return VelocityVerletStepper(motion, self.name)


class VelocityVerletStepper(ExplicitStepper):
    """Stepper of `VelocityVerlet`, with one force per step. The acceleration is stored from step to step."""

    def start(self, state: MotionState) -> None:
        super().start(state)
        if not self.motion.states.comm.any(bool(state.a.any())):
            force = self.external(state.u, state.v, state.t) - self.internal
            np.multiply(self.inverse, force, out=state.a)

    def step(self, state: MotionState, t: float) -> None:
        h, motion, fixed = t - state.t, self.motion, self.motion.free.fixed
        if motion.moving:
            velocities = state.v[fixed]
            force = self.external(state.u, state.v, state.t)[fixed] - self.internal[fixed]
        kernels.kick_and_drift(state.a, h / 2, h, state.v, state.u)
        self.move_supports(state, t)
        self.evaluate(state)
        if motion.moving:
            state.v[fixed] = motion.constrained_velocities(t, -h)
        external = self.external(state.u, state.v + (h / 2) * state.a if motion.damped else state.v, t)
        if motion.moving:
            inertia = self.masses * (state.v[fixed] - velocities) / h
            state.reaction[fixed] = inertia - (force + external[fixed] - self.internal[fixed]) / 2
        else:  # the force at the beginning would cost an evaluation of loads and damping
            self.hold(state, external)
        kernels.accelerate(self.inverse, external, self.internal, h / 2, state.a, state.v)
