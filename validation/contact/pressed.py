"""Static solves with contact: a patch test, and a strip of membrane on a drum."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
import skfem
from scipy.optimize import brentq

from skfem_stvk import (
    Friction,
    NodalLoad,
    RigidContact,
    RigidCylinder,
    RigidPlane,
    StVK,
    StvkWarning,
    System,
    Traction,
    solve_static,
)
from skfem_stvk.arguments import Array
from skfem_stvk.mesh import ElementMesh

from ..statics.meshes import moved_box
from ..study import Study
from .check import Check, study_of

YOUNG, POISSON = 1e3, 0.3
#: Stiffness of the floor and the lid of the block [N/m^3], pressure of the traction [Pa], and travel of the lid [m].
STIFFNESS, PRESSURE, TRAVEL = 3e4, 50.0, 0.1
#: The drum: radius and the strip's straight ends, width and thickness [m]; force on the slack end [N], and stiffness [N/m^3].
RADIUS, END, WIDTH, THICKNESS, FORCE, DRUM = 1.0, 0.5, 0.1, 1e-3, 0.1, 1e5
FRICTIONS, SEGMENTS = (0.1, 0.3, 0.5), 40


def at_bottom(x: Array) -> Any:
    """Return whether points `x` (3, n) are at the bottom of the block."""
    return x[2] == 0


def at_top(x: Array) -> Any:
    """Return whether points `x` (3, n) are at the top of the block."""
    return x[2] == 1


def patch(quick: bool) -> Study:
    """Compare the pressures at all vertices of a pressed block's bottom with those of its homogeneous state."""
    grid = ElementMesh.of(skfem.MeshHex().refined(2))
    meshes = {"tetrahedra": _distorted(moved_box(3, 3)), "hexahedra": _distorted(grid)}
    meshes["quadratic tetrahedra"] = meshes["tetrahedra"].with_degree(2)
    return study_of(
        "Patch test: pressure of a block at the vertices on a plane [Pa]",
        "all pressures agree with the homogeneous state to 1e-10",
        [check for name, mesh in meshes.items() for check in _pressures(name, mesh)],
        "a distorted block of StVK, nu = 0.3, without friction: pressed by a traction, and by a lid that moves 0.1 of the height",
        "measured: the pressure with the largest error. Under the lid the depths at both planes count",
    )


def _distorted(mesh: ElementMesh) -> ElementMesh:
    """Return the unit cube sheared along y with unequal cells along x. Its walls remain upright."""
    x, y, z = mesh.p
    return ElementMesh(np.stack([x + 0.3 * y + 0.3 * x * (1 - x), y, z]), mesh.t, element=mesh.element)


def _pressures(name: str, mesh: ElementMesh) -> Iterator[Check]:
    corner, edge = (lambda x: (x[0] == 0) & (x[1] == 0)), (lambda x: (x[0] == 1) & (x[1] == 0))
    floor = RigidContact(RigidPlane((0, 0, 0), (0, 0, 1)), at_bottom, stiffness=STIFFNESS, name="floor")
    lid = RigidContact(RigidPlane((0, 0, 1), (0, 0, -1)), at_top, stiffness=STIFFNESS, motion=(0, 0, -TRAVEL), name="lid")
    loads: dict[str, tuple[Any, float]] = {
        "traction": (Traction(at_top, (0, 0, -PRESSURE)), PRESSURE),
        "lid": (lid, _pressure_under_a_lid()),
    }
    for kind, (load, expected) in loads.items():
        body = System(mesh, [StVK(young=YOUNG, poisson=POISSON), floor, load], fixed={corner: "xy", edge: "y"})
        pressure = solve_static(body, quiet=True).contact("floor").pressure[at_bottom(mesh.p)]
        yield Check(f"{name}, {kind}", float(pressure[np.abs(pressure - expected).argmax()]), expected, 1e-10)


def _pressure_under_a_lid() -> float:
    """Return the pressure [Pa] at which the depths at both planes and the shortening of the block are the travel of the lid."""

    def left(stretch: float) -> float:
        return 2 * _pressure(stretch) / STIFFNESS + 1 - stretch - TRAVEL

    return _pressure(brentq(left, 1 - TRAVEL, 1.0, xtol=1e-15))


def _pressure(stretch: float) -> float:
    """Return the nominal pressure of St. Venant-Kirchhoff's law in uniaxial stress [Pa]."""
    return -YOUNG * stretch * (stretch**2 - 1) / 2


def capstan(quick: bool) -> Study:
    """Compare the tensions of a strip that slides over half of a drum with Euler and Eytelwein's `exp(mu angle)`."""
    return study_of(
        "A strip of membrane slides over half of a drum: ratio of its tensions",
        "the ratio of the tensions is exp(mu pi) to 2 %",
        [Check(f"mu = {mu:g}", ratio_of_tensions(mu), float(np.exp(mu * np.pi)), 0.02) for mu in FRICTIONS],
        f"{2 * SEGMENTS} triangles on the drum. A force acts on one end, and the other end is pulled in 10 static steps",
    )


def ratio_of_tensions(mu: float) -> float:
    """Return the tension at the pulled end of the strip, divided by the force on the other end."""
    mesh = _strip()
    low = mesh.p[1] < mesh.p[1].min() + 1e-9
    slack, pulled = (tuple(np.flatnonzero(low & (side * mesh.p[0] > 0))) for side in (-1, 1))
    depth = FORCE / (WIDTH * DRUM)  # where the contact balances the force
    drum = RigidCylinder((0, 0, 0), (0, 0, 1), RADIUS + depth)
    terms: list[Any] = [
        StVK(young=1e6, poisson=POISSON, thickness=THICKNESS),
        RigidContact(drum, stiffness=DRUM, friction=Friction(mu, slip_length=1e-4)),
        NodalLoad(slack, lambda t: (0, -FORCE / len(slack), 0)),
    ]
    pull = {pulled: {"y": lambda x, t: -0.05 * t}}
    body = System(mesh, terms, fixed={slack: "xz", pulled: "xz"}, prescribed=pull)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StvkWarning)  # friction lags in the first steps, in which the tension grows
        reaction = solve_static(body, steps=10, quiet=True).reaction(pulled)
    return float(-reaction.resultant[1] / FORCE)


def _strip() -> ElementMesh:
    """Return a strip over the upper half of the drum, with straight ends downwards. Its vertices on the drum are on the circle."""
    edge = np.pi * RADIUS / SEGMENTS
    more = round(END / edge)
    flat = skfem.MeshTri.init_tensor(edge * np.arange(-more, SEGMENTS + more + 1), np.array([0, WIDTH]))
    s, z = flat.p
    angle = np.clip(s / RADIUS, 0, np.pi)
    straight = np.abs(s - RADIUS * angle)
    return ElementMesh(np.stack([-RADIUS * np.cos(angle), RADIUS * np.sin(angle) - straight, z]), flat.t)
