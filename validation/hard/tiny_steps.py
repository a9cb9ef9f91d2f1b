"""Independent equilibria in many tiny steps: by scikit-fem's assembly, or by the system's own if it has a volume term."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import splu

from skfem_stvk import StVK, System
from skfem_stvk.referee.reference import ReferenceStVK, isotropic_tensor

from ..elements.families import of_scikit_fem
from ..statics.scikit_fem_forms import I3, internal_force, stress_and_moduli
from ..statics.scikit_fem_forms import tangent as tangent_form
from .case import Array, Body, made
from .judge import volume_ratios

#: Limit of the last step of Newton's method relative to the displacements; the method converges quadratically.
LAST = 1e-8
MOST, SMALLEST = 12, 1 / 64
#: Functions that return internal force [N] and tangent stiffness [N/m] at displacements.
Force = Callable[[Array], Any]
Tangent = Callable[[Array], csr_matrix]


class NoPathError(RuntimeError):
    """End of the path of tiny steps before the full load."""


@lru_cache(maxsize=64)
def followed(make: Callable[[], Body], volume: bool, steps: int, degree: int = 1) -> Array:
    """Return the displacements at t = 1 on the path from rest, (ndofs,), in steps of at most 1/steps, without inverted elements.

    Elements have this `degree`. Quadratic elements in a plane use the system's own assembly.

    Raises
    ------
    NoPathError
        if the path ends.
    """
    body = made(make, degree)
    system = body.system(volume)
    own_assembly = volume or body.law is not StVK or (degree == 2 and body.mesh.d < 3)
    force, tangent = _own_assembly(system) if own_assembly else by_scikit_fem(body)
    held, u, t, size = system.supports.held, np.zeros(system.ndofs), 0.0, 1 / steps
    free = np.setdiff1d(np.arange(system.ndofs), held)
    while t < 1:
        size = min(size, 1 - t) if 1 - t > 1e-12 else 1 - t
        target = 1.0 if t + size > 1 - 1e-12 else t + size
        found = _step(system, force, tangent, free, held, u, target)
        if found is None:
            size /= 2
            if size < SMALLEST / steps:
                raise NoPathError(f"The path in tiny steps ends at t = {t:.4g}.")
            continue
        u, t, size = found, target, min(2 * size, 1 / steps)
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
    """Make one load step by Newton's method with full steps. The first iteration applies the prescribed displacements."""
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


def _own_assembly(system: System) -> tuple[Force, Tangent]:
    return system.internal_force, system.tangent


def by_scikit_fem(body: Body) -> tuple[Force, Tangent]:
    """Return internal force and tangent stiffness of a body by scikit-fem's assembly of its elements."""
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
