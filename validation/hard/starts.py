"""Bad initial states: random positions, a flattened body, and inverted elements."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from skfem_stvk import ElementMesh, Traction, VolumePenalty

from . import meshes, truths
from .case import Array, Body, Case

YOUNG, POISSON = 1e5, 0.3
LENGTH = 2.0


def starts() -> list[Case]:
    return [
        _case("start from random positions", random_positions),
        _case("start from a flattened body", _flattened),
        _case("start with elements inside out", some_inside_out),
    ]


def _case(name: str, u0: truths.Start) -> Case:
    """Return a case that the default may refuse, and that it must solve with the volume term."""
    plain = replace(truths.tiny_steps(bent, 20), refused=True, says=("u0|VolumePenalty",))
    return Case(name, partial(_from, u0), 4, plain, truths.tiny_steps(bent, 20, volume=True))


def bent() -> Body:
    """Return a short cantilever bent by a traction."""
    load = Traction(lambda x: x[0] == LENGTH, (0, 0, -3e3))
    removes_inversions = VolumePenalty(kind="compression")
    return Body(meshes.bar(LENGTH, 3), YOUNG, POISSON, (load,), {lambda x: x[0] == 0: "xyz"}, penalty=removes_inversions)


def _from(u0: truths.Start) -> Body:
    body = bent()
    return replace(body, u0=u0(body.mesh))


def random_positions(mesh: ElementMesh) -> Array:
    """Return displacements to random positions of all vertices in the body's bounding box."""
    low, high = mesh.p.min(axis=1), mesh.p.max(axis=1)
    return (np.random.default_rng(5).uniform(low, high, (mesh.nv, 3)) - mesh.p.T).ravel()


def _flattened(mesh: ElementMesh) -> Array:
    """Return displacements of all vertices to z = 0."""
    return (mesh.p * [[0], [0], [-1]]).ravel("F")


def some_inside_out(mesh: ElementMesh) -> Array:
    """Return displacements of every fifth inner vertex by an element size or more."""
    low, high = mesh.p.min(axis=1, keepdims=True), mesh.p.max(axis=1, keepdims=True)
    inner = np.flatnonzero(((mesh.p > low) & (mesh.p < high)).all(axis=0))[::5]
    u = np.zeros((mesh.nv, 3))
    u[inner] = np.random.default_rng(6).choice([-0.6, 0.6], (len(inner), 3))
    return u.ravel()
