"""Contact on a body: what the package asks any contact, with the answers of one that neither moves nor rubs."""

from __future__ import annotations

from abc import ABC, abstractmethod
from copy import copy
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...arguments import Array
from ...edges import ALL, NodeBlocks, Tensions
from .load import Moment
from .rigid_shapes import RigidShape

Own = TypeVar("Own", bound="BoundContact")


class BoundContact(ABC):
    """Forces where the surface of a body touches something. They join no nodes, and have a discrete gradient.

    Attributes
    ----------
    name
        Name in results and messages.
    nodes
        Nodes (m,) on which its resultant acts.
    nodes_paired
        Pairs of nodes `a < b` (2, n) that it couples.
    is_barrier
        Whether its energy is infinite where surfaces meet, so that steps need Newton's method with a line search.
    does_work
        Whether it does work on the body by its motion, or dissipates energy by friction.
    has_friction
        Whether it dissipates energy by friction.
    """

    symmetric = has_energy = takes_time = True
    balanced = is_barrier = does_work = has_friction = has_history = False
    nodes_joined: ClassVar[NDArray[np.int32]] = np.empty((2, 0), dtype=np.int32)
    name: str
    nodes: NDArray[np.int32]
    nodes_paired: Any

    @property
    def shape(self) -> RigidShape | None:
        """Rigid shape into which points go, displaced as at its time; None without one."""
        return None

    @abstractmethod
    def at(self: Own, moment: Moment, history: Array | None) -> Own:
        """Return the contact at a moment, under its assumption, with its `history` at the beginning of the step.

        The result shares the arrays of this contact, which does not change.
        """

    def for_analysis(self: Own, in_time: bool) -> Own:
        """Return the contact for a motion `in_time` or along load factors; raise ContactError if it is not for this analysis."""
        return self

    def first_history(self) -> Array | None:
        """Return the history (n,) before the first step, of any n; None without one."""
        return None

    def advanced(self, history: Array, u: Array, moment: Moment) -> Array:
        """Return the history of a step that begins at displacements `u` (nv, d), after a step with this `history`."""
        return history

    def after_step(self, history: Array) -> Array:
        """Return the history after a step that began with it. Forces are still those of the equation of the step."""
        return history

    def return_to(self, history: Array) -> None:  # noqa: B027
        """Prepare for steps from a history; raise ValueError for the numbers of another contact."""

    @abstractmethod
    def energy_and_force(self, u: Array, force: Array | None = None) -> float:
        """Return the energy [J] at `u` (nv, d); add the internal force [N], minus that on the body, to `force` (nv, d)."""

    @abstractmethod
    def add_blocks(self, u: Array, blocks: NodeBlocks, kept: Tensions = ALL) -> None:
        """Add the blocks of K [N/m] at `u` (nv, d), or under the assumption of its moment."""

    @abstractmethod
    def mean_force(self, u0: Array, u1: Array, weights: tuple[float, float], theta: float, force: Array) -> float:
        """Add the sum of the `weights` times a force with the work `W(u1) - W(u0)` to `force` (nv, d); return 0."""

    @abstractmethod
    def identity(self) -> list[float]:
        """Return numbers that differ from those of another contact, for checkpoints."""

    @abstractmethod
    def evaluated(self, u: Array) -> tuple[Array, Array, float]:
        """Return pressure (nv,) [Pa] and smallest gap (nv,) [m] at nodes for `u` (nv, d), and the area [m^2] that touches."""

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
