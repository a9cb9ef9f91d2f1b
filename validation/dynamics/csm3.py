"""Elastic flag of Turek and Hron (2006) in motion, CSM3: gravity acts suddenly on the flag of CSM1 at rest, without damping.

The reference is FeatFlow's benchmark page: mean and amplitude of the extremes in the last period before 10 s, and its frequency.
Higher modes change one period relative to the next by about 1 %, so means over all periods are compared.
"""

from __future__ import annotations

from time import perf_counter
from typing import NamedTuple

import numpy as np

from skfem_stvk import Gravity, StVK, System
from skfem_stvk.solvers.dynamics import EnergyMomentum, Integrator, simulate

from ..statics.meshes import Array, strip
from ..statics.orders import extrapolated
from ..statics.turek_hron import CENTRE, DENSITY, END, GRAVITY, POISSON, flag
from ..study import Study
from .oscillation import Oscillation

YOUNG = 1.4e6
#: Mean and amplitude [m], and frequency [Hz] of the components of A's displacement.
REFERENCE = (Oscillation(-14.305e-3, 14.305e-3, 1.0995), Oscillation(-63.607e-3, 65.160e-3, 1.0995))
LIMIT, QUICK_LIMIT = 0.015, 0.05
MESHES, UNTIL, STEP = ((70, 4), (140, 8), (280, 16)), 6.0, 0.01
QUICK_MESHES, QUICK_UNTIL, QUICK_STEP = MESHES[:2], 2.2, 0.02
RTOL = 1e-8


class Motion(NamedTuple):
    """Displacements (n, 2) of A [m] at times (n,) [s], and wall time of the run [s]."""

    t: Array
    a: Array
    seconds: float

    def oscillations(self) -> list[Oscillation]:
        """Return the oscillations of both components, averaged over all periods."""
        return [Oscillation.averaged(self.t, component) for component in self.a.T]


def motion(nx: int, ny: int, integrator: Integrator, until: float, rise: float = 0.0) -> Motion:
    """Return the motion of the flag's end A. Gravity acts at once, or grows smoothly over a time `rise` [s]."""
    mesh = strip(nx, ny, flag)
    gravity = Gravity(lambda t: (0.0, -GRAVITY * np.sin(np.pi / 2 * min(t / rise, 1.0)) ** 2) if rise else (0.0, -GRAVITY))
    terms: list[StVK | Gravity] = [StVK(young=YOUNG, poisson=POISSON, density=DENSITY), gravity]
    system = System(mesh, terms, fixed=[(np.arange(ny + 1), "xy")])
    a = int(np.argmin(np.hypot(mesh.p[0] - END, mesh.p[1] - CENTRE)))
    begin = perf_counter()
    ledger = simulate(system, integrator, until=until, probes={"A": [a]}, quiet=True).ledger
    seconds = perf_counter() - begin
    return Motion(ledger["time"].copy(), np.stack([ledger["A x"], ledger["A y"]], axis=1), seconds)


def csm3(quick: bool = False) -> Study:
    """Compare Turek and Hron's CSM3 with the reference: mean, amplitude and frequency on successively finer meshes."""
    meshes, until, dt, most = (QUICK_MESHES, QUICK_UNTIL, QUICK_STEP, QUICK_LIMIT) if quick else (MESHES, UNTIL, STEP, LIMIT)
    motions = [motion(nx, ny, EnergyMomentum(dt=dt, rtol=RTOL), until) for nx, ny in meshes]
    found = np.array([one.oscillations() for one in motions])  # (meshes, components, 3)
    rows, failures = [], []
    for i, component in enumerate("xy"):
        for j, what in enumerate(Oscillation._fields):
            values, exact = found[:, i, j], REFERENCE[i][j]
            limit, scale = extrapolated(values), 1.0 if what == "frequency" else 1e3
            numbers = (*values, limit, exact)
            rows.append((f"u_{component}", what, *(f"{scale * number:.4f}" for number in numbers), f"{limit / exact - 1:+.2%}"))
            if not abs(limit / exact - 1) <= most:
                failures.append(f"u_{component}, {what}: extrapolated to {scale * limit:.5g}, reference {scale * exact:.5g}")
    return Study(
        "Turek-Hron CSM3",
        f"extrapolated within {most:.1%} of the reference",
        ("of A", "in mm and Hz", *(f"{nx}x{ny}x2" for nx, ny in meshes), "extrapolated", "reference", "off"),
        tuple(rows),
        tuple(failures),
        (
            f"energy-momentum, dt = {dt:g} s, means over the whole periods of {until:g} s; wall time "
            f"{', '.join(f'{m.seconds:.1f} s' for m in motions)}",
        ),
    )
