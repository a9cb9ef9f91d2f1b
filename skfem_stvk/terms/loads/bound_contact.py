"""Contact on a body: what the package asks any contact, with the answers of one that neither moves nor rubs."""

from __future__ import annotations

from abc import abstractmethod
from copy import copy
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...arguments import Array
from ...edges.bound_term import BoundTerm
from .rigid_shapes import RigidShape

Own = TypeVar("Own", bound="BoundContact")


class BoundContact(BoundTerm):
    """Forces where the surface of a body touches something. They join no nodes, and have a discrete gradient.

    Attributes
    ----------
    name
        Name in results and messages.
    distance
        Distance below which surfaces repel each other [m]; infinite for contacts without a barrier.
    nodes
        Nodes (m,) on which its resultant acts.
    is_barrier
        Whether its energy is infinite where surfaces meet, so that steps need Newton's method with a line search.
    does_work
        Whether it does work on the body by its motion, or dissipates energy by friction.
    has_friction
        Whether it dissipates energy by friction.
    """

    takes_time = has_mean_force = True
    balanced = False
    is_barrier: bool = False
    distance: float = np.inf
    does_work: bool = False
    has_friction: bool = False
    nodes_joined = np.empty((2, 0), dtype=np.int32)
    name: str

    @property
    def shape(self) -> RigidShape | None:
        """Rigid shape into which points go, displaced as at its time; None without one."""
        return None

    @abstractmethod
    def identity(self) -> list[float]:
        """Return numbers that differ from those of another contact, for checkpoints."""

    @abstractmethod
    def evaluated(self, u: Array) -> tuple[Array, Array, float]:
        """Return pressure (nv,) [Pa] and smallest gap (nv,) [m] at nodes for `u` (nv, d), and the area [m^2] that touches."""

    def smallest_gap(self, u: Array) -> float:
        """Return the smallest gap [m] at `u` (nv, d), negative where a point is in a shape."""
        return float(self.evaluated(u)[1].min())

    @abstractmethod
    def held_directions(self, u: Array) -> tuple[NDArray[np.int64], Array]:
        """Return nodes (m,) that touch at `u` (nv, d), and unit vectors (m, d) along which the contact holds them."""

    @abstractmethod
    def contact_limit(self, u: Array, v: Array) -> float:
        """Return the largest `s` up to which nothing passes through anything on the way `u + s v`, or infinity."""

    @abstractmethod
    def passes(self, u0: Array, u1: Array) -> bool:
        """Return whether something passes through something on the way from `u0` to `u1` (nv, d) over the present step."""

    @abstractmethod
    def refuse_start(self, u: Array) -> None:
        """Raise ContactError if surfaces intersect at `u` (nv, d), lie inside each other or on the wrong side."""

    def work(self, u0: Array, u1: Array) -> tuple[float, float]:
        """Return the work [J] on the body, and the dissipated energy, over the step from `u0` (nv, d) to `u1`."""
        return 0.0, 0.0

    def missing_friction(self, u: Array) -> tuple[Array, float]:
        """Return the friction at `u` with the normal forces there, less that with those of the last state, and the largest [N]."""
        return np.zeros((0, u.shape[1])), 0.0

    def drag(self, u: Array) -> Array:
        """Return the largest friction per speed (nv,) [N s/m] of each node in a step from `u` (nv, d), for explicit steps."""
        return np.zeros(len(u))

    def _with(self: Own, **parts: Any) -> Own:
        """Return the contact with other values of these attributes; it shares the others."""
        other = copy(self)
        vars(other).update(parts)
        return other
