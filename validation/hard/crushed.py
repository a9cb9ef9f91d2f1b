"""Clamped block under compression: by 20 %, and until the material loses stability."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from . import meshes, truths
from .case import Body, Case

YOUNG = 1e5


def crushed() -> list[Case]:
    return [
        _little("compress a held block by 20 % in one step", 1),
        replace(_little("compress a held block by 20 % in steps of 2 %", 10), quick=False),
        _far(0.3, "31.5 %"),
        replace(_far(0.45, "26.0 %"), quick=False, invertible=truths.any_stable("imperfection")),  # it buckles at 59.2 %
    ]


def _little(name: str, steps: int) -> Case:
    make = partial(block, 0.2, 0.3)
    return Case(name, make, steps, truths.tiny_steps(make, 20), truths.tiny_steps(make, 20, volume=True))


def _far(poisson: float, end: str) -> Case:
    make = partial(block, 0.6, poisson)
    ends = truths.none(f"in tiny steps, by scikit-fem, the branch ends at {end}", *truths.ENDS)
    carried = truths.tiny_steps(make, 40, volume=True)
    invertible = truths.tiny_steps_of_invertible(make, 40)
    return Case(f"compress a held block by 60 %, nu = {poisson}", make, 30, ends, carried, invertible=invertible)


def block(squeeze: float, poisson: float, n: int = 6) -> Body:
    """Return the unit cube of (n + 1)^3 nodes.

    Both ends are clamped, and one moves towards the other by `squeeze` of its length.
    """
    plate = {"x": 0.0, "y": 0.0, "z": -squeeze}
    return Body(
        meshes.cube(n),
        YOUNG,
        poisson,
        fixed={lambda x: x[2] == 0: "xyz"},
        prescribed={lambda x: x[2] == 1: plate},
    )
