"""Newton's method as in textbooks: full steps in equal load steps. The residual is the only check."""

from __future__ import annotations

import warnings
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import MatrixRankWarning, spsolve

from skfem_stvk import StateError, System
from skfem_stvk.arguments import Array
from skfem_stvk.edges import ALL, TENSILE

RTOL, MOST, SHORTEST = 1e-8, 60, 1 / 1024


class Outcome(NamedTuple):
    """Last displacements, whether the full load converged, load steps and iterations, and the reason of a failure."""

    u: NDArray[np.float64]
    converged: bool
    steps: int
    iterations: int
    message: str


def solve(system: System, steps: int, u0: Array | None, clamped: bool) -> Outcome:
    """Find the equilibrium at t = 1 with full steps of the exact tangent.

    If `clamped`, halve steps until the potential decreases.
    """
    u = np.zeros(system.ndofs) if u0 is None else u0.copy()
    held, iterations = system.supports.held, 0
    free = np.setdiff1d(np.arange(system.ndofs), held)
    for step in range(1, steps + 1):
        t = step / steps
        u[held] = system.supports.values(t)
        for _ in range(MOST):
            try:
                residual, load = system.residual(u, t), system.external_force(u, t)
                if np.linalg.norm(residual[free]) <= RTOL * (np.linalg.norm(residual[held]) + np.linalg.norm(load)):
                    break
                v = _direction(system, u, t, free, residual, clamped)
                u, iterations = u + (_shortened(system, u, v, t) if clamped else 1.0) * v, iterations + 1
            except StateError:
                return Outcome(u, False, step - 1, iterations, f"at t = {t:.3g} displacements are not finite")
        else:
            return Outcome(u, False, step - 1, iterations, f"at t = {t:.3g} no convergence in {MOST} iterations")
    return Outcome(u, True, steps, iterations, "the residual converged")


def _direction(system: System, u: Array, t: float, free: NDArray[np.int64], residual: Array, clamped: bool) -> Array:
    v = np.zeros(system.ndofs)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MatrixRankWarning)
        v[free] = spsolve(system.jacobian(u, t, kept=TENSILE if clamped else ALL)[free][:, free].tocsc(), -residual[free])
    return v


def _shortened(system: System, u: Array, v: Array, t: float) -> float:
    s, before = 1.0, system.potential(u, t)
    while s > SHORTEST and not system.potential(u + s * v, t) < before:
        s /= 2
    return s
