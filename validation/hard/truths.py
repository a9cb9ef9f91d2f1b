"""Right outcomes: a closed form, an independent solve, or that there is none."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from skfem_stvk import ElementMesh, System

from .case import Array, Body, Truth, invertible
from .tiny_steps import followed

Make = Callable[[], Body]
MakeMesh = Callable[[], ElementMesh]
Where = Callable[[Array], NDArray[np.bool_]]
Start = Callable[[ElementMesh], Array]

#: Of states that tiny steps lead to: both sides converge to 1e-8 or better in the residual, relative.
LIMIT = 1e-6
#: What the default says where the branch without inversion ends: what, in which elements, and what helps.
ENDS = ("inside out|gives way", r"element[s]? \(?\d", "VolumePenalty")


def none(why: str, *says: str) -> Truth:
    """There is no stable state with all elements right side out."""
    return Truth(f"none: {why}", None, says=says)


def any_stable(*says: str) -> Truth:
    """Return the truth of a body with several right states: a stable one, none inside out; or a refusal that `says` why."""
    return Truth("its own K: any stable state, none inside out", lambda system, u: 0.0, refused=bool(says), says=says)


def state(source: str, expected: Callable[[System], Array], limit: float = LIMIT, says: tuple[str, ...] = ()) -> Truth:
    """Displacements (ndofs,) that come from elsewhere."""

    def error(system: System, u: Array) -> float:
        right = expected(system)
        return float(np.abs(u - right).max() / np.abs(right).max())

    return Truth(source, error, limit, says)


def homogeneous(F: Array, source: str, limit: float = LIMIT) -> Truth:
    """The deformation gradient `F` everywhere, the origin where it was."""
    return state(source, lambda system: ((F - np.eye(len(F))) @ system.mesh.p).ravel("F"), limit)


def tiny_steps(make: Make, steps: int, volume: bool = False, limit: float = LIMIT, says: tuple[str, ...] = ()) -> Truth:
    """The path from rest in tiny steps of full Newton, by scikit-fem's assembly where there is no volume term."""
    source = f"{steps} steps of Newton" + (", own assembly" if volume else ", scikit-fem")
    return state(source, lambda system: followed(make, volume, steps, system.mesh.element.degree), limit, says)


def tiny_steps_of_invertible(make: Make, steps: int, limit: float = LIMIT) -> Truth:
    """Return the path of `InvertibleStVK` from rest in tiny steps of full Newton, by its own assembly."""
    of_invertible = partial(invertible, make)
    return state(
        f"{steps} steps of Newton, own assembly",
        lambda system: followed(of_invertible, False, steps, system.mesh.element.degree),
        limit,
    )
