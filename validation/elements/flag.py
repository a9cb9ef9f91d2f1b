"""Turek and Hron's flag with quadratic triangles, the clamp and all edges curved: CSM1 to CSM3."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from skfem_stvk import ElementMesh, Gravity, StVK, System, solve_static
from skfem_stvk.arguments import Array
from skfem_stvk.dynamics import EnergyMomentum, simulate

from ..dynamics.csm3 import REFERENCE, RTOL
from ..dynamics.csm3 import YOUNG as YOUNG_IN_MOTION
from ..dynamics.oscillation import Oscillation
from ..statics.meshes import strip
from ..statics.study import Study
from ..statics.turek_hron import CASES, CENTRE, DENSITY, END, GRAVITY, POISSON, flag
from .families import numbers_of

MESHES = ((35, 2), (70, 4), (140, 8), (280, 16))
#: By mesh, how far a displacement may be from the reference.
LIMITS = {(70, 4): 3e-3, (140, 8): 8e-4}
#: In motion: meshes, time and steps [s], and how far the oscillation on the finest mesh may be from the reference.
MOVED, UNTIL, STEP, MOTION_LIMIT = ((35, 2), (70, 4)), 6.0, 0.01, 0.015
QUICK_MOVED, QUICK_UNTIL, QUICK_STEP, QUICK_LIMIT = ((35, 2),), 2.2, 0.02, 0.05


def flag_of_quadratic_triangles(quick: bool = False) -> Sequence[Study]:
    """Turek and Hron's CSM1 to CSM3 with quadratic triangles"""
    return _at_rest(MESHES[:3] if quick else MESHES), _in_motion(quick)


def mesh_of_the_flag(nx: int, ny: int) -> ElementMesh:
    """`nx x ny` cells of two quadratic triangles; their nodes are mapped, so that edges are curved near the arc of the clamp."""
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
        ("the order is that of the differences of the three finest meshes, with which they are extrapolated",),
    )


def _system(young: float, nx: int, ny: int) -> System:
    material = StVK(young=young, poisson=POISSON, density=DENSITY)
    return System(mesh_of_the_flag(nx, ny), [material, Gravity((0, -GRAVITY))], fixed={"clamp": "xy"})


def _tip(young: float, nx: int, ny: int) -> Array:
    """Displacement (2,) of A [m]."""
    system = _system(young, nx, ny)
    result = solve_static(system, steps=4, quiet=True)
    a = int(np.argmin(np.hypot(system.mesh.p[0] - END, system.mesh.p[1] - CENTRE)))
    return result.u.reshape(-1, 2)[a]


def _in_motion(quick: bool) -> Study:
    meshes, until, dt, most = (QUICK_MOVED, QUICK_UNTIL, QUICK_STEP, QUICK_LIMIT) if quick else (MOVED, UNTIL, STEP, MOTION_LIMIT)
    found = np.array([_oscillations(*size, until, dt) for size in meshes])
    rows, failures = [], []
    for i, component in enumerate("xy"):
        for j, what in enumerate(Oscillation._fields):
            values, exact = found[:, i, j], REFERENCE[i][j]
            scale, off = 1.0 if what == "frequency" else 1e3, values[-1] / exact - 1
            rows.append((f"u_{component}", what, *(f"{scale * value:.4f}" for value in (*values, exact)), f"{off:+.2%}"))
            if not abs(off) <= most:
                failures.append(f"u_{component}, {what}: {scale * values[-1]:.5g}, reference {scale * exact:.5g}")
    return Study(
        "Turek-Hron CSM3, quadratic triangles",
        f"within {most:.1%} of the reference on {meshes[-1][0]} x {meshes[-1][1]} cells",
        ("of A", "in mm and Hz", *(f"{nx}x{ny}x2" for nx, ny in meshes), "reference", "off"),
        tuple(rows),
        tuple(failures),
        (f"energy-momentum, dt = {dt:g} s, means over the whole periods of {until:g} s",),
    )


def _oscillations(nx: int, ny: int, until: float, dt: float) -> list[Oscillation]:
    """Those of both components of A's displacement."""
    system = _system(YOUNG_IN_MOTION, nx, ny)
    a = int(np.argmin(np.hypot(system.mesh.p[0] - END, system.mesh.p[1] - CENTRE)))
    ledger = simulate(system, EnergyMomentum(dt=dt, rtol=RTOL), until=until, probes={"A": [a]}, quiet=True).ledger
    return [Oscillation.averaged(ledger["time"], ledger[f"A {component}"]) for component in "xy"]
