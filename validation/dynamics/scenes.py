"""Bodies and pictures that several studies of motion share."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import skfem

from skfem_stvk import ElementMesh, Gravity, StVK, StvkWarning, System
from skfem_stvk.solvers.dynamics import Integrator, Run, SimulationError, Status, simulate

from ..statics.meshes import moved_box

#: Colours of Okabe and Ito.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
#: Markers of the same number of curves.
MARKERS = "os^DvPX"
SOFT = StVK(young=1e5, poisson=0.3, density=1000.0)


def block(n: int, sides: tuple[float, ...] = (0.4, 0.1, 0.15), material: StVK = SOFT, **supports: Any) -> System:
    """Return a block of these sides [m] about the origin, `n` cells along each side.

    Inner vertices are moved, and half of the elements have negative orientation.
    """
    unit = moved_box(len(sides), n)
    mesh = ElementMesh(unit.p * np.array(sides)[:, None], unit.t)
    mass = System(mesh, material).mass().vertex
    centred = ElementMesh(mesh.p - (mesh.p @ mass / mass.sum())[:, None], mesh.t)
    return System(centred, material, **supports)


def reached(system: System, integrator: Integrator, **options: Any) -> Run:
    """Return a motion that reaches its end, for studies of cost. Elements may be inverted at the end."""
    run = simulate(system, integrator, quiet=True, raise_on_failure=False, **options)
    if run.status not in (Status.FINISHED, Status.ENDED_INVERTED):
        raise SimulationError(run)
    return run


@contextmanager
def expected() -> Iterator[None]:
    """Suppress the package's warnings about steps that are too large on purpose."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StvkWarning)
        yield


def cantilever(n: int, length: float = 0.4, thick: float = 0.1, young: float = 3e5) -> System:
    """Return a bar of tetrahedra under its weight, clamped at x = 0. It has `n` cubic cells across."""
    cells = n * round(length / thick)
    lines = np.linspace(0, length, cells + 1), *2 * [np.linspace(0, thick, n + 1)]
    mesh = skfem.MeshTet.init_tensor(*lines)
    return System(
        mesh, [StVK(young=young, poisson=0.3, density=1000.0), Gravity((0.0, 0.0, -9.81))], fixed={lambda x: x[0] == 0: "xyz"}
    )
