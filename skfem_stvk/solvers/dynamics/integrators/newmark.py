"""Newmark's family of integrators, and the generalised-alpha method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np

from ....arguments import Array, Quantity, number
from ....errors import StvkError
from ..record import MotionState
from ..step_matrix import Coefficients
from .implicit import Implicit, ImplicitStepper
from .integrator import LINEAR_MOMENTUM


class NewmarkEnds(Implicit):
    """Integrator with Newmark's velocities and accelerations at the end of a step, by its weights `beta` and `gamma`."""

    needs_acceleration: ClassVar[bool] = True
    beta: Any
    gamma: Any

    def ends(self, state: MotionState, h: float) -> Coefficients:
        """Return the coefficients of `a1 = c w - m` and `v1 = g w - d`, for the displacements `w` over the step."""
        beta, gamma = self.beta, self.gamma
        c, g = 1 / (beta * h**2), gamma / (beta * h)
        m = state.v / (beta * h) + (1 / (2 * beta) - 1) * state.a
        d = gamma * h * m - state.v - (1 - gamma) * h * state.a
        return Coefficients(c, m, g, d)

    def update(self, state: MotionState, w: Array, h: float) -> None:
        c, m, *_ = self.ends(state, h)
        a = c * w - m
        state.v += h * ((1 - self.gamma) * state.a + self.gamma * a)
        np.copyto(state.a, a)


@dataclass(frozen=True)
class Newmark(NewmarkEnds):
    """Newmark's method (1959): the equation of motion at the end of the step, with weights of the old and the new acceleration.

    ::

        u1 = u + T v + T^2 ((1/2 - beta) a + beta a1)        v1 = v + T ((1 - gamma) a + gamma a1)

    The default is the average acceleration method (trapezoidal rule), beta = 1/4, gamma = 1/2. It is stable for linear bodies at
    any step. Large rotations can make it gain energy.

    Parameters
    ----------
    dt, tangent, solver, rtol
        As in `BackwardEuler`.
    beta, gamma
        Weights of the new acceleration. The order is two for gamma = 1/2. Linear bodies are stable if gamma >= 1/2 and beta >=
        gamma/2.

    Notes
    -----
    Source: Newmark (1959).

    Examples
    --------
    >>> import skfem
    >>> from skfem_stvk import StVK, System, simulate
    >>> bar = System(skfem.MeshLine(), StVK(young=4.0, poisson=0.3, density=2.0), fixed={lambda x: x[0] == 0: "x"})
    >>> run = simulate(bar, Newmark(dt=1.0), until=1.0, v0=[0.0, 1e-6], quiet=True)
    >>> (run.u / 1e-6).round(3)                                       # v0 T/(1 + (omega T)^2/4) [m]
    array([0. , 0.5])
    >>> Newmark(dt=0.1).order, Newmark(dt=0.1, beta=0.36, gamma=0.6).order
    (2, 1)
    """

    conserves: ClassVar[frozenset[str]] = frozenset({LINEAR_MOMENTUM})

    beta: Annotated[float, Quantity(None, "Weight of the new acceleration in the displacement.", ge=0)] = 0.25
    gamma: Annotated[float, Quantity(None, "Weight of the new acceleration in the velocity.", ge=0)] = 0.5

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("beta", "gamma"):
            object.__setattr__(self, name, number(f"Newmark: {name}", getattr(self, name)))
        if not (self.gamma >= 0.5 and self.beta >= self.gamma / 2):
            raise StvkError(
                f"beta = {self.beta!r}, gamma = {self.gamma!r}; expected gamma >= 1/2 and beta >= gamma/2, with which any step is "
                "stable for linear bodies. For beta = 0 use VelocityVerlet."
            )

    @property
    def order(self) -> int:  # type: ignore[override]
        """Order in `dt` of the error: 2 for gamma = 1/2, otherwise 1."""
        return 2 if self.gamma == 0.5 else 1

    @property
    def reversible(self) -> bool:  # type: ignore[override]
        """Whether a step with opposite velocities leads back: only for gamma = 1/2, without numerical damping."""
        return self.gamma == 0.5

    def coefficients(self, state: MotionState, h: float, stepper: ImplicitStepper) -> Coefficients:
        return self.ends(state, h)


@dataclass(frozen=True)
class GeneralizedAlpha(NewmarkEnds):
    """Generalised alpha (Chung, Hulbert 1993): inertia, damping and forces are each evaluated at a time within the step.

    ::

        M a(1 - alpha_m) + D v(1 - alpha_f) + (F - h)(1 - alpha_f) = 0,    x(1 - alpha) = (1 - alpha) x1 + alpha x0
        alpha_m = (2 rho - 1)/(rho + 1),  alpha_f = rho/(rho + 1)
        gamma = 1/2 - alpha_m + alpha_f,  beta = (1 - alpha_m + alpha_f)^2/4

    `u1` and `v1` are Newmark's. Forces are the weighted sums of those at both ends. Friction acts in full, with the slip over the
    step, because it is zero at the beginning.

    Parameters
    ----------
    dt, tangent, solver, rtol
        As in `BackwardEuler`.
    rho
        Spectral radius at infinite frequency: 1 retains all vibrations, 0 removes the highest within a step.

    Notes
    -----
    Source: Chung, Hulbert (1993).

    Examples
    --------
    >>> average = GeneralizedAlpha(dt=0.1, rho=1.0)
    >>> average.alpha_m, average.alpha_f, average.gamma, average.beta
    (0.5, 0.5, 0.5, 0.25)
    """

    order: ClassVar[int] = 2
    conserves: ClassVar[frozenset[str]] = frozenset({LINEAR_MOMENTUM})

    rho: Annotated[float, Quantity(None, "Spectral radius at infinity.", ge=0, le=1)] = 0.8

    def __post_init__(self) -> None:
        super().__post_init__()
        expected = "a spectral radius from 0 (strongest damping) to 1 (none)"
        object.__setattr__(self, "rho", number("rho", self.rho, expected, 0.0, 1.0, closed=True))

    @property
    def reversible(self) -> bool:  # type: ignore[override]
        """Whether a step with opposite velocities leads back: only without numerical damping, rho = 1."""
        return self.rho == 1

    @property
    def alpha_m(self) -> float:
        """Weight of the beginning of the step in the inertia, `(2 rho - 1)/(rho + 1)`."""
        return (2 * self.rho - 1) / (self.rho + 1)

    @property
    def alpha_f(self) -> float:
        """Weight of the beginning of the step in damping and forces, `rho/(rho + 1)`."""
        return self.rho / (self.rho + 1)

    @property
    def weight(self) -> float:  # type: ignore[override]
        """Factor of the reactions of the solved equation, which is divided by `1 - alpha_f`."""
        return 1 - self.alpha_f

    @property
    def gamma(self) -> float:
        """Newmark's weight of the new acceleration in the velocity, `1/2 - alpha_m + alpha_f`."""
        return 0.5 - self.alpha_m + self.alpha_f

    @property
    def beta(self) -> float:
        """Newmark's weight of the new acceleration in the displacement, `(1 - alpha_m + alpha_f)^2/4`."""
        return (1 - self.alpha_m + self.alpha_f) ** 2 / 4

    def coefficients(self, state: MotionState, h: float, stepper: ImplicitStepper) -> Coefficients:
        c, m, g, d, _ = self.ends(state, h)  # those of the equation above, divided by `1 - alpha_f`
        share, before = (1 - self.alpha_m) / (1 - self.alpha_f), self.alpha_f / (1 - self.alpha_f)
        motion = stepper.motion
        inertia = share * m - self.alpha_m / (1 - self.alpha_f) * state.a
        return Coefficients(share * c, inertia, g, d, -before * motion.force(state.u, state.v, state.t))
