"""Blocks that hit the ground, and blocks that are crushed."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from skfem_stvk import Gravity

from .. import meshes
from ..case import Array, Body, made
from ..truths import Make
from . import endings
from .scene import Scene

YOUNG, POISSON, DENSITY = 1e5, 0.3, 1e3
UNTIL, TINY = 0.5, 500
#: Initial downward speed of every other vertex of the shaken block [m/s], duration [s] and number of steps.
SHAKEN, SHAKEN_UNTIL, SHAKEN_STEPS = 6.0, 0.4, 80
#: Methods for this block without the volume term. With it, the motion depends on rounding, so there is no reference.
WITHOUT_VOLUME = ("plain eq. 9", "forward Euler", "forward Euler, dt=None", "eq. 9", "backward Euler", "energy-momentum")
#: Time after which the plate is back in its first position [s].
CRUSHED = 0.4


def impacts() -> list[Scene]:
    return [
        _scene("drop a block from 0.2 m", partial(_dropped, 2.0), 60, 0.16),
        replace(_scene("drop a block of quadratic elements from 0.1 m", partial(_dropped, 1.4, 2), 160, degree=2), quick=False),
        replace(_scene("drop a block from 1 m", partial(_dropped, 4.43), 120, 0.06), quick=False),
        _scene("crush a block by 25 % and back in 0.4 s", partial(_crushed, 0.25), 60),
        _scene("crush a block by 60 % and back in 0.4 s", partial(_crushed, 0.6), 120, 0.13),
        _shake(),
    ]


def _shake() -> Scene:
    never = endings.none(0.06)
    return Scene(
        "shake every other vertex of a block",
        _shaken,
        SHAKEN_STEPS,
        truth=never,
        with_volume=never,
        until=SHAKEN_UNTIL,
        quick=False,
        methods=WITHOUT_VOLUME,
    )


def _scene(name: str, make: Make, steps: int, inverted: float | None = None, *, degree: int = 1) -> Scene:
    """Return a scene. `inverted`: time at which elements invert without a volume term; None if they do not."""
    truth = endings.tiny_steps(make, UNTIL, TINY, False, degree) if inverted is None else endings.none(inverted, degree)
    with_volume = endings.tiny_steps(make, UNTIL, TINY, True, degree)
    return Scene(name, partial(made, make, degree), steps, truth=truth, with_volume=with_volume, until=UNTIL)


def _dropped(speed: float, n: int = 4) -> Body:
    """Return a cube at its impact on the ground with this speed [m/s]; its foot is fixed."""
    mesh = meshes.bar(1.0, n)
    v0 = np.where(mesh.p[2] > 0, -speed, 0.0)[:, None] * [0.0, 0.0, 1.0]
    weight = Gravity(g=(0, 0, -9.81))
    return Body(mesh, YOUNG, POISSON, (weight,), {lambda x: x[2] == 0: "xyz"}, density=DENSITY, v0=v0.ravel())


def _shaken() -> Body:
    """Return a cube on the ground; every other vertex has a downward initial velocity."""
    mesh = meshes.bar(1.0, 4)
    v0 = np.where(np.arange(mesh.nv) % 2 == 0, -SHAKEN, 0.0) * (mesh.p[2] > 0)
    weight = Gravity(g=(0, 0, -9.81))
    return Body(
        mesh, YOUNG, POISSON, (weight,), {lambda x: x[2] == 0: "xyz"}, density=DENSITY, v0=np.outer(v0, [0, 0, 1.0]).ravel()
    )


def _crushed(by: float) -> Body:
    """Return a cube between two plates. The upper plate moves down by this fraction of the height and back."""
    plate = {"x": 0.0, "y": 0.0, "z": partial(_down, by)}
    mesh = meshes.bar(1.0, 4)
    return Body(mesh, YOUNG, POISSON, fixed={lambda x: x[2] == 0: "xyz"}, prescribed={lambda x: x[2] == 1: plate}, density=DENSITY)


def _down(by: float, x: Array, t: float) -> Array:
    return np.full(x.shape[1], -by * np.sin(np.pi * np.clip(t / CRUSHED, 0, 1)) ** 2)
