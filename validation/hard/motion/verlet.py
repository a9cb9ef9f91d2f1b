"""Independent motions: velocity Verlet in tiny steps with scikit-fem's forces, or with the system's forces for a volume term."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from skfem_stvk import System
from skfem_stvk.referee.reference import ReferenceStVK, isotropic_tensor
from skfem_stvk.terms.loads.load import Moment

from ..case import Array, Body, made
from ..judge import volume_ratios

#: Volumes and energies are checked after this number of steps.
EVERY = 10
#: Time step for the finite difference of prescribed displacements that gives the initial velocities [s].
BRIEF = 1e-6


class Motion(NamedTuple):
    """Result of a motion.

    Attributes
    ----------
    u, v
        (ndofs,) displacements [m] and velocities [m/s] at the end.
    size
        Largest root mean square of the displacements [m].
    energy, most
        Kinetic, strain and potential energy at the end, and the largest sum of kinetic and strain energy [J].
    inverted
        Time at which an inverted element was first found [s]; infinity for never.
    """

    u: Array
    v: Array
    size: float
    energy: float
    most: float
    inverted: float


class Elasticity(NamedTuple):
    """Strain energy [J] and internal force [N] at displacements (ndofs,)."""

    energy: Callable[[Array], float]
    force: Callable[[Array], Any]


def elasticity(body: Body, volume: bool) -> Elasticity:
    """Return scikit-fem's elasticity, or the system's own for a volume term or quadratic elements."""
    if volume or body.mesh.element.degree == 2:
        system = body.system(volume)
        return Elasticity(system.energy, system.internal_force)
    tensor = isotropic_tensor(body.young, body.poisson, body.mesh.k, condensed=False)
    reference = ReferenceStVK(body.mesh.p, body.mesh.t, tensor)
    return Elasticity(reference.energy, reference.internal_force)


def masses(body: Body) -> Array:
    """Return the lumped masses [kg], (ndofs,): a quarter of each tetrahedron for each of its vertices.

    For quadratic elements, the masses are the system's own.
    """
    if body.mesh.element.degree == 2:
        system = body.system(volume=False)
        return system.mass().multiply(np.ones(system.ndofs))
    x = body.mesh.p.T[body.mesh.t.T]
    volumes = np.abs(np.linalg.det(x[:, 1:] - x[:, :1])) / 6
    quarters = np.broadcast_to(body.density * volumes / 4, body.mesh.t.shape)
    return np.repeat(np.bincount(body.mesh.t.ravel(), quarters.ravel(), body.mesh.nv), 3)


def total_energy(body: Body, volume: bool, u: Array, v: Array) -> float:
    """Return the sum of kinetic energy, strain energy and potential of constant loads [J]."""
    loads = body.system(volume).external_force(np.zeros_like(u), Moment(0.0, 1.0))
    return float(v @ (masses(body) * v) / 2 + elasticity(body, volume).energy(u) - loads @ u)


@lru_cache(maxsize=32)
def followed(make: Callable[[], Body], volume: bool, until: float, steps: int, degree: int = 1) -> Motion:
    """Return the motion from the body's `u0` and `v0` until a time [s] in `steps` steps, with elements of this `degree`."""
    body = made(make, degree)
    system, M, h = body.system(volume), masses(body), until / steps
    elastic, held = elasticity(body, volume), system.supports.held
    u, v = (np.zeros(system.ndofs) if given is None else given.copy() for given in (body.u0, body.v0))
    v[held] = (_prescribed(system, BRIEF) - _prescribed(system, 0.0)) / BRIEF
    a = (system.external_force(u, Moment(0.0, 1.0)) - elastic.force(u)) / M
    size, most, inverted = 0.0, 0.0, np.inf
    for step in range(1, steps + 1):
        t, before = step * h, u[held]
        v += h / 2 * a
        u += h * v
        u[held] = _prescribed(system, t)
        a = (system.external_force(u, Moment(t, 1.0)) - elastic.force(u)) / M
        v += h / 2 * a
        v[held] = (u[held] - before) / h
        size = max(size, float(np.sqrt((u**2).mean())))
        if step % EVERY == 0:
            most = max(most, float(v @ (M * v) / 2 + elastic.energy(u)))
            inverted = t if inverted == np.inf and volume_ratios(system, u).min() <= 0 else inverted
    return Motion(u, v, size, total_energy(body, volume, u, v), most, inverted)


def _prescribed(system: System, t: float) -> Array:
    return np.asarray(system.supports.values(Moment(t, 1.0)))
