"""Protocols of terms: specifications that bind to a body, and the required and optional methods of bound terms."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from enum import Enum
from typing import Any, ClassVar, Protocol, TypeAlias, TypeGuard, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array, own
from .body import Body
from .bound_load import BoundLoad
from .loads.load import Time, check_constants
from .loads.rigid_shapes import RigidShape
from .term import TermOrLoad


class Load(TermOrLoad, ABC):
    """A load without a mesh, usable in many systems; as a dataclass it copies its arguments."""

    external: ClassVar[bool] = True
    #: Name of the attribute with its values, for loads that are checked before a mesh exists.
    given_by: ClassVar[str] = ""
    #: Whether it requires densities of the materials.
    needs_density: ClassVar[bool] = False
    #: Whether `where` selects elements if the mesh is a surface in space.
    on_elements: ClassVar[bool] = False

    def __post_init__(self) -> None:
        own(self)
        if self.given_by:
            check_constants(getattr(self, self.given_by), f"{type(self).__name__}: {self.given_by}")

    @abstractmethod
    def bind(self, body: Body) -> BoundLoad:
        """Return the load on this body; raise RegionError or LoadError if it does not apply there."""


def is_load(term: Any) -> TypeGuard[Load]:
    """Return whether a term is an external load: a `Load`, or an object with a true attribute `external`."""
    return bool(getattr(term, "external", False))


def set_time(terms: Iterable[Any], t: Time) -> None:
    """Set all terms that change with time to load factor or time `t`, before they are evaluated."""
    for term in terms:
        term.at(t)


class Assumed(Enum):
    """Assumption on which the stiffness of a contact is computed, in place of the state.

    APART       nothing touches: for K at rest
    TOUCHING    the whole surface touches: for stable steps, because a body may meet a shape before the next review of its step
    """

    APART = "apart"
    TOUCHING = "touching"


#: What the stiffness of a contact assumes: None for the state; with two states (nv, d), a contact adds twice the derivative of its
#: mean force between them by the second one.
Assumption: TypeAlias = Assumed | tuple[Array, Array] | None


@runtime_checkable
class HasContact(Protocol):
    """Term with forces where the surface of the body touches something. It joins no nodes, and its force has a discrete gradient.

    Attributes
    ----------
    name
        Name in results and messages.
    nodes
        Nodes (m,) on which its resultant acts.
    is_barrier
        Whether its energy is infinite where surfaces meet, so that steps need Newton's method with a line search.
    assumed
        What `add_blocks` assumes; `System.assuming` sets it.
    """

    name: str
    nodes: NDArray[np.int32]
    is_barrier: bool
    assumed: Assumption

    @property
    def shape(self) -> RigidShape | None:
        """Rigid shape, displaced as at present; None between bodies."""

    def energy_and_force(self, u: Array, force: Array | None = None) -> float:
        """Return the energy [J]; add the internal force [N], minus that on the body, to `force` (nv, d)."""

    def identity(self) -> list[float]:
        """Return numbers that differ from those of another contact, for checkpoints."""

    def evaluated(self, u: Array) -> tuple[Array, Array, float]:
        """Return pressure (nv,) [Pa] and smallest gap (nv,) [m] at nodes for `u` (nv, d), and the area [m^2] that touches."""

    def held_directions(self, u: Array) -> tuple[NDArray[np.int64], Array]:
        """Return nodes (m,) that touch at `u` (nv, d), and unit vectors (m, d) along which the contact holds them."""

    def contact_limit(self, u: Array, v: Array) -> float:
        """Return the largest `s` up to which nothing passes through anything on the way `u + s v`, or infinity."""

    def refuse_start(self, u: Array) -> None:
        """Raise ContactError if surfaces intersect at `u` (nv, d), lie inside each other or on the wrong side."""

    def passes(self, u0: Array, u1: Array) -> bool:
        """Return whether something passes through something on the way from `u0` to `u1` (nv, d) over the present step."""


@runtime_checkable
class CanPenetrate(Protocol):
    """Contact whose points go into a shape.

    Attributes
    ----------
    name
        Name in results and messages.
    edge, shortest_edge
        Mean length of the edges of its facets at rest, and that of its smallest facet [m].
    """

    name: str
    edge: float
    shortest_edge: float

    @property
    def shape(self) -> RigidShape:
        """Rigid shape, displaced as at present."""

    def smallest_gap(self, u: Array) -> float:
        """Return the smallest gap of all points at `u` (nv, d) [m], negative where one touches."""

    def depth_within(self, u: Array) -> float:
        """Return the largest depth [m] of nodes at `u` (nv, d), if a connected part of the body lies within the shape, otherwise 0.

        Such a part has no node outside the shape, and nodes deeper than half of its size.
        """

    def too_soft(self, impact: float) -> str:
        """Return a sentence if a body with `v sqrt(rho h) = impact` gets farther than halfway through the shape, else ""."""


@runtime_checkable
class DoesWork(Protocol):
    """Contact that does work on the body by its motion, or dissipates energy by friction.

    Attributes
    ----------
    has_friction
        Whether it dissipates energy by friction.
    friction_factor
        Factor of friction in `energy_and_force` and `add_blocks`; `System.assuming` sets it for the equation of a step.
    """

    has_friction: bool
    friction_factor: float

    def work(self, u0: Array, u1: Array) -> tuple[float, float]:
        """Return the work [J] on the body, and the dissipated energy, from the last accepted state `u0` (nv, d) to `u1`."""

    def missing_friction(self, u: Array) -> tuple[Array, float]:
        """Return the friction at `u` with the normal forces there, less that with those of the last state, and the largest [N]."""

    def drag(self, u: Array) -> Array:
        """Return the largest friction per speed (nv,) [N s/m] of each node in a step from `u` (nv, d), for explicit steps."""

    def predict(self, u: Array) -> None:
        """Make friction linear, with the force per slip at `u` (nv, d), until the next state is accepted: for linear steps."""
