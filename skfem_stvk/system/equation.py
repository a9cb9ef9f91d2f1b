"""Common part of the equations of a body: linear solves and checks for inverted elements."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..linear import Factors, Solution
from ..mesh.displacements import by_vertex
from ..terms.loads.load import Time
from .coordinates import Coordinates, DenseTangent
from .free_tangent import FreeTangent
from .system import System

NO_ELEMENTS: NDArray[np.int64] = np.empty(0, dtype=np.int64)


class Equation:
    """Equation over the free entries of the states of a body.

    The body provides energies, forces and inverted elements for its states. The tangent over its free entries provides the factors.
    `watch` measures the time of each part of the work.

    Attributes
    ----------
    system
        The body with all its displacements.
    states, space
        Spaces of the states and of the unknowns.
    has_barrier
        Whether surfaces of the body repel each other at a distance.
    no_step_limit
        Whether steps are taken without a limit by the inversion of elements.
    ignores_inversion
        Whether checks for inverted elements are skipped.
    """

    #: Largest relative tolerance of linear solves.
    largest_rtol = float("inf")

    def __init__(
        self, body: System | Coordinates, tangent: FreeTangent | DenseTangent, watch: Callable[[str], AbstractContextManager[Any]]
    ) -> None:
        self.body, self.tangent, self._watch = body, tangent, watch
        self.system = body.system if isinstance(body, Coordinates) else body
        self.states, self.space = body.space, tangent.space
        self.has_barrier = any(contact.is_barrier for contact in self.system.contacts)
        self.ignores_inversion = body.constant_tangent  # a linear body has only one solution
        self.no_step_limit = self.ignores_inversion or isinstance(body, Coordinates)  # a reduced body checks elements at its states

    @property
    def iterative(self) -> bool:
        return self.tangent.solver.iterative

    def solve(self, factors: Factors, b: Array, rtol: float) -> Solution:
        """Solve `K x = b` to the tolerance `rtol`, or to `largest_rtol` if that is smaller."""
        with self._watch("solve"):
            return factors.solve(b, min(rtol, self.largest_rtol))

    def negative_pivots(self) -> int | None:
        with self._watch("factor"):
            return None if self.tangent.exact is None else self.tangent.exact.negative_pivots

    def force_of(self, w: Array) -> Array:
        """Return the force (n,) on the unknowns [N] due to a change `w` of the constrained entries, with the last tangent."""
        with self._watch("assemble"):
            return self.tangent.force_of(w)

    def step_limit(self, u: Array, v: Array) -> float:
        if self.no_step_limit:
            return float("inf")
        with self._watch("assemble"):
            return self.system.step_limit(self._body_state(u), v)

    def contact_limit(self, u: Array, v: Array, t: Time) -> tuple[float, str]:
        if not self.system.contacts:
            return float("inf"), ""
        with self._watch("assemble"):
            x, y = (by_vertex(self.system.mesh, w) for w in (self._body_state(u), v))
            return min((term.contact_limit(x, y), term.name) for term in self.system.contacts_at(t))

    def way_is_free(self, u: Array, found: Array, t: Time) -> bool:
        """Return as in `Problem`; states with inverted elements must pass through zero volume."""
        if self.contact_limit(u, found - u, t)[0] <= 1:
            return False
        return self.step_limit(u, found - u) > 1 or len(self.inside_out(u)) > 0

    def inside_out(self, u: Array) -> NDArray[np.int64]:
        if self.ignores_inversion:
            return NO_ELEMENTS
        with self._watch("assemble"):
            return self.body.inside_out(self._body_state(u))

    def _body_state(self, u: Array) -> Array:
        """Return the state of the body for an unknown state `u` of the equation."""
        return u
