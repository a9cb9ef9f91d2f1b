"""Study of a shallow dome through its limit point.

The tetrahedra are compared with the same tetrahedra by displacement control, and with quadratic axisymmetric elements.

    a quarter of  z = H (1 - r^2/R^2), vertical thickness h, clamped at r = R, body force downwards; R = 1, H = 0.3, h = 0.12 m

The dome is thick enough to snap without loss of symmetry: its shallowness `2 (3 (1 - nu^2))^(1/4) sqrt(H/h)` is 4.1.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import skfem

from skfem_stvk import BodyForce, ElementMesh, StVK, System
from skfem_stvk.solvers.statics import StaticResult, Stop

from ..statics.meshes import Array
from . import independent
from .limit_points import Convergence, first, through, wrong
from .picture import Curve, DrawnStudy, Panel

YOUNG, POISSON = 1.0e7, 0.3
LAM, MU = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON)), YOUNG / (2 * (1 + POISSON))
RADIUS, RISE, THICKNESS = 1.0, 0.3, 0.12
FORCE = 1.0e5  # per rest volume, at the load factor 1 [N/m^3]
#: Cells from the middle to the rim, and through the thickness.
MESHES = ((8, 2), (16, 4), (32, 8))
AXISYMMETRIC = (30, 3)
#: Displacements of the apex between which displacement control searches for the limit point [m].
DEPTHS = -RISE * np.linspace(0.1, 1, 10)
#: Limits for the same elements by both methods, and for extrapolated tetrahedra against axisymmetric elements, whose own error is
#: 1e-3.
SAME, LIMIT = 1e-6, 1e-2
ORDER = 2.0, 0.2


def mesh_of(n: int, m: int) -> ElementMesh:
    """Return a mesh of `n x n x m` cells of six tetrahedra on a quarter of the dome; squares are mapped to arcs of circles."""
    lines = np.linspace(0, 1, n + 1)
    cells = skfem.MeshTet.init_tensor(lines, lines, np.linspace(0, 1, m + 1))
    a, b, c = cells.p
    r = np.maximum(a, b)
    angle = np.pi / 4 * np.divide(np.minimum(a, b), r, out=np.zeros_like(r), where=r > 0)
    angle = np.where(a >= b, angle, np.pi / 2 - angle)
    x, y = r * np.cos(angle), r * np.sin(angle)
    x[a == 0], y[b == 0] = 0, 0
    return ElementMesh(np.stack([RADIUS * x, RADIUS * y, RISE * (1 - r**2) + THICKNESS * (c - 0.5)]), cells.t)


def dome(quick: bool = False) -> DrawnStudy:
    """the limit load of a shallow dome agrees with displacement control, and converges to the load of quadratic elements"""
    meshes = MESHES[:2] if quick else MESHES
    count = 1 if quick else 2
    results = [followed(*mesh, count=count) for mesh in meshes]
    linear = Convergence(
        [first(result, "limit point").t for result in results], independent.limit_point(axisymmetric(*AXISYMMETRIC), DEPTHS).t
    )
    twin = independent.limit_point(tetrahedra(*meshes[0]), DEPTHS).t
    rows = linear.rows([f"{n}x{n}x{m}x6" for n, m in meshes])
    rows.append(("{0}x{0}x{1}x6 by displacement control".format(*meshes[0]), f"{twin:.6f}", f"{linear.values[0] / twin - 1:+.1e}"))
    rows.append(("quadratic, axisymmetric", f"{linear.truth:.6f}", ""))
    failures = [f"{n}x{m}: {problem}" for (n, m), result in zip(meshes, results, strict=True) for problem in wrong(result, count)]
    failures += linear.failures(LIMIT, ORDER)
    if not abs(linear.values[0] / twin - 1) <= SAME:
        failures.append(f"limit load = {linear.values[0]:.9f} by arc length; expected {twin:.9f}, by displacement control")
    return DrawnStudy(
        "Shallow dome",
        f"limit load agrees with displacement control to {SAME:g}; extrapolated load within {LIMIT:.0%} of quadratic elements, "
        f"order {ORDER[0]:g} +- {ORDER[1]:g}",
        ("clamped dome, H/h = 2.5", "limit load", "off"),
        tuple(rows),
        tuple(failures),
        (
            f"unit of the load: {FORCE:g} N/m3; displacement control at the apex by scikit-fem, with the same tetrahedra and with "
            "quadratic triangles of the section",
        ),
        panel=partial(_panel, results[-1]),
    )


def followed(n: int, m: int, count: int) -> StaticResult:
    """Return the path of tetrahedra through one limit point, or through both until the deflection is twice the rise."""
    mesh = mesh_of(n, m)
    system = System(mesh, [StVK(young=YOUNG, poisson=POISSON), BodyForce((0, 0, -FORCE))], fixed=SUPPORTS)
    deep = ([_apex(mesh.p)], "z", -2 * RISE)
    return through(system, Stop(turns=1) if count == 1 else Stop(displacement=deep), steps=4)


SUPPORTS = {lambda x: np.isclose(np.hypot(x[0], x[1]), RADIUS): "xyz", lambda x: x[0] == 0: "x", lambda x: x[1] == 0: "y"}


def tetrahedra(n: int, m: int) -> independent.Body:
    """Return the body of the same linear tetrahedra in scikit-fem."""
    mesh = mesh_of(n, m)
    basis = skfem.Basis(skfem.MeshTet(mesh.p, mesh.t), skfem.ElementVector(skfem.ElementTetP1()), intorder=1)
    constrained = [3 * np.flatnonzero(where(mesh.p)) + "xyz".index(c) for where, components in SUPPORTS.items() for c in components]
    load = skfem.LinearForm(lambda v, w: -FORCE * v[2]).assemble(basis)
    free = np.setdiff1d(np.arange(basis.N), np.concatenate(constrained))
    return independent.Body(basis, LAM, MU, load, free, 3 * _apex(mesh.p) + 2)


def axisymmetric(n: int, m: int) -> independent.Body:
    """Return the axisymmetric body of the dome, whose section is meshed with quadratic triangles."""
    cells = skfem.MeshTri.init_tensor(np.linspace(0, 1, n + 1), np.linspace(0, 1, m + 1))
    r, c = cells.p
    mesh = skfem.MeshTri(np.stack([RADIUS * r, RISE * (1 - r**2) + THICKNESS * (c - 0.5)]), cells.t)
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTriP2()), intorder=4)
    load = skfem.LinearForm(lambda v, w: -FORCE * v[1] * 2 * np.pi * w.x[0]).assemble(basis)
    constrained = [basis.get_dofs(lambda x: x[0] == RADIUS).all(), basis.get_dofs(lambda x: x[0] == 0).all("u^1")]
    free = np.setdiff1d(np.arange(basis.N), np.concatenate(constrained))
    control = 2 * int(np.argmin(np.hypot(mesh.p[0], mesh.p[1] - RISE))) + 1
    return independent.Body(basis, LAM, MU, load, free, control, independent.axisymmetric)


def _apex(x: Array) -> int:
    """Return the index of the point (3, n) nearest to the apex of the dome."""
    return int(np.argmin(np.linalg.norm(x - np.array([[0], [0], [RISE]]), axis=0)))


def _panel(result: StaticResult) -> Panel:
    control = 3 * _apex(result.system.mesh.p) + 2
    points = list(independent.path(axisymmetric(20, 2), -RISE * np.linspace(0.05, 2, 40)))
    return Panel(
        "Shallow clamped dome, H/h = 2.5",
        ("depth of the apex w/H", "body force [1e5 N/m³]"),
        (Curve([-point.w / RISE for point in points], [point.t for point in points], "axisymmetric P2, displacement control"),),
        (Curve(-result.history.u[:, control] / RISE, result.history.t, f"{result.system.mesh.nt} tetrahedra, arc length"),),
        Curve(
            [-point.u[control] / RISE for point in result.critical_points],
            [point.t for point in result.critical_points],
            "limit points",
        ),
    )
