"""Protocols of terms: specifications that bind to a body, and the required and optional methods of bound terms."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar, NamedTuple, Protocol, TypeGuard, runtime_checkable

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..arguments import Array, own
from ..edges.bound_term import BoundTerm
from ..edges.materials import Hypothesis
from ..mesh import ElementMesh
from .body import Body
from .bound_load import BoundLoad
from .loads.load import check_constants


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
