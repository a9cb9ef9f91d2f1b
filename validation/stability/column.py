"""Study of Euler's column, clamped at its foot and free at its head: buckling load and buckling mode.

    P_E = pi^2 E I/(4 L^2)        v(x) = 1 - cos(pi x/(2 L))

A body of height h differs from Euler's column by compression and shear, by the order (h/L)^2. With nu = 0 and without imperfection,
the straight path is an exact solution, and the buckled path branches off it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skfem_stvk import ElementMesh, StVK, System, Traction
from skfem_stvk.solvers.statics import CriticalPoint, Stop

from ..statics.meshes import strip
from ..statics.orders import extrapolated
from ..study import Study
from .limit_points import Convergence, first, through

YOUNG, LENGTH = 1.2e7, 1.0
SLENDER = (10, 20, 40)
#: Elements through the height; the number of elements along the column makes them square.
FINE = (2, 4, 8, 16)
#: Limits after extrapolation over meshes, and after extrapolation over slenderness, which leaves only errors of extrapolation.
LIMIT, THIN_LIMIT = 1e-2, 3e-4
MEANT = 20  # smallest slenderness at which loads agree with Euler's load to 1 %
MODE_LIMIT = 1e-3
#: Load at the end of the path, in Euler's loads; above 1, because coarse meshes are too stiff.
LAST = 1.8


class Column(NamedTuple):
    """Column of length 1 m, height `1/slenderness` [m] and unit depth, with `fine` elements through the height."""

    slenderness: int
    fine: int

    @property
    def height(self) -> float:
        return LENGTH / self.slenderness

    @property
    def euler_load(self) -> float:
        """Euler's load `P_E` [N]."""
        return float(np.pi**2 * YOUNG * self.height**3 / 12 / (4 * LENGTH**2))

    def mesh(self) -> ElementMesh:
        """Return a strip of triangles whose middle line is on the x-axis."""
        return strip(self.slenderness * self.fine, self.fine, lambda a, b: (LENGTH * a, self.height * (b - 0.5)))

    def system(self, mesh: ElementMesh) -> System:
        """Return the column, clamped at x = 0, with Euler's load at x = L.

        `mesh` is `self.mesh()`, possibly with an imperfection.
        """
        head = self.mesh().p[0] == LENGTH
        press = Traction(head, (-self.euler_load / self.height, 0))
        return System(mesh, [StVK(young=YOUNG, poisson=0.0), press], fixed=[(self.mesh().p[0] == 0, "xy")])

    def middle(self) -> NDArray[np.int64]:
        """Return the vertices on the middle line, from foot to head."""
        return np.arange(self.fine // 2, (self.slenderness * self.fine + 1) * (self.fine + 1), self.fine + 1)

    def buckled(self) -> CriticalPoint:
        """Return the first bifurcation of the straight path."""
        return first(through(self.system(self.mesh()), Stop(load=LAST), steps=4), "bifurcation")


def column(quick: bool = False) -> Study:
    """a clamped column buckles at Euler's load, extrapolated within 1 %, in Euler's mode"""
    slender, fine = (SLENDER[:2], FINE[:3]) if quick else (SLENDER, FINE)
    points = {s: [Column(s, n).buckled() for n in fine] for s in slender}
    found = {s: Convergence([point.t for point in several], 1.0) for s, several in points.items()}
    thin = extrapolated([one.limit for one in found.values()])
    modes = [mode_error(Column(s, fine[-1]), several[-1]) for s, several in points.items()]
    rows = [
        (f"L/h = {s}", *(f"{load:.5f}" for load in one.values), f"{one.limit:.5f}", f"{mode:.1e}")
        for (s, one), mode in zip(found.items(), modes, strict=True)
    ]
    rows.append(("extrapolated to h/L = 0", *[""] * len(fine), f"{thin:.5f}", ""))
    failures = [
        f"L/h = {s}: extrapolated load = {one.limit:.5f} of Euler's load"
        for s, one in found.items()
        if s >= MEANT and not abs(one.limit - 1) <= LIMIT
    ]
    failures += [
        f"L/h = {s}: error of the mode = {mode:.1e}" for s, mode in zip(slender, modes, strict=True) if not mode <= MODE_LIMIT
    ]
    if not abs(thin - 1) <= THIN_LIMIT:
        failures.append(f"limit of thin columns = {thin:.5f} of Euler's load")
    return Study(
        "Euler's column",
        f"extrapolated load within {LIMIT:.0%} of Euler's load for L/h >= {MEANT}, within {THIN_LIMIT:.2%} for thin columns; mode "
        f"within {MODE_LIMIT:g}",
        ("load / Euler's", *(f"{n} through h" for n in fine), "extrapolated", "mode off by"),
        tuple(rows),
        tuple(failures),
        ("bifurcations of the straight path, nu = 0; the mode along the middle line against 1 - cos(pi x/2L), both 1 at the head",),
    )


def mode_error(body: Column, point: CriticalPoint) -> float:
    """Return the largest difference between the mode's deflection and Euler's; both are 1 at the head."""
    deflection = point.mode.reshape(-1, 2)[body.middle(), 1]
    x = np.linspace(0, 1, len(deflection))
    return float(np.abs(deflection / deflection[-1] - (1 - np.cos(np.pi * x / 2))).max())
