"""Study of the limit points of the law: a body compressed to 1/sqrt(3) of its length has reached its largest load.

    nominal stress  P = M/2 s (s^2 - 1),  least at s = 1/sqrt(3):  P = -M/(3 sqrt 3)

with M = lam + 2 mu in uniaxial strain, E in uniaxial stress, and E/(1 - nu^2) in plane strain with one free direction. Each case is
one simplex, because several simplices would lose stability one by one. Its base is at x = 0, and the load presses its apex towards
the base. One more case is a chain of unequal segments, whose weakest segment determines the limit load.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from skfem_stvk import ElementMesh, NodalLoad, StVK, System
from skfem_stvk.solvers.statics import CriticalPoint, Stop

from ..study import Study
from .limit_points import first, through

YOUNG, POISSON = 2.1e5, (0.0, 0.3, 0.45)
#: Limit of the errors of stretch and load; limit points are resolved to 1e-10 of a step.
LIMIT = 1e-8
CRITICAL = 1 / np.sqrt(3)


def confined(nu: float) -> float:
    """Return `(lam + 2 mu)/E`."""
    return (1 - nu) / ((1 + nu) * (1 - 2 * nu))


class Case(NamedTuple):
    """Simplex with its vertices (last: apex), constrained components of each vertex, `M/E` as a function of nu, and options."""

    name: str
    vertices: tuple[tuple[float, ...], ...]
    constrained: tuple[str, ...]
    modulus: Callable[[float], float]
    options: dict[str, Any]

    @property
    def section(self) -> float:
        """Area that times `P` is the force at the apex [m^2]: a third, half or all of the base, times thickness or area."""
        sides = np.diff(np.array(self.vertices)[:-1, 1:], axis=0)
        base = float(np.sqrt(np.linalg.det(sides @ sides.T))) / (1, 1, 2)[len(sides)]
        return base / len(self.vertices[0]) * float(self.options.get("thickness", self.options.get("area", 1.0)))

    def limit_point(self, nu: float) -> tuple[float, float]:
        """Return the stretch and the load divided by `M/(3 sqrt 3)` at the limit point."""
        k = len(self.vertices[0])
        mesh = ElementMesh(np.array(self.vertices).T, np.arange(k + 1, dtype=np.int32)[:, None])
        force = YOUNG * self.modulus(nu) / (3 * np.sqrt(3)) * self.section
        load = NodalLoad([k], (-force, *[0.0] * (k - 1)))
        fixed = [([vertex], components) for vertex, components in enumerate(self.constrained) if components]
        point = first_limit_point(System(mesh, [StVK(young=YOUNG, poisson=nu, **self.options), load], fixed=fixed))
        return float(1 + point.u[k * k] / self.vertices[-1][0]), point.t


TRIANGLE = ((0.0, 0.0), (0.0, 1.1), (0.7, 0.4))
TETRAHEDRON = ((0.0, 0.0, 0.0), (0.0, 1.1, 0.0), (0.0, 0.3, 0.8), (0.6, 0.5, 0.2))
CASES = (
    Case("uniaxial strain, tetrahedron", TETRAHEDRON, ("xyz", "xyz", "xyz", "yz"), confined, {}),
    Case("uniaxial strain, triangle", TRIANGLE, ("xy", "xy", "y"), confined, {}),
    Case("uniaxial stress, tetrahedron", TETRAHEDRON, ("xyz", "xz", "x", ""), lambda nu: 1.0, {}),
    Case("uniaxial stress, triangle", TRIANGLE, ("xy", "x", ""), lambda nu: 1.0, {"plane": "stress", "thickness": 0.1}),
    Case("free to one side, triangle", TRIANGLE, ("xy", "x", ""), lambda nu: 1 / (1 - nu**2), {}),
    Case("uniaxial stress, segment", ((0.0,), (1.7,)), ("x", ""), lambda nu: 1.0, {"area": 0.02}),
)
#: Coordinates of the joints and areas of the segments of a chain; the third segment is the weakest.
JOINTS, AREAS = np.array([0.0, 1.0, 1.5, 1.9, 3.0]), np.array([0.03, 0.021, 0.02, 0.04])


def law(quick: bool = False) -> Study:
    """limit points of the law in uniaxial strain and stress are at 1/sqrt(3) of the length, to 1e-8"""
    found = [(case.name, f"{nu:g}", *case.limit_point(nu)) for case in CASES for nu in POISSON]
    found.append(("uniaxial stress, weakest of a chain", "", *chain()))
    return Study(
        "Limit points of the law",
        f"at s = 1/sqrt(3) = {CRITICAL:.10f} with P = -M/(3 sqrt 3), each to {LIMIT:g}",
        ("state", "nu", "limit point at s", "off", "load over M/(3 sqrt 3)", "off by"),
        tuple((name, nu, f"{s:.10f}", f"{s - CRITICAL:+.1e}", f"{t:.10f}", f"{t - 1:+.1e}") for name, nu, s, t in found),
        tuple(
            f"{name}, nu = {nu}: s = {s:.10f}, load = {t:.10f}; expected {CRITICAL:.10f}, 1"
            for name, nu, s, t in found
            if not _right(s, t)
        ),
        ("M: lam + 2 mu, E, or E/(1 - nu^2)",),
    )


def _right(s: float, t: float) -> bool:
    return abs(s - CRITICAL) <= LIMIT and abs(t - 1) <= LIMIT


def chain() -> tuple[float, float]:
    """Return the stretch of the weakest segment at the limit point, and the load divided by `E/(3 sqrt 3)` times its area."""
    n, weakest = len(AREAS), int(np.argmin(AREAS))
    mesh = ElementMesh(JOINTS[None], np.stack([np.arange(n), np.arange(1, n + 1)]).astype(np.int32))
    load = NodalLoad([n], [-YOUNG / (3 * np.sqrt(3)) * AREAS[weakest]])
    point = first_limit_point(System(mesh, [StVK(young=YOUNG, poisson=0.3, area=AREAS), load], fixed=[([0], "x")]))
    return float(1 + np.diff(point.u)[weakest] / np.diff(JOINTS)[weakest]), point.t


def first_limit_point(system: System) -> CriticalPoint:
    """Return the first limit point on the path."""
    return first(through(system, Stop(turns=1), steps=10, rtol=1e-12), "limit point")
