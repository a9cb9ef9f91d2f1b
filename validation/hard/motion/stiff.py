"""Steps of 1/30 s for any stiffness: 1e9 Pa in 1e2 Pa, and a block that is thrown."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from scipy.integrate import solve_ivp

from skfem_stvk import ElementMesh, System

from .. import meshes
from ..case import Array, Body, made
from . import endings
from .scene import Scene
from .verlet import masses

STIFF, SOFT, FOAM = 1e9, 1e2, 40.0
#: Stiffness that tiny steps can still resolve, and large enough relative to the soft part for the core to be nearly rigid [Pa].
RIGID = 1e5
#: Angular velocity of the thrown block [1/s], mostly about its axis of intermediate inertia.
SPIN = np.array([0.3, 6.0, 0.3])
THROWN = 2.0


def stiff() -> list[Scene]:
    return [_kick(), _flip()]


def _kick() -> Scene:
    followed = (endings.tiny_steps(partial(_between, RIGID), 1.0, 1000, volume) for volume in (False, True))
    truth, with_volume = (replace(ending, source=f"{ending.source}, the core of 1e5 Pa") for ending in followed)
    name = "kick a core of 1e9 Pa between ends of 1e2 Pa, in steps of 1/30 s"
    return Scene(name, partial(_between, STIFF), 30, truth=truth, with_volume=with_volume, until=1.0)


def _between(stiff: float) -> Body:
    """Return a bar with clamped ends, soft but for its middle third, which starts with a translation and a spin."""
    mesh = meshes.bar(3.0, 2)
    young = np.where(np.abs(mesh.p[0, mesh.t].mean(axis=0) - 1.5) < 0.5, stiff, SOFT)
    x = mesh.p.T - [1.5, 0.5, 0.5]
    spin = np.cross([0.0, 1.0, 0.0], x)
    v0 = np.where(np.abs(x[:, :1]) < 0.51, spin + np.array([0.0, 0.0, 1.0]), 0.0)
    ends = {lambda x: (x[0] == 0) | (x[0] == 3): "xyz"}
    return Body(mesh, young, 0.3, fixed=ends, density=FOAM, v0=v0.ravel())


def _flip() -> Scene:
    truth = endings.state("a rigid body's, Euler's equations", _spun, _rotated, free=True)
    name = "throw a block of 1e9 Pa that flips, in steps of 1/30 s"
    return Scene(name, _spun, 60, truth=truth, with_volume=truth, until=THROWN)


def _spun() -> Body:
    """Return a block with three different moments of inertia, with its centre of mass at the origin."""
    mesh = meshes.box([np.linspace(-0.5, 0.5, 5), np.linspace(-0.25, 0.25, 3), np.linspace(-0.1, 0.1, 2)])
    mass = masses(Body(mesh, STIFF, 0.3, density=1e3))[::3]
    centred = ElementMesh(mesh.p - (mesh.p @ mass / mass.sum())[:, None], mesh.t)
    return Body(centred, STIFF, 0.3, density=1e3, v0=np.cross(SPIN, centred.p.T).ravel())


def _rotated(system: System) -> Array:
    """Return the final displacements (ndofs,) by `R' = R [w]x`, `I w = R' L`, with the constant angular momentum `L`.

    The lumped masses of quadratic elements have a slightly different centre. The initial spin is about the centre of the linear
    elements, so the quadratic body also translates.
    """
    body = made(_spun, system.mesh.element.degree)
    mass = masses(body)[::3]
    centre = body.mesh.p @ mass / mass.sum()
    X = body.mesh.p.T - centre
    inertia = np.einsum("v,vii->", mass, X[:, :, None] * X[:, None]) * np.eye(3) - np.einsum("v,vi,vj->ij", mass, X, X)
    L = inertia @ SPIN

    def rate(t: float, R: Array) -> Array:
        w = np.linalg.solve(inertia, R.reshape(3, 3).T @ L)
        return np.asarray(np.cross(R.reshape(3, 3), w)).ravel()

    R = solve_ivp(rate, (0, THROWN), np.eye(3).ravel(), method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1].reshape(3, 3)
    return (X @ R.T - X + THROWN * np.cross(SPIN, centre)).ravel()
