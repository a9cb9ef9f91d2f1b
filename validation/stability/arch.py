"""Study of a shallow clamped arch through its limit point: linear triangles, quadratic triangles and the theory of shallow arches.

    middle line  y = e (1 - cos(2 pi x/L))/2         load per length  p = -q cos(2 pi x/L), downwards

The theory of shallow arches takes the strain of the axis from slopes and has plane sections. In this theory the deformed arch has
the same shape with another rise b, because bending moments and axial force have the shape of the load. With E' = E/(1 - nu^2) in
plane strain, I = h^3/12, A = h and r^2 = I/A:

    q = 8 pi^4 E'I/L^4 (e - b) + pi^4 E'A/(2 L^4) b (e^2 - b^2)           limit point at b^2 = (e^2 - 16 r^2)/3

for 4 r < e. Above e = 6.4 r the arch would leave this path sideways before the limit point. A body differs from the theory by shear
and slopes, by the order (h/L)^2.
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import numpy as np
import skfem

from skfem_stvk import BodyForce, ElementMesh, StVK, System
from skfem_stvk.solvers.statics import StaticResult, Stop

from ..statics.meshes import Array, strip
from ..statics.orders import extrapolated
from . import independent
from .limit_points import Convergence, first, through, wrong
from .picture import Curve, DrawnStudy, Panel

YOUNG, POISSON = 1.2e7, 0.3
LAM, MU = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON)), YOUNG / (2 * (1 + POISSON))
STIFFNESS = YOUNG / (1 - POISSON**2)
MESHES = ((100, 2), (200, 4), (400, 8), (800, 16))
#: Slendernesses of the quadratic arches, and their numbers of elements along the arch, with two through the thickness.
SLENDER = ((50, 100), (100, 100))
#: Limits of the extrapolated linear triangles against quadratic triangles, whose own error is 1e-4, and of the extrapolated
#: quadratic triangles against the theory.
LIMIT, THEORY_LIMIT = 1e-3, 1e-3
ORDER = 2.0, 0.15


class Arch(NamedTuple):
    """Arch of span 1 m and thickness `1/slenderness` [m], with a rise `e` of 5.5 radii of gyration."""

    slenderness: int = 50

    @property
    def thickness(self) -> float:
        return 1 / self.slenderness

    @property
    def rise(self) -> float:
        return float(5.5 * self.thickness / np.sqrt(12))

    @property
    def limit_rise(self) -> float:
        """Rise `b` at the limit point [m]."""
        return float(np.sqrt((self.rise**2 - 16 * self.thickness**2 / 12) / 3))

    def load(self, b: Array | float) -> Array:
        """Return the load `q` [N/m] at the rise `b`."""
        e, h = self.rise, self.thickness
        bending = 8 * np.pi**4 * STIFFNESS * h**3 / 12 * (e - b)
        return np.asarray(bending + np.pi**4 / 2 * STIFFNESS * h * b * (e**2 - b**2))

    def body_force(self, x: Array, t: float) -> Array:
        """Return the force per volume (2, n) [N/m^3]; at t = 1 it is the limit load of the theory."""
        upwards = t * self.load(self.limit_rise) / self.thickness * np.cos(2 * np.pi * x[0])
        return np.stack([np.zeros_like(upwards), upwards])

    def map_to_arch(self, a: Array, b: Array) -> tuple[Array, Array]:
        """Return the points of the unit square on the arch; `a` is along the middle line and `b` is normal to it."""
        slope, across = self.rise * np.pi * np.sin(2 * np.pi * a), self.thickness * (b - 0.5)
        length = np.hypot(1, slope)
        return a - across * slope / length, self.rise * (1 - np.cos(2 * np.pi * a)) / 2 + across / length

    def mesh(self, nx: int, ny: int) -> ElementMesh:
        """Return a strip of triangles."""
        return strip(nx, ny, self.map_to_arch)

    def apex(self, x: Array) -> int:
        """Return the index of the apex of the arch among the points (2, n)."""
        return int(np.argmin(np.hypot(x[0] - 0.5, x[1] - self.rise)))


def arch(quick: bool = False) -> DrawnStudy:
    """the limit load of a shallow arch converges with order 2 to that of quadratic elements, which converges to the theory"""
    body, meshes = Arch(), MESHES[:3] if quick else MESHES
    slender = {s: quadratic(Arch(s), n).t for s, n in SLENDER}
    count = 1 if quick else 2
    results = [followed(body, *mesh, count=count) for mesh in meshes]
    linear = Convergence([first(result, "limit point").t for result in results], slender[body.slenderness])
    theory = extrapolated(list(slender.values()))
    rows = linear.rows([f"P1 {nx}x{ny}x2, L/h = {body.slenderness:g}" for nx, ny in meshes])
    rows += [(f"P2 {n}x2x2, L/h = {s:g}", f"{slender[s]:.6f}", "") for s, n in SLENDER]
    rows.append(("P2, extrapolated to h/L = 0", f"{theory:.6f}", f"{theory - 1:+.3%}"))
    failures = [
        f"{nx}x{ny}: {problem}" for (nx, ny), result in zip(meshes, results, strict=True) for problem in wrong(result, count)
    ]
    failures += linear.failures(LIMIT, ORDER)
    if not abs(theory - 1) <= THEORY_LIMIT:
        failures.append(f"limit load of quadratic elements = {theory:.6f} of the theory of shallow arches")
    return DrawnStudy(
        "Shallow arch",
        f"extrapolated limit load within {LIMIT:.1%} of quadratic elements, order {ORDER[0]:g} +- {ORDER[1]:g}; quadratic elements "
        f"within {THEORY_LIMIT:.1%} of the theory",
        ("clamped arch, rise 5.5 radii of gyration", "limit load", "off"),
        tuple(rows),
        tuple(failures),
        (
            "limit loads are divided by the theory's; P2: scikit-fem's quadratic triangles, the same law, displacement control at "
            "the apex",
        ),
        panel=partial(_panel, body, results[-1]),
    )


def followed(body: Arch, nx: int, ny: int, count: int) -> StaticResult:
    """Return the path of linear triangles through one limit point, or through both until the deflection is twice the rise."""
    mesh = body.mesh(nx, ny)
    system = System(
        mesh, [StVK(young=YOUNG, poisson=POISSON), BodyForce(body.body_force)], fixed=[(np.isin(mesh.p[0], (0, 1)), "xy")]
    )
    deep = ([body.apex(mesh.p)], "y", -2 * body.rise)
    return through(system, Stop(turns=1) if count == 1 else Stop(displacement=deep), steps=10)


def quadratic(body: Arch, nx: int) -> independent.Point:
    """Return the limit point of quadratic triangles, two through the thickness."""
    return independent.limit_point(triangles(body, nx), -body.rise * np.linspace(0.1, 1, 10))


def triangles(body: Arch, nx: int) -> independent.Body:
    """Return the body of quadratic triangles on the mesh of the linear triangles."""
    mesh = body.mesh(nx, 2)
    basis = skfem.Basis(skfem.MeshTri(mesh.p, mesh.t), skfem.ElementVector(skfem.ElementTriP2()), intorder=4)

    @skfem.LinearForm
    def load(v: Any, w: Any) -> Any:
        return np.einsum("i...,i...->...", body.body_force(w.x, 1.0), v)

    constrained = basis.get_dofs(lambda x: np.isin(x[0], (0, 1))).all()
    control = 2 * body.apex(mesh.p) + 1
    return independent.Body(basis, LAM, MU, load.assemble(basis), np.setdiff1d(np.arange(basis.N), constrained), control)


def _panel(body: Arch, result: StaticResult) -> Panel:
    b = np.linspace(body.rise, -body.rise, 200)
    apex = 2 * body.apex(result.system.mesh.p) + 1
    scale, critical = -1 / body.rise, result.critical_points
    points = list(independent.path(triangles(body, 50), -body.rise * np.linspace(0.05, 2, 40)))
    return Panel(
        f"Shallow clamped arch, L/h = {body.slenderness:g}",
        ("depth of the apex w/e", "q / limit load of the theory"),
        (
            Curve(1 - b / body.rise, body.load(b) / body.load(body.limit_rise), "theory of shallow arches"),
            Curve([scale * point.w for point in points], [point.t for point in points], "P2, displacement control"),
        ),
        (Curve(scale * result.history.u[:, apex], result.history.t, f"{result.system.mesh.nt} P1, arc length"),),
        Curve([scale * point.u[apex] for point in critical], [point.t for point in critical], "limit points"),
    )
