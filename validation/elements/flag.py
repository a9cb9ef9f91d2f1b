"""Turek and Hron's flag with quadratic triangles, with a curved clamp and curved edges: CSM1 and CSM2."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from skfem_stvk import ElementMesh, Gravity, StVK, System, solve_static
from skfem_stvk.arguments import Array

from ..statics.meshes import strip
from ..statics.turek_hron import CASES, CENTRE, DENSITY, END, GRAVITY, POISSON, flag
from ..study import Study
from .families import numbers_of

MESHES = ((35, 2), (70, 4), (140, 8), (280, 16))
#: Largest relative error of a displacement by mesh.
LIMITS = {(70, 4): 3e-3, (140, 8): 8e-4}


def flag_of_quadratic_triangles(quick: bool = False) -> Study:
    """Compare Turek and Hron's CSM1 and CSM2 with quadratic triangles with the reference."""
    return _at_rest(MESHES[:3] if quick else MESHES)


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
