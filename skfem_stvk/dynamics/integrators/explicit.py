"""What explicit integrators have in common."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...arguments import Array
from ...errors import StvkError
from ...nonlinear.stopwatch import Stopwatch
from ..motion import Motion
from ..record import Counts, MotionState
from .integrator import Integrator, checked_step


@dataclass(frozen=True)
class Explicit(Integrator):
    """An integrator that needs forces only.

    Parameters
    ----------
    dt : time step [s]; by default 0.85 of the critical one, found again as the body deforms, and shorter after a motion has blown up.
    """

    explicit: ClassVar[bool] = True
    #: How many times over damping counts where the critical step is looked for.
    damping_weight: ClassVar[float] = 1.0

    dt: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "dt", checked_step(self.dt, optional=True))


class ExplicitStepper:
    """The forces on the body, `h - D v` and `F`, on arrays that are made once.

    Attributes
    ----------
    internal, energy : internal force (ndofs,) [N] where it was evaluated last, and the strain energy there [J].
    """

    def __init__(self, motion: Motion, name: str) -> None:
        if motion.mass.kind != "lumped":
            raise StvkError(f"{name} takes no {motion.mass.kind} mass: it would need a solve each step. Leave mass='lumped'.")
        self.motion, self.watch, self.counts = motion, Stopwatch("write"), Counts()
        n = motion.system.ndofs
        self.inverse = motion.mass.solve(np.ones(n))
        self.internal, self._damped = np.zeros(n), np.zeros(n)
        self.energy = 0.0

    @property
    def remark(self) -> str:
        """Nothing."""
        return ""

    def start(self, state: MotionState) -> None:
        """The internal force at the first state."""
        self.evaluate(state)

    def external(self, u: Array, v: Array, t: float) -> Array:
        """(ndofs,) `h(u, t) - D v` [N], good until the next call."""
        loads = self.motion.loads(u, t)
        if not self.motion.damped:
            return loads
        self._damped[:] = 0
        self.motion.add_damping(u, v, self._damped)
        return np.subtract(loads, self._damped, out=self._damped)

    def arrive(self, state: MotionState, t: float) -> None:
        """It is `t`; the held ones are where they are then."""
        if self.motion.moving:
            state.u[self.motion.free.fixed] = self.motion.held(t)
        state.t = t

    def evaluate(self, state: MotionState) -> None:
        """The internal force and the strain energy at the state."""
        with self.watch("assemble"):
            self.energy, _ = self.motion.system.energy_and_force(state.u, out=self.internal)
