"""Hertz's problem: a ball of quadratic tetrahedra between two plates.

    F = 4/3 E* a^3/R      E* = E/(1 - nu^2)      Hertz: the force at the contact radius a
    d = a^2/R - F/(pi E) (2 (1 + nu) R^2/(a^2 + 4 R^2)^(3/2) + (1 - nu^2)/(a^2 + 4 R^2)^(1/2))

The second line is the approach of the ball's centre to each plate. Its last term is Tatara's correction for a finite ball (1991).
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from skfem_stvk import ElementMesh, LinearElastic, NeoHookean, RigidContact, RigidPlane, StVK, System, solve_static
from skfem_stvk.mesh import read_mesh

from ..bench.meshes import gmsh_session
from ..study import Study
from .check import Check, study_of

YOUNG, POISSON = 1.0, 0.3  # of a ball of radius 1
#: Contact radii, and elements along them.
SIZES, ELEMENTS = (0.02, 0.05, 0.1), 4
#: Penalty stiffness in units of E/h, with the edges h at the contact.
STIFFNESS = 100.0
FORCE_LIMIT, RADIUS_LIMIT = 5e-3, 0.05


class Pressed(NamedTuple):
    """Result of a pressed ball: force and contact radius, divided by Hertz's, iterations of Newton's method, and its time [s]."""

    force: float
    radius: float
    iterations: int
    seconds: float


def hertz(quick: bool) -> Study:
    """Compare the force and the contact radius of pressed balls with those of Hertz and Tatara."""
    checks = []
    for a in SIZES[2:] if quick else SIZES:
        linear = pressed(LinearElastic, a)
        checks += [
            Check(f"a/R = {a:g}: force", hertz_force(a) * linear.force, hertz_force(a), FORCE_LIMIT),
            Check(f"a/R = {a:g}: contact radius", a * linear.radius, a, RADIUS_LIMIT),
        ]
        for law in (StVK, NeoHookean):
            deeper = (linear.force / pressed(law, a).force) ** (2 / 3) - 1
            checks.append(Check(f"a/R = {a:g}, {law.__name__}: further indentation", deeper))
    return study_of(
        "Hertz: a ball between two plates",
        f"linear elasticity: the force to {FORCE_LIMIT:.1%}, the contact radius to {RADIUS_LIMIT:.0%}",
        checks,
        f"E = R = 1, nu = {POISSON:g}; quadratic tetrahedra, {ELEMENTS} along a; stiffness {STIFFNESS:g} E/h",
        "further indentation: relative to linear elasticity at the same force; published, not compared",
    )


def hertz_force(a: float) -> float:
    """Return Hertz's force at the contact radius `a`."""
    return 4 / 3 * YOUNG / (1 - POISSON**2) * a**3


def approach(a: float) -> float:
    """Return the approach of the centre of the ball to a plate at the contact radius `a`."""
    far = 2 * (1 + POISSON) / (a**2 + 4) ** 1.5 + (1 - POISSON**2) / (a**2 + 4) ** 0.5
    return a**2 - hertz_force(a) / (np.pi * YOUNG) * far


def pressed(law: Any, a: float, onset: float = 0.0, k: float = STIFFNESS) -> Pressed:
    """Return the result of a ball that is pressed until Hertz's contact radius is `a`."""
    h, mesh = a / ELEMENTS, ball(a)
    plate = RigidContact(
        RigidPlane((0, 0, -1), (0, 0, 1)),
        lambda x: x[2] < -np.sqrt(1 - (2.5 * a) ** 2),
        stiffness=k * YOUNG / h,
        onset=onset * h,
        motion=(0, 0, approach(a)),
    )
    symmetry = {(lambda x, i=i: np.abs(x[i]) < 1e-9): "xyz"[i] for i in range(3)}
    body, start = System(mesh, [law(young=YOUNG, poisson=POISSON), plate], symmetry), perf_counter()
    result = solve_static(body, steps=1, quiet=True)
    seconds = perf_counter() - start
    state = result.contact("contact")  # of a quarter of the contact
    radius = float(np.sqrt(4 * state.area / np.pi))
    return Pressed(float(4 * state.resultant[2] / hertz_force(a)), radius / a, result.history.iterations, seconds)


@cache
def ball(a: float, elements: int = ELEMENTS) -> ElementMesh:
    """Return an octant of the unit ball, meshed by Gmsh, with edges that grow from `a/elements` at the contact at (0, 0, -1)."""
    beyond = f"(Sqrt(x^2 + y^2 + (z + 1)^2) - {1.3 * a})"
    size = {"MeshSizeMax": 0.2, "MeshSizeExtendFromBoundary": 0, "MeshSizeFromPoints": 0}
    with gmsh_session() as gmsh, TemporaryDirectory() as folder:
        occ, field = gmsh.model.occ, gmsh.model.mesh.field
        octant, _ = occ.intersect([(3, occ.addSphere(0, 0, 0, 1))], [(3, occ.addBox(0, 0, -2, 2, 2, 2))])
        occ.synchronize()
        gmsh.model.addPhysicalGroup(3, [octant[0][1]], name="ball")
        field.setAsBackgroundMesh(field.add("MathEval", 1))
        field.setString(1, "F", f"{a / elements} + 0.125 * ({beyond} + Fabs({beyond}))")
        for option, value in (size | {"ElementOrder": 2, "Algorithm3D": 10}).items():
            gmsh.option.setNumber(f"Mesh.{option}", value)
        gmsh.model.mesh.generate(3)
        gmsh.write(str(Path(folder) / "ball.msh"))
        return read_mesh(Path(folder) / "ball.msh")
