"""Right final states: by tiny steps of Verlet, of a rigid body, at rest, or none."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from skfem_stvk import System

from ..case import Array, made
from ..truths import Make
from .scene import Ending
from .verlet import Motion, followed, total_energy

#: Limit of the error of displacements relative to the largest, and of the energy relative to its maximum, for usual steps.
LIMIT = 0.1


def _forces(volume: bool, degree: int) -> str:
    return "own forces" if volume or degree == 2 else "scikit-fem"


def none(when: float, degree: int = 1) -> Ending:
    """Return the outcome that the material loses stability: St. Venant-Kirchhoff does not resist inversion."""
    return Ending(f"none: in tiny steps of Verlet, {_forces(False, degree)}, elements invert at {when:.2f} s", None)


def tiny_steps(make: Make, until: float, steps: int, volume: bool = False, degree: int = 1) -> Ending:
    """Return the final state of velocity Verlet in `steps` steps.

    Linear elements without a volume term use scikit-fem's forces. Quadratic elements vibrate faster and take four times as many
    steps. The source is stated for elements of this `degree`.
    """

    def _followed(system: System) -> Motion:
        degree = system.mesh.element.degree
        return followed(make, volume, until, steps * degree**2, degree)

    def error(system: System, u: Array) -> float:
        right = _followed(system)
        return float(np.sqrt(((u - right.u) ** 2).mean())) / right.size

    def energy(system: System, u: Array, v: Array) -> float:
        right = _followed(system)
        return (total_energy(made(make, system.mesh.element.degree), volume, u, v) - right.energy) / right.most

    source = f"{steps * degree**2} steps of Verlet, {_forces(volume, degree)}"
    return Ending(source, error, LIMIT, energy=energy)


def state(source: str, make: Make, expected: Callable[[System], Array], free: bool = False, limit: float = LIMIT) -> Ending:
    """Return the outcome with displacements (ndofs,) from the function `expected`.

    If the body is `free` and starts without strain, it conserves its energy [J].
    """

    def error(system: System, u: Array) -> float:
        right = expected(system)
        return float(np.sqrt(((u - right) ** 2).mean() / (right**2).mean()))

    def excess(system: System, u: Array, v: Array) -> float:
        body = made(make, system.mesh.element.degree)
        assert body.v0 is not None
        energy = total_energy(body, False, np.zeros_like(u), body.v0)
        return (total_energy(body, False, u, v) - energy) / energy

    return Ending(source, error, limit, energy=excess if free else None)
