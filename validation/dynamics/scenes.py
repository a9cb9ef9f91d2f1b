"""Bodies and pictures that several studies of motion share."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import skfem

from skfem_stvk import ElementMesh, Gravity, StVK, StvkWarning, System
from skfem_stvk.arguments import Array
from skfem_stvk.dynamics import Integrator, Run, SimulationError, Status, simulate
from skfem_stvk.dynamics.integrators.implicit import Implicit, ImplicitStepper
from skfem_stvk.dynamics.motion import Motion
from skfem_stvk.dynamics.record import MotionState

from ..statics.meshes import moved_box

#: Okabe and Ito's.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
#: The end of a cantilever, for the ledger.
TIP = {"tip": lambda x: x[0] == x[0].max()}
SOFT = StVK(young=1e5, poisson=0.3, density=1000.0)


def block(n: int, sides: tuple[float, ...] = (0.4, 0.1, 0.15), material: StVK = SOFT, **supports: Any) -> System:
    """A block of these sides [m] about the origin, `n` cells along each, inner vertices moved, half of all turned round."""
    unit = moved_box(len(sides), n)
    mesh = ElementMesh(unit.p * np.array(sides)[:, None], unit.t)
    mass = System(mesh, material).mass().vertex
    centred = ElementMesh(mesh.p - (mesh.p @ mass / mass.sum())[:, None], mesh.t)
    return System(centred, material, **supports)


def reached(system: System, integrator: Integrator, **options: Any) -> Run:
    """A motion that reaches its end, for studies of what it costs: elements may be inside out there."""
    run = simulate(system, integrator, quiet=True, raise_on_failure=False, **options)
    if run.status not in (Status.FINISHED, Status.ENDED_INVERTED):
        raise SimulationError(run)
    return run


def begun(system: System, integrator: Implicit, v: Array) -> tuple[ImplicitStepper, MotionState]:
    """A stepper and its first state, undeformed with velocities `v` (ndofs,) [m/s], for steps one by one, without a ledger."""
    motion = Motion(system, "lumped", None)
    stepper, state = integrator.stepper(motion), MotionState.at(0.0, np.zeros_like(v), v)
    state.v[motion.free.fixed] = 0.0
    stepper.start(state)
    return stepper, state


@contextmanager
def expected() -> Iterator[None]:
    """Steps that are too large are taken on purpose."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StvkWarning)
        yield


def cantilever(n: int, length: float = 0.4, thick: float = 0.1, young: float = 3e5) -> System:
    """A bar of tetrahedra, `n` cells across and as long as they are cubes, held at x = 0, under its weight."""
    cells = n * round(length / thick)
    lines = np.linspace(0, length, cells + 1), *2 * [np.linspace(0, thick, n + 1)]
    mesh = skfem.MeshTet.init_tensor(*lines)
    return System(
        mesh, [StVK(young=young, poisson=0.3, density=1000.0), Gravity((0.0, 0.0, -9.81))], fixed={lambda x: x[0] == 0: "xyz"}
    )
