"""Backward Euler, solved to the end."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...arguments import Array
from ..record import MotionState
from ..step_problem import Coefficients
from .implicit import Implicit, ImplicitStepper
from .integrator import LINEAR_MOMENTUM


@dataclass(frozen=True)
class BackwardEuler(Implicit):
    """Backward Euler, converged: the displacements `w` over a step are the minimum of what the step costs.

        W(u + w) + potential of the loads + 1/(2 T^2) (w - T v)' M (w - T v) + 1/(2 T) w' D w        v <- w / T

    It takes any step and loses energy at each, the more the larger the step.
    """

    order: ClassVar[int] = 1
    conserves: ClassVar[frozenset[str]] = frozenset({LINEAR_MOMENTUM})
    reversible: ClassVar[bool] = False
    secant: ClassVar[bool] = True

    def coefficients(self, state: MotionState, h: float, stepper: ImplicitStepper) -> Coefficients:
        return Coefficients(1 / h**2, np.divide(state.v, h, out=stepper.room), 1 / h, 0.0)

    def update(self, state: MotionState, w: Array, h: float) -> None:
        np.divide(w, h, out=state.v)
