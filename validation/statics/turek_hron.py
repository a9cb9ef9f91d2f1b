"""Elastic flag of Turek and Hron (2006) under gravity, cases CSM1 and CSM2, in plane strain.

The clamp is an arc of the cylinder with centre (0.2, 0.2) and radius 0.05. The flag's corners there are at x = 0.2489898. Point A
is (0.6, 0.2).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from skfem_stvk import Gravity, StVK, System, solve_static

from ..study import Study
from .meshes import Array, strip
from .orders import extrapolated, fitted_order

END, HEIGHT, RADIUS, CENTRE = 0.6, 0.02, 0.05, 0.2
POISSON, DENSITY, GRAVITY = 0.4, 1000.0, 2.0
MESHES = ((70, 4), (140, 8), (280, 16), (560, 32))
LIMIT, ORDER, ORDER_LIMIT = 1e-3, 2.0, 0.2


class Case(NamedTuple):
    """Case with its reference: displacements of A on the finest level (392 196 unknowns) of FeatFlow's benchmark page."""

    name: str
    young: float
    reference: tuple[float, float]


CASES = (Case("CSM1", 1.4e6, (-7.18739e-3, -66.1009e-3)), Case("CSM2", 5.6e6, (-0.468981e-3, -16.9735e-3)))


class Finding(NamedTuple):
    """Component of the displacement of A on all meshes [m]."""

    case: Case
    component: int
    values: Array

    @property
    def reference(self) -> float:
        return self.case.reference[self.component]

    @property
    def order(self) -> float:
        """Order of convergence, fitted to the differences from the reference on the three finest meshes."""
        return fitted_order([4, 2, 1], np.abs(self.values[-3:] - self.reference))

    @property
    def limit(self) -> float:
        """Richardson extrapolation of the values."""
        return extrapolated(self.values)


def turek_hron(quick: bool = False) -> Study:
    """Compare the extrapolated CSM1 and CSM2 of Turek and Hron with the reference; they agree within 0.1 %."""
    meshes = MESHES[:3] if quick else MESHES
    tips = {case: np.array([tip(case, nx, ny) for nx, ny in meshes]) for case in CASES}
    findings = [Finding(case, i, tips[case][:, i]) for case in CASES for i in (0, 1)]
    return Study(
        "Turek-Hron CSM1 and CSM2",
        f"extrapolated within {LIMIT:.1%} of the reference, with order {ORDER:g} +- {ORDER_LIMIT:g}",
        ("case", "of A [mm]", *(f"{nx}x{ny}x2" for nx, ny in meshes), "order", "extrapolated", "reference", "off"),
        tuple(map(_row, findings)),
        tuple(failure for finding in findings for failure in _failures(finding)),
        (
            "the order is fitted to the differences from the reference on the three finest meshes; extrapolation by Richardson, "
            "repeated; the flag's clamp is the arc of the cylinder",
        ),
    )


def tip(case: Case, nx: int, ny: int) -> Array:
    """Return the displacement (2,) of A [m]."""
    mesh = strip(nx, ny, flag)
    flag_itself = StVK(young=case.young, poisson=POISSON, density=DENSITY)
    system = System(mesh, [flag_itself, Gravity((0, -GRAVITY))], fixed=[(np.arange(ny + 1), "xy")])
    result = solve_static(system, steps=4, quiet=True)
    a = np.argmin(np.hypot(mesh.p[0] - END, mesh.p[1] - CENTRE))
    return result.u.reshape(-1, 2)[a]


def flag(a: Array, b: Array) -> tuple[Array, Array]:
    """Map the unit square to the flag, from the arc to the free end."""
    y = CENTRE + HEIGHT * (b - 0.5)
    arc = CENTRE + np.sqrt(RADIUS**2 - (y - CENTRE) ** 2)
    return arc + a * (END - arc), y


def _row(finding: Finding) -> tuple[str, ...]:
    millimetres = [f"{1e3 * value:.4f}" for value in (*finding.values, finding.limit, finding.reference)]
    off = finding.limit / finding.reference - 1
    return (
        finding.case.name,
        "u_" + "xy"[finding.component],
        *millimetres[:-2],
        f"{finding.order:.2f}",
        *millimetres[-2:],
        f"{off:+.3%}",
    )


def _failures(finding: Finding) -> Iterator[str]:
    what = f"{finding.case.name}, u_{'xy'[finding.component]}"
    if not abs(finding.limit / finding.reference - 1) <= LIMIT:
        yield f"{what}: extrapolated to {1e3 * finding.limit:.5g} mm, reference {1e3 * finding.reference:.5g} mm"
    if not abs(finding.order - ORDER) <= ORDER_LIMIT:
        yield f"{what}: order {finding.order:.2f}"
