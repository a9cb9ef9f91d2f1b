"""Bad starts: random positions, a flattened body, elements inside out."""

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
    """The default may say that it does not get out; with the volume term it has to."""
    plain = replace(truths.tiny_steps(bent, 20), refused=True, says=("u0|VolumePenalty",))
    return Case(name, partial(_from, u0), 4, plain, truths.tiny_steps(bent, 20, volume=True))


def bent() -> Body:
    """A short cantilever that a traction bends."""
    load = Traction(lambda x: x[0] == LENGTH, (0, 0, -3e3))
    turns_back = VolumePenalty(kind="compression")
    return Body(meshes.bar(LENGTH, 3), YOUNG, POISSON, (load,), {lambda x: x[0] == 0: "xyz"}, penalty=turns_back)


def _from(u0: truths.Start) -> Body:
    body = bent()
    return replace(body, u0=u0(body.mesh))


def random_positions(mesh: ElementMesh) -> Array:
    """Every vertex anywhere in the body's box."""
    low, high = mesh.p.min(axis=1), mesh.p.max(axis=1)
    return (np.random.default_rng(5).uniform(low, high, (mesh.nv, 3)) - mesh.p.T).ravel()


def _flattened(mesh: ElementMesh) -> Array:
    """All vertices at z = 0."""
    return (mesh.p * [[0], [0], [-1]]).ravel("F")


def some_inside_out(mesh: ElementMesh) -> Array:
    """Every fifth inner vertex moved by the size of an element or more."""
    low, high = mesh.p.min(axis=1, keepdims=True), mesh.p.max(axis=1, keepdims=True)
    inner = np.flatnonzero(((mesh.p > low) & (mesh.p < high)).all(axis=0))[::5]
    u = np.zeros((mesh.nv, 3))
    u[inner] = np.random.default_rng(6).choice([-0.6, 0.6], (len(inner), 3))
    return u.ravel()
