"""Linearised backward Euler as in the overview (eq. 9), without any checks."""

from __future__ import annotations

import warnings

import numpy as np
from scipy.sparse import diags
from scipy.sparse.linalg import MatrixRankWarning, spsolve

from skfem_stvk import StateError
from skfem_stvk.terms.loads.load import Moment

from ..case import Array
from .scene import Scene
from .verlet import masses


def simulated(scene: Scene) -> tuple[Array, Array, int]:
    """Return displacements and velocities (ndofs,) after all steps, and the number of steps with finite values.

    v <- 1/T (M/T^2 + D/T + K)^-1 (h - F(p) + M v/T)        p <- p + T v
    """
    body = scene.body()
    system, M, T = body.system(volume=False), masses(body), scene.dt
    alpha = scene.damping.alpha if scene.damping else 0.0
    u, v = (np.zeros(system.ndofs) if given is None else given.copy() for given in (body.u0, body.v0))
    held = system.supports.held
    free = np.setdiff1d(np.arange(system.ndofs), held)
    for step in range(1, scene.steps + 1):
        now = Moment(step * T, 1.0)
        try:
            K, force = system.tangent(u), system.external_force(u, now) - system.internal_force(u)
        except StateError:
            return u, v, step - 1
        v[held] = (system.supports.values(now) - u[held]) / T
        A = diags(M * (1 / T**2 + alpha / T)) + K
        right = (force + M * v / T)[free] - T * A[free][:, held] @ v[held]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", MatrixRankWarning)
            v[free] = spsolve(A.tocsc()[free][:, free], right) / T
        u = u + T * v
    return u, v, scene.steps
