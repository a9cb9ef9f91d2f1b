"""The part that the equations of a body have in common: linear solves, and elements that turn inside out."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..linear import Factors, Solution
from .coordinates import Coordinates, DenseTangent
from .free_tangent import FreeTangent
from .system import System

NO_ELEMENTS: NDArray[np.int64] = np.empty(0, dtype=np.int64)


class Equation:
    """An equation over the free entries of the states of a body.

    The body answers energies, forces and elements inside out in its states, the tangent over its free entries makes the factors.
    `watch` measures the time of each part of the work.

    Attributes
    ----------
    states, space : the spaces of states and of unknowns.
    unlimited : whether elements do not limit a step.
    blind : whether elements inside out are not looked for.
    """

    #: Linear solves are as precise as this at least.
    precise = float("inf")

    def __init__(
        self, body: System | Coordinates, tangent: FreeTangent | DenseTangent, watch: Callable[[str], AbstractContextManager[Any]]
    ) -> None:
        self.body, self.tangent, self._watch = body, tangent, watch
        self.states, self.space = body.space, tangent.space
        self.blind = body.constant_tangent  # the one state is what it is, and no other way leads there
        self.unlimited = self.blind or isinstance(body, Coordinates)  # elements of a body on a basis are looked at in its states

    @property
    def system(self) -> System:
        """The body with all its displacements."""
        return self.body.system if isinstance(self.body, Coordinates) else self.body

    @property
    def iterative(self) -> bool:
        return self.tangent.solver.iterative

    def solve(self, factors: Factors, b: Array, rtol: float) -> Solution:
        """The solution of `K x = b`, as precise as `precise` at least."""
        with self._watch("solve"):
            return factors.solve(b, min(rtol, self.precise))

    def negative_pivots(self) -> int | None:
        with self._watch("factor"):
            return None if self.tangent.exact is None else self.tangent.exact.negative_pivots

    def force_of(self, w: Array) -> Array:
        """(n,) force on the unknowns if the constrained entries change by `w` [N], by the tangent that was made last."""
        with self._watch("assemble"):
            return self.tangent.force_of(w)

    def step_limit(self, u: Array, v: Array) -> float:
        if self.unlimited:
            return float("inf")
        with self._watch("assemble"):
            return self.system.step_limit(self._reached(u), v)

    def on_this_side(self, u: Array, found: Array) -> bool:
        """As in `Problem`; always true of states with elements inside out, which have to turn."""
        return self.step_limit(u, found - u) > 1 or len(self.inside_out(u)) > 0

    def inside_out(self, u: Array) -> NDArray[np.int64]:
        if self.blind:
            return NO_ELEMENTS
        with self._watch("assemble"):
            return self.body.inside_out(self._reached(u))

    def _reached(self, u: Array) -> Array:
        """The state of the body for an unknown state `u` of the equation."""
        return u
