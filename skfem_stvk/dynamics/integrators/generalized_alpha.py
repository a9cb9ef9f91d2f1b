"""The generalised-alpha method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ...arguments import Array, number
from ..record import MotionState
from ..step_problem import Coefficients
from .implicit import Implicit, ImplicitStepper
from .integrator import LINEAR_MOMENTUM
from .newmark import newmark_coefficients, newmark_update


@dataclass(frozen=True)
class GeneralizedAlpha(Implicit):
    """Generalised alpha (Chung, Hulbert 1993): inertia, damping and forces each at a moment within the step.

        M a(1 - alpha_m) + D v(1 - alpha_f) + (F - h)(1 - alpha_f) = 0,    x(1 - alpha) = (1 - alpha) x1 + alpha x0
        alpha_m = (2 rho - 1)/(rho + 1),  alpha_f = rho/(rho + 1),  gamma = 1/2 - alpha_m + alpha_f,  beta = (1 - alpha_m + alpha_f)^2/4

    with Newmark's `u1`, `v1`. Forces are those at both ends, in these parts.

    Parameters
    ----------
    rho : spectral radius at infinite frequency: 1 keeps all vibrations, 0 ends the highest within a step.
    """

    order: ClassVar[int] = 2
    conserves: ClassVar[frozenset[str]] = frozenset({LINEAR_MOMENTUM})
    needs_acceleration: ClassVar[bool] = True

    rho: float = 0.8

    def __post_init__(self) -> None:
        super().__post_init__()
        expected = "a spectral radius from 0 (strongest damping) to 1 (none)"
        object.__setattr__(self, "rho", number("rho", self.rho, expected, 0.0, 1.0, closed=True))

    @property
    def reversible(self) -> bool:  # type: ignore[override]
        return self.rho == 1

    @property
    def alpha_m(self) -> float:
        return (2 * self.rho - 1) / (self.rho + 1)

    @property
    def alpha_f(self) -> float:
        return self.rho / (self.rho + 1)

    @property
    def gamma(self) -> float:
        return 0.5 - self.alpha_m + self.alpha_f

    @property
    def beta(self) -> float:
        return (1 - self.alpha_m + self.alpha_f) ** 2 / 4

    def coefficients(self, state: MotionState, h: float, stepper: ImplicitStepper) -> Coefficients:
        """The equation above, divided by `1 - alpha_f`."""
        c, m, g, d, _ = newmark_coefficients(state, h, self.beta, self.gamma)
        share, before = (1 - self.alpha_m) / (1 - self.alpha_f), self.alpha_f / (1 - self.alpha_f)
        motion = stepper.motion
        inertia = share * m - self.alpha_m / (1 - self.alpha_f) * state.a
        return Coefficients(share * c, inertia, g, d, -before * motion.force(state.u, state.v, state.t))

    def update(self, state: MotionState, w: Array, h: float) -> None:
        newmark_update(state, w, h, self.beta, self.gamma)
