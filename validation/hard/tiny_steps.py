"""Equilibria by an independent solve: scikit-fem's assembly, or the system's own where it has a volume term, in many tiny steps."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import splu

from skfem_stvk import System
from skfem_stvk.reference import ReferenceStVK, isotropic_tensor

from .case import Array, Body
from .judge import volume_ratios

#: The last step of Newton's method, which converges quadratically, is no larger than this part of the displacements.
LAST = 1e-8
MOST, SMALLEST = 12, 1 / 64
#: Internal force [N] and tangent stiffness [N/m] at displacements.
Force = Callable[[Array], Any]
Tangent = Callable[[Array], csr_matrix]


class NoPathError(RuntimeError):
    """The path of tiny steps ended before the full load."""


@lru_cache(maxsize=64)
def followed(make: Callable[[], Body], volume: bool, steps: int) -> Array:
    """(ndofs,) displacements at t = 1 on the path from rest, in steps of at most 1/steps; all elements stay right side out.

    Raises
    ------
    NoPathError
        where the path ends.
    """
    body = make()
    system = body.system(volume)
    force, tangent = _by_itself(system) if volume else _by_scikit_fem(body)
    held, u, t, size = system.supports.held, np.zeros(system.ndofs), 0.0, 1 / steps
    free = np.setdiff1d(np.arange(system.ndofs), held)
    while t < 1:
        size = min(size, 1 - t) if 1 - t > 1e-12 else 1 - t
        goal = 1.0 if t + size > 1 - 1e-12 else t + size
        found = _step(system, force, tangent, free, held, u, goal)
        if found is None:
            size /= 2
            if size < SMALLEST / steps:
                raise NoPathError(f"The path in tiny steps ends at t = {t:.4g}.")
            continue
        u, t, size = found, goal, min(2 * size, 1 / steps)
    return u


def _step(
    system: System,
    force: Force,
    tangent: Tangent,
    free: NDArray[np.int64],
    held: NDArray[np.int64],
    u: Array,
    t: float,
) -> Array | None:
    """Newton's method with full steps, the first of which carries the prescribed displacements into the body."""
    du = np.zeros_like(u)
    du[held] = system.supports.values(t) - u[held]
    for _ in range(MOST):
        K = tangent(u)[free].tocsc()
        residual = (force(u) - system.external_force(u, t))[free] + K[:, held] @ du[held]
        du[free] = splu(K[:, free]).solve(-residual)
        u, size, du = u + du, np.abs(du).max(), np.zeros_like(u)
        if not volume_ratios(system, u).min() > 0:
            return None
        if size <= LAST * np.abs(u).max():
            return u
    return None


def _by_itself(system: System) -> tuple[Force, Tangent]:
    return system.internal_force, system.tangent


def _by_scikit_fem(body: Body) -> tuple[Force, Tangent]:
    tensor = isotropic_tensor(body.young, body.poisson, body.mesh.k, condensed=False)
    reference = ReferenceStVK(body.mesh.p, body.mesh.t, tensor)
    return reference.internal_force, reference.tangent
