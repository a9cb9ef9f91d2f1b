"""Bodies that are released: stretched, flattened, under their weight; and a whip."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from skfem_stvk import ElementMesh, Gravity

from .. import meshes
from ..case import Array, Body, made
from ..truths import Make
from . import endings
from .scene import Scene

YOUNG, POISSON, DENSITY = 1e5, 0.3, 1e3
#: Young's modulus of the whip [Pa], amplitude of the handle's rotation [rad], and its duration [s].
LASH, ANGLE, STROKE = 1e7, 1.0, 0.25


def released() -> list[Scene]:
    coarse = partial(_let_go, 3.0, 2, (1.3, 0.9, 0.9))
    stretched, flat = partial(_let_go, 3.0, 3, (1.3, 0.9, 0.9)), partial(_let_go, 1.0, 4, (1.2, 1.2, 0.6))
    return [
        _scene("stretch a bar by 30 % and let go", stretched, 0.5, 60, 500, 0.29),
        replace(
            _scene("stretch a bar of quadratic elements by 30 % and let go", coarse, 0.5, 60, 500, 0.24, degree=2), quick=False
        ),
        replace(_scene("press a block flat by 40 % and let go", flat, 0.5, 120, 1000, 0.21), quick=False),
        _scene("let a bar swing, in steps of 1/30 s", _swinging, 1.0, 30, 500),
        _scene("crack a whip", _whip, 0.3, 72, 3000),
    ]


def _scene(name: str, make: Make, until: float, steps: int, tiny: int, inverted: float | None = None, *, degree: int = 1) -> Scene:
    """Return a scene. `inverted`: time at which elements invert without a volume term; None if they do not."""
    truth = endings.tiny_steps(make, until, tiny, False, degree) if inverted is None else endings.none(inverted, degree)
    with_volume = endings.tiny_steps(make, until, tiny, True, degree)
    return Scene(name, partial(made, make, degree), steps, truth=truth, with_volume=with_volume, until=until)


def _let_go(length: float, n: int, stretches: tuple[float, float, float]) -> Body:
    """Return a free bar that starts from rest, stretched along the axes."""
    mesh = meshes.bar(length, n)
    u0 = (np.diag(stretches) - np.eye(3)) @ mesh.p
    return Body(mesh, YOUNG, POISSON, u0=u0.ravel("F"), density=DENSITY)


def _swinging() -> Body:
    """Return a soft cantilever on which its weight acts suddenly."""
    weight = Gravity(g=(0, 0, -9.81))
    return Body(meshes.bar(3.0, 3), 1e6, POISSON, (weight,), {lambda x: x[0] == 0: "xyz"}, density=DENSITY)


def _whip() -> Body:
    """Return a bar that tapers from 8 cm to 2 cm over 1 m. Its handle rotates about a transverse axis."""
    across = np.linspace(-0.5, 0.5, 2)
    straight = meshes.box([np.linspace(0, 1, 21), across, across])
    p = straight.p.copy()
    p[1:] *= 0.08 * (1 - 0.75 * p[0])
    return Body(ElementMesh(p, straight.t), LASH, POISSON, prescribed={lambda x: x[0] < 0.051: _swung}, density=DENSITY)


def _swung(x: Array, t: float) -> Array:
    angle = ANGLE * np.sin(np.pi * np.clip(t / STROKE, 0, 1)) ** 2
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([(c - 1) * x[0] - s * x[2], 0 * x[1], s * x[0] + (c - 1) * x[2]])
