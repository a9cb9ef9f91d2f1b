"""Protocols of terms: specifications that bind to a body, and the required and optional methods of bound terms."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from enum import Enum
from typing import Any, ClassVar, NamedTuple, Protocol, TypeAlias, TypeGuard, runtime_checkable

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..arguments import Array, own
from ..edges.materials import Hypothesis
from ..edges.pairs import BoundTerm, NodeBlocks
from ..mesh import ElementMesh
from .body import Body
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
class HasHistory(Protocol):
    """Term with history, such as friction. Each analysis has terms of its own, and calls `commit` for the state at the beginning of
    each step. After a step, the history is still that of its beginning, so that forces are those of the equation of the step.

    Attributes
    ----------
    history
        (n,) numbers from which the term continues, of any n. An analysis copies them, and sets them to go back; the term raises
        ValueError for numbers that are not its own.
    """

    history: Array

    def with_new_history(self, in_time: bool) -> Any:
        """Return the term for a new analysis, `in_time` or along load factors. Both have a history of their own."""

    def commit(self, u: Array, t: float) -> None:
        """Store in the history that a step begins at displacements `u` (nv, d), at the load factor or time `t`."""


@runtime_checkable
class TakesTime(Protocol):
    """Term that changes with time, or with the load factor."""

    def at(self, t: Time) -> None:
        """Set the term to its state at load factor or time `t`."""


def set_time(terms: Iterable[Any], t: Time) -> None:
    """Set all terms that change with time to load factor or time `t`, before they are evaluated."""
    for term in terms:
        if isinstance(term, TakesTime):
            term.at(t)


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
