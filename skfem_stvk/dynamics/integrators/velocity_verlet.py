"""The integrator of molecular dynamics."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...kernels import motion as kernels
from ..motion import Motion
from ..record import MotionState
from .explicit import Explicit, ExplicitStepper
from .integrator import ANGULAR_MOMENTUM, LINEAR_MOMENTUM


@dataclass(frozen=True)
class VelocityVerlet(Explicit):
    """Velocity Verlet, the central differences of structural dynamics (Newmark's beta = 0, gamma = 1/2).

        v(1/2) = v + T/2 a        u <- u + T v(1/2)        a <- M^-1 (h - D (v + T a) - F(u))        v <- v(1/2) + T/2 a

    A force a step, symplectic, reversible without damping. Stable below `T = 2 / omega_max`; with damping, which is taken at a predicted
    velocity, below `2/omega (sqrt(1 + 4 xi^2) - 2 xi)`: it counts twice.

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
    """A force a step; the acceleration is kept from step to step."""

    def start(self, state: MotionState) -> None:
        super().start(state)
        if not state.a.any():
            force = self.external(state.u, state.v, state.t) - self.internal
            np.multiply(self.inverse, force, out=state.a)

    def step(self, state: MotionState, t: float) -> None:
        h, motion, held = t - state.t, self.motion, self.motion.free.fixed
        if motion.moving:
            before, velocities = state.u[held], state.v[held]
            force = self.external(state.u, state.v, state.t)[held] - self.internal[held]
        kernels.kick_and_drift(state.a, h / 2, h, state.v, state.u)
        self.arrive(state, t)
        self.evaluate(state)
        if motion.moving:
            state.v[held] = 2 * (state.u[held] - before) / h - velocities
        external = self.external(state.u, state.v + (h / 2) * state.a if motion.damped else state.v, t)
        if motion.moving:
            m = motion.mass.vertex[held // motion.system.mesh.d]
            state.reaction[held] = m * (state.v[held] - velocities) / h - (force + external[held] - self.internal[held]) / 2
        kernels.accelerate(self.inverse, external, self.internal, h / 2, state.a, state.v)
