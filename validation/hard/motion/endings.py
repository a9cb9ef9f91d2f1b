"""Right endings: by tiny steps of Verlet, a rigid body's, a state of rest, or that there is none."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from skfem_stvk import System

from ..case import Array, made
from ..truths import Make
from .scene import Ending
from .verlet import Motion, followed, total_energy

#: Of displacements, as a part of the largest; of the energy, as a part of the most: for steps that a user would take.
LIMIT = 0.1


def _forces(volume: bool, degree: int) -> str:
    return "own forces" if volume or degree == 2 else "scikit-fem"


def none(when: float, degree: int = 1) -> Ending:
    """The material gives way: St. Venant-Kirchhoff does not resist what turns it inside out."""
    return Ending(f"none: in tiny steps of Verlet, {_forces(False, degree)}, elements turn inside out at {when:.2f} s", None)


def tiny_steps(make: Make, until: float, steps: int, volume: bool = False, degree: int = 1) -> Ending:
    """Return the end of velocity Verlet in so many steps, by scikit-fem's forces for linear elements without a volume term.

    Quadratic elements vibrate faster and take four times as many. The source names those of elements of this `degree`.
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
    """Displacements (ndofs,) that come from elsewhere; a body that starts `free` and at rest in shape keeps its energy [J]."""

    def error(system: System, u: Array) -> float:
        right = expected(system)
        return float(np.sqrt(((u - right) ** 2).mean() / (right**2).mean()))

    def excess(system: System, u: Array, v: Array) -> float:
        body = made(make, system.mesh.element.degree)
        assert body.v0 is not None
        energy = total_energy(body, False, np.zeros_like(u), body.v0)
        return (total_energy(body, False, u, v) - energy) / energy

    return Ending(source, error, limit, energy=excess if free else None)
