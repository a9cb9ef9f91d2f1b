"""What explicit integrators have in common."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import StvkError
from ...statics.stopwatch import Stopwatch
from ..motion import Motion
from ..state import State
from .integrator import Integrator, check_step

Array = NDArray[Any]


@dataclass(frozen=True)
class Explicit(Integrator):
    """An integrator that needs forces only.

    Parameters
    ----------
    dt : time step [s]; by default 0.85 of the critical one, found again as the body deforms.
    """

    explicit: ClassVar[bool] = True
    #: How many times over damping counts where the critical step is looked for.
    damping_weight: ClassVar[float] = 1.0

    dt: float | None = None

    def __post_init__(self) -> None:
        check_step(self.dt, optional=True)


class ExplicitStepper:
    """The force on the body, `h - D v - F`, on arrays that are made once.

    Attributes
    ----------
    energy : strain energy at the last internal force [J].
    """

    def __init__(self, motion: Motion, name: str) -> None:
        if motion.mass.kind != "lumped":
            raise StvkError(f"{name} takes no {motion.mass.kind} mass: it would need a solve each step. Leave mass='lumped'.")
        self.motion, self.watch, self.iterations = motion, Stopwatch(), 0
        n = motion.system.ndofs
        self.inverse = motion.mass.solve(np.ones(n))
        self._internal, self.force, self._damping = np.zeros(n), np.zeros(n), np.zeros(n)
        self.energy = 0.0

    @property
    def remark(self) -> str:
        """Nothing."""
        return ""

    def start(self, state: State) -> None:
        """The internal force at the first state."""
        self._evaluate(state.u)

    def total(self, u: Array, v: Array, t: float) -> Array:
        """`h(u, t) - D v - F(u)` with the internal force that was evaluated last, at `u`."""
        np.subtract(self.motion.loads(u, t), self._internal, out=self.force)
        if self.motion.damped:
            self._damping[:] = 0
            self.motion.add_damping(u, v, self._damping)
            self.force -= self._damping
        return self.force

    def arrive(self, state: State, t: float) -> None:
        """It is `t`; the held ones are where they are then."""
        if self.motion.moving:
            state.u[self.motion.free.fixed] = self.motion.held(t)
        state.t = t

    def evaluate(self, state: State) -> None:
        """The internal force and the strain energy at the state."""
        self._evaluate(state.u)

    def _evaluate(self, u: Array) -> None:
        with self.watch("assemble"):
            self.energy, _ = self.motion.system.energy_and_force(u, out=self._internal)
