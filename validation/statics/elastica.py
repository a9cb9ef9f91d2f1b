"""Slender cantilevers in large bending against the elastica: a dead load at the tip, and a uniform dead load.

With theta the angle of the beam's tangent, s the length along it from the clamp, L = EI = 1:

    theta'' = -P cos(theta)              tip load P L^2/EI
    theta'' = -q (1 - s) cos(theta)      uniform load q L^3/EI
    theta(0) = 0,  theta'(1) = 0;        w = integral of sin(theta), shortening 1 - integral of cos(theta)

A body of height h and nu = 0 differs from the elastica in two ways. Shear adds about 0.6 (h/L)^2 of the deflection. Bending changes
the stiffness of the material by about 0.3 (h kappa)^2 at the largest curvature. At L/h = 100 both are below 0.1 % in all cases.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_bvp

from skfem_stvk import BodyForce, StVK, System, Traction, solve_static

from ..study import Study
from .meshes import Array, strip
from .orders import extrapolated

LENGTH, HEIGHT, YOUNG = 1.0, 0.01, 1.2e7
STIFFNESS = YOUNG * HEIGHT**3 / 12  # EI [N m^2] per unit of depth
MESHES = ((300, 2), (600, 4), (1200, 8), (2400, 16))
LIMIT, ODE_LIMIT = 5e-3, 1e-5


class Case(NamedTuple):
    """Load in the beam's units, with the deflection w/L and the shortening u/L of the tip from the table in literature.md."""

    kind: str
    load: float
    table: tuple[float, float]


CASES = (
    Case("tip", 1.0, (0.30172, 0.05643)),
    Case("tip", 2.0, (0.49346, 0.16064)),
    Case("tip", 4.0, (0.66996, 0.32894)),
    Case("tip", 10.0, (0.81061, 0.55500)),
    Case("uniform", 1.0, (0.12347, 0.00875)),
    Case("uniform", 4.0, (0.42516, 0.10989)),
    Case("uniform", 10.0, (0.70020, 0.34365)),
)


def elastica(quick: bool = False) -> Study:
    """Compare slender cantilevers with the elastica; the extrapolated tips agree within 0.5 %."""
    cases, meshes = (CASES[5:6], MESHES[:3]) if quick else (CASES, MESHES)
    rows, failures = [], []
    for case in cases:
        exact = elastica_tip(case.kind, case.load)
        tips = np.array([tip(case, nx, ny) for nx, ny in meshes])
        for i, what in enumerate(("w/L", "u/L")):
            limit = extrapolated(tips[:, i])
            numbers = (*tips[:, i], limit, exact[i])
            rows.append(
                (case.kind, f"{case.load:g}", what, *(f"{number:.5f}" for number in numbers), f"{limit / exact[i] - 1:+.2%}")
            )
            if not abs(limit / exact[i] - 1) <= LIMIT:
                failures.append(f"{case.kind} load {case.load:g}, {what}: {limit:.5f}, elastica {exact[i]:.5f}")
            if not abs(exact[i] - case.table[i]) <= ODE_LIMIT:
                failures.append(
                    f"{case.kind} load {case.load:g}, {what}: the ODE gives {exact[i]:.6f}, the table {case.table[i]:.5f}"
                )
    return Study(
        "Elastica",
        f"extrapolated within {LIMIT:.1%} of the elastica, L/h = {LENGTH / HEIGHT:g}, nu = 0",
        ("load", "PL²/EI, qL³/EI", "of tip", *(f"{nx}x{ny}x2" for nx, ny in meshes), "extrapolated", "elastica", "off"),
        tuple(rows),
        tuple(failures),
        ("the differential equation of the elastica, integrated to 1e-10, agrees with the published five digits",),
    )


def elastica_tip(kind: str, load: float) -> Array:
    """Return `w/L` and `u/L` of the tip from the differential equation of the elastica."""

    def slope(s: Array, y: Array) -> Array:
        force = load * (1 - s) if kind == "uniform" else load
        return np.stack([y[1], -force * np.cos(y[0]), np.sin(y[0]), 1 - np.cos(y[0])])

    def ends(clamp: Array, tip: Array) -> Array:
        return np.array([clamp[0], tip[1], clamp[2], clamp[3]])

    s = np.linspace(0, 1, 101)
    solution = solve_bvp(slope, ends, s, np.stack([s * np.pi / 3, 1 - s, s**2 / 2, s**3 / 4]), tol=1e-10, max_nodes=100_000)
    if not solution.success:
        raise RuntimeError(f"load = {kind} {load:g}; the equation of the elastica was not solved: {solution.message}")
    tip: Array = solution.y[2:, -1]
    return tip


def tip(case: Case, nx: int, ny: int) -> Array:
    """Return `w/L` and `u/L` of the tip of a strip of triangles."""
    mesh = strip(nx, ny, lambda a, b: (LENGTH * a, HEIGHT * b))
    force = case.load * STIFFNESS / LENGTH ** (2 if case.kind == "tip" else 3)
    load = Traction(lambda x: x[0] == LENGTH, (0, -force / HEIGHT)) if case.kind == "tip" else BodyForce((0, -force / HEIGHT))
    result = solve_static(
        System(mesh, [StVK(young=YOUNG, poisson=0.0), load], fixed={lambda x: x[0] == 0: "xy"}), steps=5, quiet=True
    )
    end = np.argmin(np.hypot(mesh.p[0] - LENGTH, mesh.p[1] - HEIGHT / 2))
    return -result.u.reshape(-1, 2)[end, ::-1] / LENGTH
