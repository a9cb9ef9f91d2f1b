"""Protocols of terms: specifications that bind to a body, and the required and optional methods of bound terms."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import Any, ClassVar, NamedTuple, Protocol, TypeGuard, runtime_checkable

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..arguments import Array, own
from ..edges.materials import Hypothesis
from ..edges.pairs import BoundTerm, NodeBlocks
from ..mesh import ElementMesh
from .body import Body
from .loads.load import Time, check_constants


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


class BoundLoad(Protocol):
    """Load on a body at displacements `u` (nv, d) and load factor or time `t`. If it is not `dead` it is a `FollowerLoad`."""

    @property
    def has_potential(self) -> bool:
        """Whether its force is minus the gradient of a potential; otherwise its stiffness is not symmetric."""

    @property
    def dead(self) -> bool:
        """Whether its force does not depend on the displacements: its potential is linear in `u`, and it has no stiffness."""

    @property
    def steady(self) -> bool:
        """Whether the load is constant in time, that is, not a function."""

    def potential(self, u: Array, t: Time) -> float:
        """Return the potential [J] of the load at `u` (nv, d); the force is `-d potential/du`."""

    def add_force(self, u: Array, t: Time, out: Array) -> None:
        """Add the external force [N] to `out` (nv, d)."""


@runtime_checkable
class FollowerLoad(Protocol):
    """Load with a stiffness: blocks of the pairs of vertices that it couples, and of single vertices.

    Attributes
    ----------
    symmetric
        Whether its stiffness is symmetric; if not, the load supplies `K_ba` of its pairs as well.
    balanced
        Whether the rows of its stiffness sum to zero; if not, the load supplies those of its `nodes` (m,).
    """

    symmetric: bool
    balanced: bool

    @property
    def nodes_paired(self) -> NDArray[np.int32]:
        """Pairs of vertices `a < b` (2, n) that the load couples, each once; none if it couples each vertex at most with itself."""

    def add_blocks(self, u: Array, t: Time, blocks: NodeBlocks) -> None:
        """Add the blocks of `-d force/du` [N/m] at `u` (nv, d)."""


@runtime_checkable
class HasMemory(Protocol):
    """Term that reports the size of its arrays."""

    def memory(self) -> dict[str, int]:
        """Return the bytes of its arrays, by part."""


@runtime_checkable
class HasRoundOff(Protocol):
    """Term with a closer estimate of its force's rounding error than its blocks provide."""

    def add_round_off(self, u: Array, out: Array) -> None:
        """Add the absolute values of the force's summands [N] to `out` (nv, d): times eps, its rounding error."""


@runtime_checkable
class Quartic(Protocol):
    """Term with an energy that is exactly a quartic along any line."""

    def along(self, u: Array, v: Array) -> NDArray[np.float64]:
        """Return the coefficients (5,) of the energy along `u + s v`: `c0 + c1 s + c2 s^2 + c3 s^3 + c4 s^4` [J]."""


@runtime_checkable
class HasStrainProducts(Protocol):
    """Term with an energy `1/2 sum y^2` over strains `y` that are quadratic in displacements. The part of the energy that is
    quadratic in displacements is excepted, since K at rest determines it.
    """

    def strain_products(self, fields: Array, most: int) -> Iterator[Array]:
        """Yield rows (m, n (n + 1)/2) `y = sum over a <= b of y_ab x_a x_b` for displacements `sum_a x_a fields_a`, `x_0 = 1`.

        `fields` is (nv, d, n - 1); the pair (a, b) is in column `b (b + 1)/2 + a`. About `most` rows are yielded at once, each time
        in the same array.
        """


@runtime_checkable
class HasMeanForce(Protocol):
    """Term with a force between two states; the work of this force is the difference of their energies."""

    def mean_force(self, u0: Array, u1: Array, weights: tuple[float, float], theta: float, force: Array) -> float:
        """Add the force [N] of weighted tensions at `u0` and `u1`, along the edges at `(1 - theta) u0 + theta u1`, to `force` (nv,
        d).

        For `theta = 1/2` and weights of sum 1, the work over `u1 - u0` is `W(u1) - W(u0) + (w1 - w0) R`. The method returns `R >=
        0` [J].
        """


@runtime_checkable
class HasDampingForce(Protocol):
    """Term that can resist the rate of its strain."""

    def damping_force(self, u: Array, v: Array, force: Array) -> float:
        """Add its Gauss-Newton tangent at `u` times velocities `v` to `force` (nv, d); return half the dissipated power [W]."""


@runtime_checkable
class Grounded(Protocol):
    """Term that ties a body to the ground, so that its force is external."""

    @property
    def grounded(self) -> NDArray[np.int64]:
        """Degrees of freedom that the term ties to the ground."""

    def energy_and_force(self, u: Array, force: Array | None = None) -> float:
        """Return the strain energy [J]; add the internal force [N], minus that of the ground on the body, to `force` (nv, d)."""


@runtime_checkable
class HasVolume(Protocol):
    """Term with elements that can invert; its specification has their `region`.

    If its forces are finite in inverted elements and push them back, `passes_inversion` is True. Motions may then pass through such
    states.
    """

    def volume_ratios(self, u: Array) -> NDArray[np.float64]:
        """Return the volume (n,) at `u` (nv, d) over that at rest of the region's elements, in their order."""

    def smallest_volume_ratio(self, u: Array) -> float:
        """Return the smallest entry of `volume_ratios(u)`."""

    def step_limit(self, u: Array, v: Array) -> float:
        """Return the smallest `s > 0` at which an element that is not inverted at `u` has no volume at `u + s v`, or infinity."""


@runtime_checkable
class HasStretch(Protocol):
    """Term with elements that soften under compression; its specification has their `region`."""

    def smallest_stretches(self, u: Array) -> NDArray[np.float64]:
        """Return the smallest principal stretch (n,) at `u` (nv, d) of the region's elements, in their order, within their own
        dimensions.
        """

    def smallest_stretch(self, u: Array) -> float:
        """Return the smallest entry of `smallest_stretches(u)`."""


@runtime_checkable
class CanRemove(Protocol):
    """Term whose elements can be removed. Loads need no such method: they are bound again, to the remaining body."""

    def without(self, removed: NDArray[np.bool_]) -> Any:
        """Return the term without the `removed` elements (n,), in the order of its region; of the mesh, if it has no region.

        This term is not changed. `removed` includes all removed elements, also those of earlier calls. The new term couples the
        same pairs of nodes, with blocks of zeros. If it has the attribute `nodes_joined` (2, m), this lists the pairs that it still
        joins. The new term has the history of this one.
        """


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
