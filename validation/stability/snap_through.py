"""Study of one bar that snaps through. The energy is that of a single edge, and the whole path has a closed form.

The bar connects a hinge at (0, 0) with a vertical slider at (L, a). The force P moves the slider down by w:

    l0^2 = L^2 + a^2       zeta = (a - w)^2 - a^2 = w (w - 2a)
    P    = EA/(2 l0^3) w (w - a)(w - 2a)          limit points at w = a (1 -+ 1/sqrt 3) with P = +- EA a^3/(3 sqrt 3 l0^3)
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from skfem_stvk import ElementMesh, NodalLoad, StVK, System
from skfem_stvk.arguments import Array
from skfem_stvk.solvers.statics import StaticResult, Stop

from ..study import Study
from .limit_points import through

#: Tolerance of loads relative to the limit load: round-off of three factors, and the residual of Newton's method.
LIMIT = 1e-10
#: Tolerance of the depths of the limit points relative to the rise; limit points are resolved to 1e-10 of a step.
DEPTH_LIMIT = 1e-9
LOAD = 3.0  # load at the end of the path, in limit loads


class Bar(NamedTuple):
    """Bar with half span and rise [m], Young's modulus [Pa] and area [m^2]."""

    span: float
    rise: float
    young: float
    area: float

    @property
    def limit_load(self) -> float:
        """Limit load [N]."""
        return self.young * self.area * self.rise**3 / (3 * np.sqrt(3) * (self.span**2 + self.rise**2) ** 1.5)

    def force(self, w: Array) -> Array:
        """Return the force `P` [N] at the depths `w` [m]."""
        return self.young * self.area / (2 * (self.span**2 + self.rise**2) ** 1.5) * w * (w - self.rise) * (w - 2 * self.rise)

    @property
    def limit_points(self) -> tuple[float, float]:
        """Depths `w` of the limit points [m]."""
        return self.rise * (1 - 1 / np.sqrt(3)), self.rise * (1 + 1 / np.sqrt(3))

    def system(self) -> System:
        """Return the bar under its limit load."""
        mesh = ElementMesh(np.array([[0, self.span], [0, self.rise]]), np.array([[0], [1]], dtype=np.int32))
        bar = StVK(young=self.young, poisson=0.3, area=self.area)
        return System(mesh, [bar, NodalLoad([1], (0, -self.limit_load))], fixed=[([0], "xy"), ([1], "x")])


#: Bars with an inclination of 45 degrees, a flat and a steep one.
BARS = (Bar(1.0, 1.0, 3.0, 0.7), Bar(2.0, 0.3, 2.1e5, 0.04), Bar(0.4, 1.3, 7.0e10, 1e-4))


def snap_through(quick: bool = False) -> Study:
    """a bar that snaps through stays on the path of the closed form to 1e-10, there and back"""
    rows, failures = [], []
    for bar in BARS:
        there, back = paths(bar)
        for way, result, points in (("there", there, bar.limit_points), ("back", back, bar.limit_points[::-1])):
            off = distance(bar, result)
            found = [(-point.u[3], point.t) for point in result.critical_points]
            exact = [(points[0], 1.0), (points[1], -1.0)] if way == "there" else [(points[0], -1.0), (points[1], 1.0)]
            row = (f"{bar.span:g} x {bar.rise:g}", way, str(len(result.history)), f"{off:.1e}")
            numbers = [f"{number:.10f}" for w, t in found[:2] for number in (w / bar.rise, t)]
            rows.append((*row, *numbers, *[""] * (4 - len(numbers))))
            failures += [f"{' '.join(row[:2])}: {failure}" for failure in _failures(result, off, found, exact, bar.rise)]
    return Study(
        "One bar snapping through",
        f"states and limit points are on the closed form's path to {LIMIT:g} of the limit load; depths of limit points are correct "
        f"to {DEPTH_LIMIT:g} of the rise",
        ("half span x rise", "way", "states", "off", "1st limit at w/a", "P/P_limit", "2nd at w/a", "P/P_limit"),
        tuple(rows),
        tuple(failures),
        ("limit points are at w/a = 1 -+ 1/sqrt(3) = 0.4226497308, 1.5773502692 with P/P_limit = 1, -1",),
    )


def paths(bar: Bar) -> tuple[StaticResult, StaticResult]:
    """Return the path through both limit points to `LOAD` limit loads, and the path back to `-LOAD` limit loads."""
    system = bar.system()
    there = through(system, Stop(load=LOAD), steps=10, rtol=1e-13)
    return there, through(system, Stop(load=-LOAD), steps=10, rtol=1e-13, u0=there.u, t0=there.t)


def distance(bar: Bar, result: StaticResult) -> float:
    """Return the largest distance of the states from the path of the closed form, in limit loads."""
    return float(np.abs(bar.force(-result.history.u[:, 3]) / bar.limit_load - result.history.t).max())


def _failures(
    result: StaticResult, off: float, found: list[tuple[float, float]], exact: list[tuple[float, float]], rise: float
) -> list[str]:
    """Return the faults of a path and its limit points `(w, t)`."""
    failures = [] if off <= LIMIT else [f"distance from the path = {off:.1e}; expected at most {LIMIT:g}"]
    kinds = [point.kind for point in result.critical_points]
    if kinds != ["limit point"] * 2:
        return [*failures, f"{', '.join(kinds) or 'nothing'} found; expected two limit points"]
    for (w, t), (w_exact, t_exact) in zip(found, exact, strict=True):
        if not (abs(t - t_exact) <= LIMIT and abs(w - w_exact) <= DEPTH_LIMIT * rise):
            failures.append(f"limit point at w = {w:.10g}, t = {t:.12g}; expected {w_exact:.10g}, {t_exact:g}")
    return failures
