"""The overview's explicit integrator."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ...kernels import motion as kernels
from ..motion import Motion
from ..record import MotionState
from .explicit import Explicit, ExplicitStepper
from .integrator import ANGULAR_MOMENTUM, LINEAR_MOMENTUM


@dataclass(frozen=True)
class ForwardEuler(Explicit):
    """Forward Euler as it is written in the overview (Kikuuwe, eq. 4): the new velocity moves the body.

        v <- v + T M^-1 (h - D v - F(p))        p <- p + T v

    Elsewhere it is called semi-implicit or symplectic Euler: its energy is off by O(T), but does not drift. Stable below `T = 2 / omega_max`.

    >>> ForwardEuler(dt=1e-4).order, sorted(ForwardEuler.conserves)
    (1, ['angular momentum', 'linear momentum'])
    """

    order: ClassVar[int] = 1
    conserves: ClassVar[frozenset[str]] = frozenset({LINEAR_MOMENTUM, ANGULAR_MOMENTUM})
    reversible: ClassVar[bool] = False

    def stepper(self, motion: Motion) -> ForwardEulerStepper:
        return ForwardEulerStepper(motion, self.name)


class ForwardEulerStepper(ExplicitStepper):
    """A force a step."""

    def step(self, state: MotionState, t: float) -> None:
        h = t - state.t
        held = self.motion.free.fixed
        external = self.external(state.u, state.v, t)
        if self.motion.moving:
            before, velocities, force = state.u[held], state.v[held], external[held] - self.internal[held]
        kernels.push_and_drift(self.inverse, external, self.internal, h, state.v, state.u)
        self.arrive(state, t)
        if self.motion.moving:
            state.v[held] = (state.u[held] - before) / h
            inertia = (
                self.motion.mass.multiply(state.v)[held] - self.motion.mass.vertex[held // self.motion.system.mesh.d] * velocities
            )
            state.reaction[held] = inertia / h - force
        self.evaluate(state)
