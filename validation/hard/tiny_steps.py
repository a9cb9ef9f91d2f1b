"""Equilibria by an independent solve: scikit-fem's assembly, or the system's own where it has a volume term, in many tiny steps."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import splu

from skfem_stvk import StVK, System
from skfem_stvk.reference import ReferenceStVK, isotropic_tensor

from ..elements.families import of_scikit_fem
from ..statics.with_scikit_fem import I3, internal_force, stress_and_moduli
from ..statics.with_scikit_fem import tangent as tangent_form
from .case import Array, Body, made
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
def followed(make: Callable[[], Body], volume: bool, steps: int, degree: int = 1) -> Array:
    """(ndofs,) displacements at t = 1 on the path from rest, in steps of at most 1/steps; all elements stay right side out.

    Elements are of this `degree`; quadratic ones in a plane are assembled by the system itself.

    Raises
    ------
    NoPathError
        where the path ends.
    """
    body = made(make, degree)
    system = body.system(volume)
    by_itself = volume or body.law is not StVK or (degree == 2 and body.mesh.d < 3)
    force, tangent = _by_itself(system) if by_itself else by_scikit_fem(body)
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


def by_scikit_fem(body: Body) -> tuple[Force, Tangent]:
    """Internal force and tangent stiffness of a body by scikit-fem's assembly of its elements."""
    if body.mesh.element.degree == 2:
        return _quadratic_by_scikit_fem(body)
    tensor = isotropic_tensor(body.young, body.poisson, body.mesh.k, condensed=False)
    reference = ReferenceStVK(body.mesh.p, body.mesh.t, tensor)
    return reference.internal_force, reference.tangent


def _quadratic_by_scikit_fem(body: Body) -> tuple[Force, Tangent]:
    basis, E, nu = of_scikit_fem(body.mesh, 2), np.reshape(body.young, (-1, 1)), body.poisson
    lame = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))

    def state(u: Array) -> tuple[Array, Array]:
        return stress_and_moduli(basis.interpolate(u).grad + I3, *lame)

    return lambda u: internal_force.assemble(basis, P=state(u)[0]), lambda u: tangent_form.assemble(basis, A=state(u)[1])
