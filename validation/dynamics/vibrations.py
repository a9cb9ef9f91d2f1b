"""Small vibrations in one mode: frequency and decay of each integrator against its formula for a linear oscillator.

With `W = omega T`, the displacement at the steps is `r^n cos(n theta + c)`. The numerical circular frequency is `theta/T`, the
decay per step is `r`:

    forward Euler (eq. 4), velocity Verlet              theta = 2 asin(W/2)     r = 1
    backward Euler, converged or linearised (eq. 9)     theta = atan(W)         r = 1/sqrt(1 + W^2)
    average acceleration, energy and momentum           theta = 2 atan(W/2)     r = 1
    generalised alpha                                   from its amplification matrix, see `generalized_alpha`
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from skfem_stvk import System
from skfem_stvk.arguments import Array
from skfem_stvk.solvers.dynamics import (
    BackwardEuler,
    EnergyMomentum,
    ForwardEuler,
    GeneralizedAlpha,
    Integrator,
    LinearBackwardEuler,
    Newmark,
    VelocityVerlet,
    simulate,
)
from skfem_stvk.solvers.dynamics.critical_step import critical_step
from skfem_stvk.solvers.dynamics.modes import modes

from ..study import Study
from .scenes import block

#: Largest displacement [m]; the block is 0.4 m long.
SMALL = 1e-10
#: Steps per period of the mode for implicit integrators; step in critical steps for explicit ones.
PARTS, OF_CRITICAL = 20, 0.9
#: Number of values for the fit, and their distance [rad]. The first values are left out, because the start affects generalised
#: alpha.
VALUES, APART, LEFT_OUT = 60, 0.5, 20
RTOL, LIMIT = 1e-12, 1e-6
IMPLICIT = (LinearBackwardEuler, BackwardEuler, Newmark, GeneralizedAlpha, EnergyMomentum)


class Wave(NamedTuple):
    """Angle [rad] and decay per step."""

    angle: float
    decay: float


class Finding(NamedTuple):
    """Predicted and measured frequency and decay of a mode of circular frequency `omega` [1/s]."""

    integrator: Integrator
    omega: float
    predicted: Wave
    measured: Wave

    @property
    def product(self) -> float:
        """Product `omega dt`."""
        return self.omega * float(self.integrator.dt or 0)


def vibrations(quick: bool = False, folder: Path | None = None) -> Sequence[Study]:
    """Compare frequency and decay of small vibrations in single modes with the formulas of the integrators."""
    system = block(2, (0.4, 0.1, 0.15), fixed={lambda x: x[0] == x[0].min(): "xyz"})
    n = system.ndofs - len(system.supports.held)
    found = [one for i in ((0, n - 1) if quick else (0, 4, n // 2, n - 1)) for one in _findings(system, i, n)]
    return (
        Study(
            "Small vibrations",
            f"numerical frequency and decay as predicted, to {LIMIT:g}",
            (
                "integrator",
                "mode in Hz",
                "omega dt",
                "frequency/mode's: predicted",
                "measured",
                "decay a step: predicted",
                "measured ",
            ),
            tuple(map(_row, found)),
            tuple(failure for one in found for failure in _failures(one)),
            (f"from the lowest mode to the highest of {n}; explicit integrators with {OF_CRITICAL:g} of the critical step",),
        ),
    )


def _findings(system: System, number: int, n: int) -> Iterator[Finding]:
    """Yield the findings for all integrators in the mode with this number."""
    found = modes(system, n)
    omega, shape = float(np.sqrt(found.eigenvalues[number])), found.shapes[number]
    stable, dt = OF_CRITICAL * critical_step(system).step, 2 * np.pi / (PARTS * omega)
    for one in (ForwardEuler(stable), VelocityVerlet(stable), *(implicit(dt=dt, rtol=RTOL) for implicit in IMPLICIT)):
        yield Finding(one, omega, predicted(one, omega), measured(system, one, omega, shape))


def predicted(integrator: Integrator, omega: float) -> Wave:
    """Return angle and decay of a linear oscillator."""
    W = omega * float(integrator.dt or 0)
    if integrator.explicit:
        return Wave(2 * np.arcsin(W / 2), 1.0)
    if isinstance(integrator, BackwardEuler):
        return Wave(np.arctan(W), 1 / np.hypot(1, W))
    if isinstance(integrator, GeneralizedAlpha):
        return generalized_alpha(integrator.rho, W)
    return Wave(2 * np.arctan(W / 2), 1.0)


def generalized_alpha(rho: float, W: float) -> Wave:
    """Return angle and decay from the amplification matrix of Chung and Hulbert (1993).

    `A x1 = B x` for `x = (u, T v, T^2 a)`. The oscillating eigenvalues are `r e^(i theta)`.
    """
    m, f = (2 * rho - 1) / (rho + 1), rho / (rho + 1)
    gamma, beta = 0.5 - m + f, (1 - m + f) ** 2 / 4
    A = np.array([[1, 0, -beta], [0, 1, -gamma], [(1 - f) * W**2, 0, 1 - m]])
    B = np.array([[1, 1, 0.5 - beta], [0, 1, 1 - gamma], [-f * W**2, 0, -m]])
    value = max(np.linalg.eigvals(np.linalg.solve(A, B)), key=lambda eigenvalue: eigenvalue.imag)
    return Wave(float(np.angle(value)), float(abs(value)))


def measured(system: System, integrator: Integrator, omega: float, shape: Array) -> Wave:
    """Return angle and decay from the motion of the vertex with the largest displacement.

    `x(n+1) = 2 r cos(theta) x(n) - r^2 x(n-1)` is fitted by least squares to every `every`-th step.
    """
    index = int(np.argmax(np.abs(shape)))
    every = max(1, round(APART / (omega * float(integrator.dt or 0))))
    until = float(integrator.dt or 0) * every * (VALUES + LEFT_OUT)
    run = simulate(system, integrator, until=until, u0=SMALL / abs(shape[index]) * shape, probes={"A": [index // 3]}, quiet=True)
    x = run.ledger[f"A {'xyz'[index % 3]}"][::every][LEFT_OUT:]
    (a, b), *_ = np.linalg.lstsq(np.stack([x[1:-1], x[:-2]], axis=1), x[2:], rcond=None)
    decay = np.sqrt(-b)
    return Wave(float(np.arccos(a / (2 * decay))) / every, float(decay ** (1 / every)))


def _row(one: Finding) -> tuple[str, ...]:
    frequencies = (f"{wave.angle / one.product:.7f}" for wave in (one.predicted, one.measured))
    decays = (f"{wave.decay:.7f}" for wave in (one.predicted, one.measured))
    return one.integrator.name, f"{one.omega / (2 * np.pi):.2f}", f"{one.product:.3f}", *frequencies, *decays


def _failures(one: Finding) -> Iterator[str]:
    off = one.measured.angle / one.predicted.angle - 1, one.measured.decay - one.predicted.decay
    if not max(map(abs, off)) <= LIMIT:
        yield f"{one.integrator.name}, {one.omega / (2 * np.pi):.2f} Hz: frequency off by {off[0]:.1e}, decay by {off[1]:.1e}"
