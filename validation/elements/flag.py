"""Turek and Hron's flag with quadratic triangles, with a curved clamp and curved edges: CSM1 to CSM3."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from skfem_stvk import ElementMesh, Gravity, StVK, System, solve_static
from skfem_stvk.arguments import Array
from skfem_stvk.solvers.dynamics import EnergyMomentum, simulate

from ..dynamics.csm3 import RTOL
from ..dynamics.csm3 import YOUNG as YOUNG_IN_MOTION
from ..dynamics.oscillation import Oscillation
from ..statics.meshes import strip
from ..statics.turek_hron import CASES, CENTRE, DENSITY, END, GRAVITY, POISSON, flag
from ..study import Study
from .families import numbers_of

MESHES = ((35, 2), (70, 4), (140, 8), (280, 16))
#: Largest relative error of a displacement by mesh.
LIMITS = {(70, 4): 3e-3, (140, 8): 8e-4}
#: Motion until 10 s. References by time step [s]: mean and amplitude of u_x and of u_y in the last period [m], on the finest mesh
#: of FeatFlow's benchmark page, level 4+0 with 98 820 unknowns.
UNTIL, QUICK_UNTIL = 10.0, 2.2
REFERENCES = {
    0.02: ((-14.404e-3, 14.408e-3), (-64.371e-3, 64.695e-3)),
    0.01: ((-14.645e-3, 14.650e-3), (-64.766e-3, 64.948e-3)),
    0.005: ((-14.305e-3, 14.305e-3), (-63.607e-3, 65.160e-3)),
}
#: Meshes and time steps, and the largest relative error of a displacement by mesh.
MOVED = ((70, 4, 0.02), (70, 4, 0.01), (70, 4, 0.005), (140, 8, 0.01))
QUICK_MOVED = ((35, 2, 0.02),)
MOTION_LIMITS = {(35, 2): 5e-2, **LIMITS}
#: Bracket of the swing's frequency [Hz], and number of fitted harmonics.
BETWEEN, HARMONICS = (1.05, 1.15), 3


def flag_of_quadratic_triangles(quick: bool = False) -> Sequence[Study]:
    """Compare Turek and Hron's CSM1 to CSM3 with quadratic triangles with the reference."""
    return _at_rest(MESHES[:3] if quick else MESHES), _in_motion(quick)


def mesh_of_the_flag(nx: int, ny: int) -> ElementMesh:
    """Return `nx x ny` cells of two quadratic triangles.

    All nodes are mapped, so that edges are curved near the arc of the clamp.
    """
    square = strip(nx, ny, lambda a, b: (a, b)).with_degree(2)
    sets = {"clamp": numbers_of(square.p[0] == 0)}
    return replace(square, p=np.stack(flag(*square.p)), node_sets=sets)


def _at_rest(meshes: Sequence[tuple[int, int]]) -> Study:
    rows, failures = [], []
    for case in CASES:
        tips = np.array([_tip(case.young, *size) for size in meshes])
        for i, exact in enumerate(case.reference):
            values = tips[:, i]
            order = np.log2((values[-2] - values[-3]) / (values[-1] - values[-2]))
            limit = values[-1] + (values[-1] - values[-2]) / (2**order - 1)
            numbers = [f"{1e3 * value:.5f}" for value in (*values, limit, exact)]
            rows.append((case.name, "u_" + "xy"[i], *numbers[:-2], f"{order:.2f}", *numbers[-2:], f"{limit / exact - 1:+.4%}"))
            for size, most in LIMITS.items():
                off = values[meshes.index(size)] / exact - 1
                if not abs(off) <= most:
                    failures.append(f"{case.name}, u_{'xy'[i]}, {size[0]} x {size[1]}: off by {off:+.3%}")
    return Study(
        "Turek-Hron CSM1 and CSM2, quadratic triangles",
        "within " + ", ".join(f"{most:.2%} on {nx} x {ny}" for (nx, ny), most in LIMITS.items()) + " cells",
        ("case", "of A [mm]", *(f"{nx}x{ny}x2" for nx, ny in meshes), "order", "extrapolated", "reference", "off"),
        tuple(rows),
        tuple(failures),
        ("the order and the extrapolation are from the differences of the three finest meshes",),
    )


def _system(young: float, nx: int, ny: int) -> System:
    material = StVK(young=young, poisson=POISSON, density=DENSITY)
    return System(mesh_of_the_flag(nx, ny), [material, Gravity((0, -GRAVITY))], fixed={"clamp": "xy"})


def _tip(young: float, nx: int, ny: int) -> Array:
    """Return the displacement (2,) of A [m]."""
    system = _system(young, nx, ny)
    result = solve_static(system, steps=4, quiet=True)
    a = int(np.argmin(np.hypot(system.mesh.p[0] - END, system.mesh.p[1] - CENTRE)))
    return result.u.reshape(-1, 2)[a]


def _in_motion(quick: bool) -> Study:
    rows, failures, frequencies = [], [], []
    chosen, until = (QUICK_MOVED, QUICK_UNTIL) if quick else (MOVED, UNTIL)
    for nx, ny, dt in chosen:
        t, moved = _motion(nx, ny, dt, until)
        frequency = frequency_of(t, moved[1])
        frequencies.append(f"{nx}x{ny}x2, {1e3 * dt:g} ms: {frequency:.4f}")
        for component, x, exact in zip("xy", moved, REFERENCES[dt], strict=True):
            last, periods = Oscillation.last(t, x), Oscillation.by_period(t, x)
            for what, reference in zip(("mean", "amplitude"), exact, strict=True):
                value, of_periods = getattr(last, what), 1e3 * np.array([getattr(one, what) for one in periods])
                off, numbers = value / reference - 1, (1e3 * value, 1e3 * reference)
                spread = f"{of_periods.min():.3f} ... {of_periods.max():.3f}"
                row = f"{nx}x{ny}x2", f"{1e3 * dt:g}", f"u_{component}", what, *(f"{number:.3f}" for number in numbers)
                rows.append((*row, f"{off:+.2%}", spread))
                if not abs(off) <= MOTION_LIMITS[nx, ny]:
                    failures.append(f"{nx}x{ny}x2, dt = {dt:g} s, u_{component}, {what}: off by {off:+.2%}")
    return Study(
        "Turek-Hron CSM3, quadratic triangles",
        "within "
        + ", ".join(f"{MOTION_LIMITS[size]:.2%} on {size[0]} x {size[1]}" for size in {of[:2]: 0 for of in chosen})
        + " cells",
        ("mesh", "dt [ms]", "of A", "in mm", "last period", "reference", "off", "all periods "),
        tuple(rows),
        tuple(failures),
        (
            f"energy-momentum, extremes of the last whole period before {until:g} s, as in the reference with the same step",
            f"frequency of the swing in Hz, fitted to u_y with {HARMONICS} harmonics: {'; '.join(frequencies)}",
        ),
    )


def _motion(nx: int, ny: int, dt: float, until: float) -> tuple[Array, list[Array]]:
    """Return the times [s], and both components of A's displacement [m]."""
    system = _system(YOUNG_IN_MOTION, nx, ny)
    a = int(np.argmin(np.hypot(system.mesh.p[0] - END, system.mesh.p[1] - CENTRE)))
    ledger = simulate(system, EnergyMomentum(dt=dt, rtol=RTOL), until=until, probes={"A": [a]}, quiet=True).ledger
    return ledger["time"], [ledger[f"A {component}"] for component in "xy"]


def frequency_of(t: Array, x: Array) -> float:
    """Return the frequency [Hz] of the best fit by a constant and harmonics.

    Higher modes shift the extremes, but hardly change this frequency.
    """

    def left(frequency: float) -> float:
        phases = 2 * np.pi * frequency * t[:, None] * np.arange(1, HARMONICS + 1)
        waves = np.concatenate([np.ones((len(t), 1)), np.cos(phases), np.sin(phases)], axis=1)
        return float(((waves @ np.linalg.lstsq(waves, x)[0] - x) ** 2).sum())

    return float(minimize_scalar(left, bounds=BETWEEN, method="bounded", options={"xatol": 1e-7}).x)
