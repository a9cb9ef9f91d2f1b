"""F and K of St. Venant-Kirchhoff solids as a competent user of scikit-fem writes them: forms with precomputed constants."""

from __future__ import annotations

from typing import Any

import numpy as np
import skfem

from skfem_stvk.arguments import Array

from .cantilever import POISSON, RTOL, YOUNG

LAM, MU = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON)), YOUNG / (2 * (1 + POISSON))
I3 = np.eye(3)[:, :, None, None]
ELEMENTS = {"P1": skfem.ElementTetP1, "P2": skfem.ElementTetP2}


@skfem.LinearForm
def internal_force(v: Any, w: Any) -> Array:
    return np.einsum("iJ...,iJ...->...", w.P, v.grad)


@skfem.BilinearForm(nthreads=2)
def tangent(u: Any, v: Any, w: Any) -> Array:
    return np.einsum("iJ...,iJ...->...", np.einsum("iJkL...,kL...->iJ...", w.A, u.grad), v.grad)


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


def in_equilibrium(residual: Array, clamped: Array, load: Array) -> bool:
    """Return whether the residual at free degrees of freedom is small relative to loads and reactions."""
    free = residual.copy()
    free[clamped] = 0
    return bool(np.linalg.norm(free) <= RTOL * (np.linalg.norm(load) + np.linalg.norm(residual[clamped])))
