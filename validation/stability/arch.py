"""A shallow clamped arch through its limit point: linear triangles against quadratic ones, and these against the theory of shallow
arches.

    middle line  y = e (1 - cos(2 pi x/L))/2         load per length  p = -q cos(2 pi x/L), downwards

In the theory of shallow arches (strains of the axis from slopes, plane sections) it stays of this shape with another rise b, since
bending and axial force answer with the load's shape, too. With E' = E/(1 - nu^2) in plane strain, I = h^3/12, A = h and r^2 = I/A:

    q = 8 pi^4 E'I/L^4 (e - b) + pi^4 E'A/(2 L^4) b (e^2 - b^2)           limit point at b^2 = (e^2 - 16 r^2)/3

for 4 r < e; above e = 6.4 r the arch would leave this path before, to one side. A body differs from it by shear and slopes, of
order (h/L)^2.
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import numpy as np
import skfem

from skfem_stvk import BodyForce, ElementMesh, StVK, System
from skfem_stvk.statics import StaticResult, Stop

from ..statics.meshes import Array, strip
from ..statics.orders import extrapolated
from . import independent
from .limit_points import Convergence, first, through, wrong
from .picture import Curve, Drawn, Panel

YOUNG, POISSON = 1.2e7, 0.3
LAM, MU = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON)), YOUNG / (2 * (1 + POISSON))
STIFFNESS = YOUNG / (1 - POISSON**2)
MESHES = ((100, 2), (200, 4), (400, 8), (800, 16))
#: Elements along quadratic arches of these slendernesses; two through the thickness.
SLENDER = ((50, 100), (100, 100))
#: Extrapolated linear triangles against quadratic ones, which are good to 1e-4 themselves; quadratic ones, extrapolated, against
#: the theory.
LIMIT, THEORY_LIMIT = 1e-3, 1e-3
ORDER = 2.0, 0.15


class Arch(NamedTuple):
    """An arch of span 1 and thickness `1/slenderness` [m]; its rise `e` is 5.5 radii of gyration."""

    slenderness: int = 50

    @property
    def thickness(self) -> float:
        return 1 / self.slenderness

    @property
    def rise(self) -> float:
        return float(5.5 * self.thickness / np.sqrt(12))

    @property
    def limit_rise(self) -> float:
        """`b` at the limit point."""
        return float(np.sqrt((self.rise**2 - 16 * self.thickness**2 / 12) / 3))

    def load(self, b: Array | float) -> Array:
        """`q` [N/m] at the rise `b`."""
        e, h = self.rise, self.thickness
        bending = 8 * np.pi**4 * STIFFNESS * h**3 / 12 * (e - b)
        return np.asarray(bending + np.pi**4 / 2 * STIFFNESS * h * b * (e**2 - b**2))

    def body_force(self, x: Array, t: float) -> Array:
        """(2, n) force per volume [N/m^3], in limit loads of the theory."""
        upwards = t * self.load(self.limit_rise) / self.thickness * np.cos(2 * np.pi * x[0])
        return np.stack([np.zeros_like(upwards), upwards])

    def place(self, a: Array, b: Array) -> tuple[Array, Array]:
        """The unit square's points on the arch, across its middle line."""
        slope, across = self.rise * np.pi * np.sin(2 * np.pi * a), self.thickness * (b - 0.5)
        length = np.hypot(1, slope)
        return a - across * slope / length, self.rise * (1 - np.cos(2 * np.pi * a)) / 2 + across / length

    def mesh(self, nx: int, ny: int) -> ElementMesh:
        """Strip of triangles."""
        return strip(nx, ny, self.place)

    def apex(self, x: Array) -> int:
        """Which of the points (2, n) is the middle of the arch."""
        return int(np.argmin(np.hypot(x[0] - 0.5, x[1] - self.rise)))


def arch(quick: bool = False) -> Drawn:
    """the limit load of a shallow arch converges with order 2 to that of quadratic elements, and these to the theory"""
    body, meshes = Arch(), MESHES[:3] if quick else MESHES
    slender = {s: quadratic(Arch(s), n).t for s, n in SLENDER}
    turns = 1 if quick else 2
    results = [followed(body, *mesh, turns=turns) for mesh in meshes]
    linear = Convergence([first(result, "limit point").t for result in results], slender[body.slenderness])
    theory = extrapolated(list(slender.values()))
    rows = linear.rows([f"P1 {nx}x{ny}x2, L/h = {body.slenderness:g}" for nx, ny in meshes])
    rows += [(f"P2 {n}x2x2, L/h = {s:g}", f"{slender[s]:.6f}", "") for s, n in SLENDER]
    rows.append(("P2, extrapolated to h/L = 0", f"{theory:.6f}", f"{theory - 1:+.3%}"))
    failures = [
        f"{nx}x{ny}: {problem}" for (nx, ny), result in zip(meshes, results, strict=True) for problem in wrong(result, turns)
    ]
    failures += linear.failures(LIMIT, ORDER)
    if not abs(theory - 1) <= THEORY_LIMIT:
        failures.append(f"quadratic elements tend to {theory:.6f} of the theory of shallow arches")
    return Drawn(
        "Shallow arch",
        f"limit load extrapolated within {LIMIT:.1%} of quadratic elements, order {ORDER[0]:g} +- {ORDER[1]:g}; these within "
        f"{THEORY_LIMIT:.1%} of the theory",
        ("clamped arch, rise 5.5 radii of gyration", "limit load", "off"),
        tuple(rows),
        tuple(failures),
        (
            "limit loads in those of the theory; P2: scikit-fem's quadratic triangles, the same law, displacement control at the "
            "apex",
        ),
        panel=partial(_panel, body, results[-1]),
    )


def followed(body: Arch, nx: int, ny: int, turns: int) -> StaticResult:
    """The path of linear triangles through one limit point, or through both until the arch hangs as deep as it stood."""
    mesh = body.mesh(nx, ny)
    system = System(
        mesh, [StVK(young=YOUNG, poisson=POISSON), BodyForce(body.body_force)], fixed=[(np.isin(mesh.p[0], (0, 1)), "xy")]
    )
    deep = ([body.apex(mesh.p)], "y", -2 * body.rise)
    return through(system, Stop(turns=1) if turns == 1 else Stop(displacement=deep), steps=10)


def quadratic(body: Arch, nx: int) -> independent.Point:
    """The limit point of quadratic triangles, two through the thickness."""
    return independent.limit_point(triangles(body, nx), -body.rise * np.linspace(0.1, 1, 10))


def triangles(body: Arch, nx: int) -> independent.Body:
    """Quadratic triangles on the mesh of the linear ones."""
    mesh = body.mesh(nx, 2)
    basis = skfem.Basis(skfem.MeshTri(mesh.p, mesh.t), skfem.ElementVector(skfem.ElementTriP2()), intorder=4)

    @skfem.LinearForm
    def load(v: Any, w: Any) -> Any:
        return np.einsum("i...,i...->...", body.body_force(w.x, 1.0), v)

    held = basis.get_dofs(lambda x: np.isin(x[0], (0, 1))).all()
    control = 2 * body.apex(mesh.p) + 1
    return independent.Body(basis, LAM, MU, load.assemble(basis), np.setdiff1d(np.arange(basis.N), held), control)


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
