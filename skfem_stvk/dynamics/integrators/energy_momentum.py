"""The integrator that keeps energy and both momenta."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import ClassVar

import numpy as np

from ...arguments import Array
from ..record import MotionState
from ..step_matrix import Coefficients
from .implicit import Implicit, ImplicitStepper
from .integrator import ANGULAR_MOMENTUM, ENERGY, LINEAR_MOMENTUM


@dataclass(frozen=True)
class EnergyMomentum(Implicit):
    """Energy and momentum (Simo, Tarnow 1992) in edge form: mean tensions on the edges at the middle of the step.

        M (v1 - v)/T + sum_i (t_i + t1_i)/2 p_i(1/2) + D (v1 + v)/2 = (h + h1)/2        (u1 - u)/T = (v1 + v)/2

    The work of this force over the step is `W1 - W` to round-off, and it has no torque about the middle: a free body keeps its
    energy and both momenta as well as the equation is solved. Laws without edges, such as `NeoHookean`, have a discrete gradient
    (Gonzalez 2000) in place of mean tensions, which does the same. A `VolumePenalty` acts with its force at the middle: momenta are
    kept, its energy to O(T^2).

    On a `ReducedSystem` the mean of the force over the step takes the place of mean tensions, at the two points of Gauss: for a
    cubic force that is exact, so that the energy is kept to round-off. Momenta are not, and the tangent is symmetric.

    Otherwise it is not; half of `2 J'LJ` at the middle and of the tensions at the beginning takes its place, which is symmetric.
    Where all terms act with their force at the middle, as those of `Corotated` do, K there is exact and symmetric.

    Parameters
    ----------
    rtol : of the residual; what is left of it is what the energy is off by. By default next to round-off, 3e-16 takes it there;
        1e-8 saves one or two iterations per step.
    """

    order: ClassVar[int] = 2
    conserves: ClassVar[frozenset[str]] = frozenset({LINEAR_MOMENTUM, ANGULAR_MOMENTUM, ENERGY})
    conserves_reduced: ClassVar[frozenset[str] | None] = frozenset({ENERGY})
    reversible: ClassVar[bool] = True
    mean: ClassVar[bool] = True
    secant: ClassVar[bool] = True
    weight: ClassVar[float] = 0.5

    rtol: float = 1e-13

    def coefficients(self, state: MotionState, h: float, stepper: ImplicitStepper) -> Coefficients:
        """Twice the equation above, so that K stands in the tangent as it is."""
        loads, rate = stepper.motion.loads(state.u, state.t), _rate(h)
        return Coefficients(rate * rate, 2 * rate * state.v, rate, np.zeros_like(state.v), -loads)

    def update(self, state: MotionState, w: Array, h: float) -> None:
        np.subtract(_rate(h) * w, state.v, out=state.v)


@lru_cache(maxsize=256)
def _rate(h: float) -> float:
    """`2/h` to about 1e-14, with a square that is hardly rounded: else each step would feed or drain up to 1e-16 of the energy."""
    rates = [2 / h * (1 + k * float(np.finfo(float).eps)) for k in range(-32, 33)]
    return min(rates, key=lambda rate: abs(Fraction(rate) ** 2 - Fraction(rate * rate)))
