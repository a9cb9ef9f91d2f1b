"""Cantilever as a competent user of scikit-fem writes it: forms with precomputed constants, `condense` and `solve`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import skfem

from .cantilever import LENGTH, POISSON, RTOL, TENTHS, TRACTION, YOUNG, Array, Run, timed

LinearSolver = Callable[[Any, Array], Array]

LAM, MU = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON)), YOUNG / (2 * (1 + POISSON))
I3 = np.eye(3)[:, :, None, None]
ELEMENTS = {"P1": skfem.ElementTetP1, "P2": skfem.ElementTetP2}


@skfem.LinearForm
def internal_force(v: Any, w: Any) -> Array:
    return np.einsum("iJ...,iJ...->...", w.P, v.grad)


@skfem.BilinearForm(nthreads=2)
def tangent(u: Any, v: Any, w: Any) -> Array:
    return np.einsum("iJ...,iJ...->...", np.einsum("iJkL...,kL...->iJ...", w.A, u.grad), v.grad)


@skfem.LinearForm
def traction(v: Any, _: Any) -> Array:
    return np.einsum("i,i...->...", TRACTION, v)


def stress_and_moduli(F: Array, lam: float | Array = LAM, mu: float | Array = MU) -> tuple[Array, Array]:
    """Return the first Piola-Kirchhoff stress `P = F S` (3, 3, nt, nq) and `A = dP/dF` (3, 3, 3, 3, nt, nq).

    `lam` and `mu` may have the shape (nt, 1).
    """
    E = 0.5 * (np.einsum("kI...,kJ...->IJ...", F, F) - I3)
    S = lam * np.einsum("ii...->...", E) * I3 + 2 * mu * E
    A = np.einsum("iJ...,kL...->iJkL...", lam * F, F) + np.einsum("iL...,kJ...->iJkL...", mu * F, F)
    b = mu * np.einsum("iM...,kM...->ik...", F, F)
    for i in range(3):
        A[:, i, :, i] += b
        A[i, :, i] += S
    return np.einsum("iM...,MJ...->iJ...", F, S), A


def solve(mesh: skfem.MeshTet, element: str, linear: LinearSolver, factors: Array = TENTHS, most: int = 1000) -> Run:
    """Solve by Newton's method in load steps with elements "P1" or "P2".

    `most` limits the iterations of runs that are only timed.
    """
    seconds: dict[str, float] = {}
    with timed(seconds, "other"):
        elements = skfem.ElementVector(ELEMENTS[element]())
        basis = skfem.Basis(mesh, elements, intorder={"P1": 1, "P2": 2}[element])
        load = traction.assemble(skfem.FacetBasis(mesh, elements, facets="tip"))
        clamped = basis.get_dofs("wall").all()
        u, iterations = basis.zeros(), 0
    for t in factors:
        while iterations < most:
            with timed(seconds, "assemble"):
                P, A = stress_and_moduli(basis.interpolate(u).grad + I3)
                residual = internal_force.assemble(basis, P=P) - t * load
            if in_equilibrium(residual, clamped, t * load):
                break
            with timed(seconds, "assemble"):
                K = tangent.assemble(basis, A=A)
            with timed(seconds, "other"):
                system = skfem.condense(K, -residual, D=clamped)
            with timed(seconds, "solve"):
                u = u + skfem.solve(*system, solver=linear)
            iterations += 1
    tip = basis.interpolator(u)(np.array([[LENGTH], [0.5], [0.5]])).ravel()
    return Run(f"scikit-fem {element}", len(u), tip, iterations, seconds)


def in_equilibrium(residual: Array, clamped: Array, load: Array) -> bool:
    """Return whether the residual at free degrees of freedom is small relative to loads and reactions."""
    free = residual.copy()
    free[clamped] = 0
    return bool(np.linalg.norm(free) <= RTOL * (np.linalg.norm(load) + np.linalg.norm(residual[clamped])))
