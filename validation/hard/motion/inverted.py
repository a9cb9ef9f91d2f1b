"""Initial states with inverted elements: the damped body comes to rest in the static equilibrium."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from skfem_stvk.solvers.dynamics import Rayleigh

from .. import starts, truths
from ..case import Body, made
from ..tiny_steps import followed
from . import endings
from .scene import Ending, Scene

UNTIL, LIMIT = 4.0, 0.05
DAMPING = Rayleigh(alpha=5.0)


def inverted() -> list[Scene]:
    return [
        _scene("start from random positions, damped", starts.random_positions, "eq. 9 + volume"),
        _scene(
            "start with elements inside out, damped",
            starts.some_inside_out,
            "eq. 9 + volume",
            "backward Euler + volume",
        ),
        replace(
            _scene(
                "start with quadratic elements inside out, damped",
                starts.some_inside_out,
                "eq. 9 + volume",
                "backward Euler + volume",
                degree=2,
            ),
            quick=False,
        ),
    ]


def _scene(name: str, u0: truths.Start, *right: str, degree: int = 1) -> Scene:
    make = partial(_from, u0)
    truth, with_volume = (_at_rest(make, volume) for volume in (False, True))
    body = partial(made, make, degree)
    return Scene(name, body, 120, truth=truth, with_volume=with_volume, until=UNTIL, damping=DAMPING, right=right)


def _at_rest(make: truths.Make, volume: bool) -> Ending:
    source = "at rest: 20 steps of Newton" + (", own assembly" if volume else ", scikit-fem")
    return endings.state(source, make, lambda system: followed(starts.bent, volume, 20, system.mesh.element.degree), limit=LIMIT)


def _from(u0: truths.Start) -> Body:
    """Return the cantilever of the static cases; constrained vertices start at their prescribed positions."""
    body = starts.bent()
    u = u0(body.mesh)
    u.reshape(-1, 3)[body.mesh.p[0] == 0] = 0.0
    return replace(body, u0=u, density=1e3)
