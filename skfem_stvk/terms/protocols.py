"""Protocols of terms: specifications that bind to a body, and the required and optional methods of bound terms."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from enum import Enum
from typing import Any, ClassVar, NamedTuple, Protocol, TypeAlias, TypeGuard, runtime_checkable

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..arguments import Array, own
from ..edges.bound_term import BoundTerm
from ..edges.materials import Hypothesis
from ..mesh import ElementMesh
from .body import Body
from .bound_load import BoundLoad
from .loads.load import Time, check_constants
from .loads.rigid_shapes import RigidShape


class Term(Protocol):
    """A specification without a mesh."""

    def bind(self, body: Body, dtype: DTypeLike) -> BoundTerm:
        """Return the term on this body, with results of this type.

        An attribute `per_element` that is true says that the term is a sum over elements or facets. Then the forces of the parts of
        a divided body add up to those of the body.
        """


class Load(ABC):
    """A load without a mesh, usable in many systems; as a dataclass it copies its arguments."""

    external: ClassVar[bool] = True
    #: Name of the attribute with its values, for loads that are checked before a mesh exists.
    given_by: ClassVar[str] = ""
    #: Whether it requires densities of the materials.
    needs_density: ClassVar[bool] = False
    #: Whether `where` selects elements if the mesh is a surface in space.
    on_elements: ClassVar[bool] = False
    #: Whether the forces of the parts of a divided body add up to those of the body, as sums over elements, facets or own nodes do.
    per_element: ClassVar[bool] = False

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


@runtime_checkable
class HasStress(Protocol):
    """Specification of a material with stress on the elements of its `region`."""

    @property
    def region(self) -> Any:
        """Name of a subdomain, element ids, or None for all elements."""

    @property
    def material(self) -> Any:
        """The material, with `check` and its moduli."""

    def hypothesis(self, mesh: ElementMesh) -> Hypothesis:
        """Return the hypothesis: the components of strain or stress that vanish across the elements of this mesh."""

    def section(self, mesh: ElementMesh, n: int) -> NDArray[np.float64]:
        """Return the factor from the size of an element to its volume, a number or (n,)."""


def has_stress(term: HasStress) -> bool:
    """Return whether stress and energy density of a term are known. A law of forces on nodes has `has_stress = False`."""
    return bool(getattr(term, "has_stress", True))


@runtime_checkable
class HoldsShape(Protocol):
    """Specification without stress on elements that still resists all strain of some, such as springs along all their edges."""

    def elements_held_in_shape(self, mesh: ElementMesh) -> NDArray[np.int64]:
        """Return the ids (n,) of elements that are rigid as long as the term has no energy."""


class Deformation(NamedTuple):
    """Deformation of elements at a point of each.

    Attributes
    ----------
    elements
        (n,) ids of the elements, for messages.
    hypothesis
        Components of strain or stress that vanish across them.
    axes
        (n, d, k) an orthonormal basis of their own line or plane at rest, as columns.
    gradient
        (n, d, k) derivatives of the displacement along these axes.
    strain
        (n, k, k) Green-Lagrange strain within the elements, without cancellation.
    """

    elements: NDArray[Any]
    hypothesis: Hypothesis
    axes: Array
    gradient: Array
    strain: Array


class PointResponse(NamedTuple):
    """Response of a law at a point of each of n elements, in a frame of their axes followed by the normals.

    Attributes
    ----------
    strain
        (n, 3, 3) Green-Lagrange strain of the material, including the strain across; without folds if it wrinkles.
    stress
        (n, 3, 3) second Piola-Kirchhoff stress [Pa]; 0 where it is infinite.
    density
        (n,) strain energy per rest volume [J/m^3].
    infinite
        (n,) whether the stress is infinite, for example where elements have no volume left.
    """

    strain: Array
    stress: Array
    density: Array
    infinite: NDArray[np.bool_]


@runtime_checkable
class HasResponse(Protocol):
    """Specification that `HasStress` with its own law, other than St. Venant-Kirchhoff's `S = C : E`; `response` is None for that
    law.
    """

    def response(self, at: Deformation) -> PointResponse:
        """Return strain, stress and energy of all elements of its `region`, in their order."""


@runtime_checkable
class HasPressure(Protocol):
    """Specification of an energy of the volume ratio `J`, whose stress is a pressure, on the elements of its `region`."""

    kind: str

    @property
    def region(self) -> Any:
        """Name of a subdomain, element ids, or None for all elements."""

    def moduli(self, body: Body) -> Array:
        """Return the stiffness (n,) of the elements of the region [Pa]."""

    def density_and_slope(self, e: Array, elements: NDArray[Any]) -> tuple[Array, Array]:
        """Return `psi` and `psi'` (n,) for a stiffness of 1 at `e = J - 1` of these elements."""
