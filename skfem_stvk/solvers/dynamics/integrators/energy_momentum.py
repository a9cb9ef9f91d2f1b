"""Integrator that conserves energy and both momenta."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import ClassVar

import numpy as np

from ....arguments import Array
from ..record import MotionState
from ..step_matrix import Coefficients
from .implicit import Implicit, ImplicitStepper
from .integrator import ANGULAR_MOMENTUM, ENERGY, LINEAR_MOMENTUM


@dataclass(frozen=True)
class EnergyMomentum(Implicit):
    """Energy and momentum method (Simo, Tarnow 1992) in edge form: mean tensions on the edges at the middle of the step.

    ::

        M (v1 - v)/T + sum_i (t_i + t1_i)/2 p_i(1/2) + D (v1 + v)/2 = (h + h1)/2        (u1 - u)/T = (v1 + v)/2

    The work of this force over the step is `W1 - W` to round-off, and it has no torque about the middle. Hence a free body
    conserves its energy and both momenta to the precision of the solve. Laws without edges, such as `NeoHookean`, use a discrete
    gradient (Gonzalez 2000) instead of mean tensions, with the same properties. A `VolumePenalty` acts with its force at the
    middle: it conserves momenta, and energy to O(T^2).

    On a `ReducedSystem`, the mean of the force at the two Gauss points of the step replaces mean tensions. For a cubic force this
    is exact, so that the energy is conserved to round-off. Momenta are not conserved. The tangent is symmetric.

    On a `System` the tangent is not symmetric. The symmetric sum of half of `2 J'LJ` at the middle and half of the tensions at the
    beginning replaces it. If all terms act with their force at the middle, as `Corotated` does, K there is exact and symmetric.

    Parameters
    ----------
    dt, tangent, solver
        As in `BackwardEuler`.
    rtol
        Relative tolerance of the residual. The remaining residual determines the error of the energy. The default is close to
        round-off, which 3e-16 reaches. 1e-8 saves one or two iterations per step.

    Notes
    -----
    Sources: Simo, Tarnow (1992) for mean tensions; Gonzalez (2000) for the discrete gradient.

    Examples
    --------
    >>> import skfem
    >>> from skfem_stvk import StVK, System, simulate
    >>> bar = System(skfem.MeshLine(), StVK(young=4.0, poisson=0.3, density=2.0), fixed={lambda x: x[0] == 0: "x"})
    >>> run = simulate(bar, EnergyMomentum(dt=1.0), until=10.0, v0=[0.0, 0.1], quiet=True)
    >>> bool(abs(run.gained) < 1e-10)
    True
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
        # those of twice the equation above, so that the tangent contains K without a factor
        loads, rate = stepper.motion.loads(state.u, state.t), _rate(h)
        return Coefficients(rate * rate, 2 * rate * state.v, rate, np.zeros_like(state.v), -loads)

    def update(self, state: MotionState, w: Array, h: float) -> None:
        np.subtract(_rate(h) * w, state.v, out=state.v)


@lru_cache(maxsize=256)
def _rate(h: float) -> float:
    """Return `2/h` to about 1e-14, with a square that is nearly exact.

    Otherwise each step would add or remove up to 1e-16 of the energy.
    """
    rates = [2 / h * (1 + k * float(np.finfo(float).eps)) for k in range(-32, 33)]
    return min(rates, key=lambda rate: abs(Fraction(rate) ** 2 - Fraction(rate * rate)))
