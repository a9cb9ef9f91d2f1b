"""Right outcomes: a closed form, an independent solve, or no state."""

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

#: Limit of states found by tiny steps. Both sides converge to a relative residual of 1e-8 or better.
LIMIT = 1e-6
#: Parts of the default's message if the branch without inversion ends: the event, the elements, and the remedy.
ENDS = ("invert|gives way", r"element[s]? \(?\d", "VolumePenalty")


def none(why: str, *says: str) -> Truth:
    """Return the outcome that there is no stable state without inverted elements."""
    return Truth(f"none: {why}", None, says=says)


def any_stable(*says: str) -> Truth:
    """Return the outcome of a body with several right states.

    Any stable state without inverted elements is right. A refusal that `says` why is also right.
    """
    return Truth("its own K: any stable state, none inverted", lambda system, u: 0.0, refused=bool(says), says=says)


def state(source: str, expected: Callable[[System], Array], limit: float = LIMIT, says: tuple[str, ...] = ()) -> Truth:
    """Return the outcome with displacements (ndofs,) from the function `expected`."""

    def error(system: System, u: Array) -> float:
        right = expected(system)
        return float(np.abs(u - right).max() / np.abs(right).max())

    return Truth(source, error, limit, says)


def homogeneous(F: Array, source: str, limit: float = LIMIT) -> Truth:
    """Return the outcome with the uniform deformation gradient `F` and a fixed origin."""
    return state(source, lambda system: ((F - np.eye(len(F))) @ system.mesh.p).ravel("F"), limit)


def tiny_steps(make: Make, steps: int, volume: bool = False, limit: float = LIMIT, says: tuple[str, ...] = ()) -> Truth:
    """Return the outcome of tiny steps of full Newton from rest, by scikit-fem's assembly if there is no volume term."""
    source = f"{steps} steps of Newton" + (", own assembly" if volume else ", scikit-fem")
    return state(source, lambda system: followed(make, volume, steps, system.mesh.element.degree), limit, says)


def tiny_steps_of_invertible(make: Make, steps: int, limit: float = LIMIT) -> Truth:
    """Return the outcome of tiny steps of full Newton from rest for `InvertibleStVK`, by its own assembly."""
    of_invertible = partial(invertible, make)
    return state(
        f"{steps} steps of Newton, own assembly",
        lambda system: followed(of_invertible, False, steps, system.mesh.element.degree),
        limit,
    )
