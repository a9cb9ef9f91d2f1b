"""Terms: specifications that bind to a body, and the methods that bound terms must and may have."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from typing import Any, ClassVar, NamedTuple, Protocol, TypeGuard, runtime_checkable

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..arguments import Array, own
from ..edges.pairs import BoundTerm, NodeBlocks
from ..materials import Hypothesis
from ..mesh import ElementMesh
from .body import Body
from .load import Time, check_given


class Term(Protocol):
    """A specification without a mesh."""

    def bind(self, body: Body, dtype: DTypeLike) -> BoundTerm:
        """The term on this body, with results of this type."""


class Load(ABC):
    """A load without a mesh, good for many systems; as a dataclass it keeps copies of what it is given."""

    external: ClassVar[bool] = True
    #: Name of the attribute that holds its values, for those that are checked before there is a mesh.
    given_by: ClassVar[str] = ""
    #: Whether it is of no use without densities of the materials.
    needs_density: ClassVar[bool] = False
    #: Whether `where` means elements on meshes whose elements are a surface in space.
    on_elements: ClassVar[bool] = False

    def __post_init__(self) -> None:
        own(self)
        if self.given_by:
            check_given(getattr(self, self.given_by), f"{type(self).__name__}: {self.given_by}")

    @abstractmethod
    def bind(self, body: Body) -> BoundLoad:
        """The load on this body; raises RegionError or LoadError where it has no meaning there."""


def is_load(term: Any) -> TypeGuard[Load]:
    """Whether a term acts from outside: a `Load`, or whatever else says so by `external`."""
    return bool(getattr(term, "external", False))


class BoundLoad(Protocol):
    """A load on a body at displacements `u` (nv, d) and load factor or moment `t`. If it is not `dead` it is a `TurningLoad`."""

    @property
    def has_potential(self) -> bool:
        """Whether its force is minus the gradient of a potential; otherwise its stiffness is not symmetric."""

    @property
    def dead(self) -> bool:
        """Whether its force is the same wherever the body goes: it has a potential, linear in `u`, and no stiffness."""

    @property
    def steady(self) -> bool:
        """Whether it is given by constants, not by a function of time."""

    def potential(self, u: Array, t: Time) -> float:
        """The potential [J] of the load at `u` (nv, d); the force is `-d potential/du`."""

    def add_force(self, u: Array, t: Time, out: Array) -> None:
        """Add the external force [N] to `out` (nv, d)."""


@runtime_checkable
class TurningLoad(Protocol):
    """A load with a stiffness: blocks of the pairs of vertices that it couples, and of vertices themselves.

    Attributes
    ----------
    symmetric : whether its stiffness is; if not, it gives `K_ba` of its pairs as well.
    balanced : whether the rows of its stiffness sum to zero; if not, it gives those of its `nodes` (m,).
    """

    symmetric: bool
    balanced: bool

    @property
    def nodes_paired(self) -> NDArray[np.int32]:
        """(2, n) pairs of vertices `a < b` that it couples, each once; none if it couples each vertex with itself at most."""

    def add_blocks(self, u: Array, t: Time, blocks: NodeBlocks) -> None:
        """Add the blocks of `-d force/du` [N/m] at `u` (nv, d)."""


@runtime_checkable
class HasMemory(Protocol):
    """A term that knows how large its arrays are."""

    def memory(self) -> dict[str, int]:
        """Bytes of its arrays, by part."""


@runtime_checkable
class HasRoundOff(Protocol):
    """A term that knows the rounding error of its force better than its blocks say it."""

    def add_round_off(self, u: Array, out: Array) -> None:
        """Add to `out` (nv, d) the absolute values of all that adds up to the force [N]: times eps, its rounding error."""


@runtime_checkable
class HasState(Protocol):
    """A term with a memory, such as friction that lags behind: an analysis tells it which states are accepted."""

    def commit(self, u: Array) -> None:
        """Keep what belongs to displacements `u` (nv, d), which an analysis has accepted."""

    def restore(self) -> None:
        """Go back to what was kept last, since later states were not accepted."""


@runtime_checkable
class TakesTime(Protocol):
    """A term that changes with time, or with the load factor."""

    def at(self, t: Time) -> None:
        """Be from now on what it is at load factor or moment `t`."""


def tell(terms: Iterable[Any], t: Time) -> None:
    """Tell those terms that change with it which load factor or moment it is, before they are asked."""
    for term in terms:
        if isinstance(term, TakesTime):
            term.at(t)


@runtime_checkable
class Quartic(Protocol):
    """A term whose energy along any line is exactly a quartic."""

    def along(self, u: Array, v: Array) -> NDArray[np.float64]:
        """(5,) coefficients of the energy along `u + s v`: `c0 + c1 s + c2 s^2 + c3 s^3 + c4 s^4` [J]."""


@runtime_checkable
class HasStrainProducts(Protocol):
    """A term with an energy `1/2 sum y^2` over strains `y` that are quadratic in displacements, but for what of it is quadratic in
    displacements alone, which K at rest says."""

    def strain_products(self, fields: Array, most: int) -> Iterator[Array]:
        """(m, n (n + 1)/2) rows `y = sum over a <= b of y_ab x_a x_b` for displacements `sum_a x_a fields_a`, `x_0 = 1`.

        `fields` (nv, d, n - 1); pairs stand at `b (b + 1)/2 + a`. About `most` rows at once, each time in the same array.
        """


@runtime_checkable
class HasMeanForce(Protocol):
    """A term with a force between two states whose work is the difference of their energies."""

    def mean_force(self, u0: Array, u1: Array, weights: tuple[float, float], theta: float, force: Array) -> float:
        """Add to `force` (nv, d) the force [N] of weighted tensions at `u0` and `u1`, along the edges at
        `(1 - theta) u0 + theta u1`.

        For `theta = 1/2` and weights of sum 1 its work over `u1 - u0` is `W(u1) - W(u0) + (w1 - w0) R` with the `R >= 0` [J] that
        is returned.
        """


@runtime_checkable
class HasDampingForce(Protocol):
    """A term that can resist the rate of its strain."""

    def damping_force(self, u: Array, v: Array, force: Array) -> float:
        """Add to `force` (nv, d) its Gauss-Newton tangent at `u` times velocities `v`; half the power that it takes [W]."""


@runtime_checkable
class Grounded(Protocol):
    """A term that ties a body to the ground, so that its force is one from outside."""

    @property
    def grounded(self) -> NDArray[np.int64]:
        """Degrees of freedom that it ties to the ground."""

    def energy_and_force(self, u: Array, force: Array | None = None) -> float:
        """Strain energy [J]; adds the internal force [N], minus that of the ground on the body, to `force` (nv, d)."""


@runtime_checkable
class HasVolume(Protocol):
    """A term with elements that can turn inside out; its specification has their `region`.

    Where its forces are finite in inverted elements and push them back, `passes_inversion` is True, and motions may pass through
    such states.
    """

    def volume_ratios(self, u: Array) -> NDArray[np.float64]:
        """(n,) volume at `u` (nv, d) over that at rest of the region's elements, in their order."""

    def smallest_volume_ratio(self, u: Array) -> float:
        """The smallest of `volume_ratios(u)`."""

    def step_limit(self, u: Array, v: Array) -> float:
        """The smallest `s > 0` at which an element that is right side out at `u` has no volume left at `u + s v`; or infinity."""


@runtime_checkable
class HasStretch(Protocol):
    """A term with elements that soften when they are compressed; its specification has their `region`."""

    def smallest_stretches(self, u: Array) -> NDArray[np.float64]:
        """(n,) smallest principal stretch at `u` (nv, d) of the region's elements, in their order, within their own dimensions."""

    def smallest_stretch(self, u: Array) -> float:
        """The smallest of `smallest_stretches(u)`."""


@runtime_checkable
class CanRemove(Protocol):
    """A term that elements can be taken out of. Loads need no such method: they are bound again, to the body that is left."""

    def without(self, gone: NDArray[np.bool_]) -> Any:
        """Return the term without the elements that are `gone` (n,), of its region in their order; of the mesh, if it has none.

        This term stays as it is. `gone` names all elements that are out, those of earlier calls too. The new term couples the same
        pairs of nodes, with blocks of zeros; the pairs that it still holds together are its `nodes_joined` (2, m), if it has that
        attribute. The new term has the memory of this one.
        """


@runtime_checkable
class HasStress(Protocol):
    """A specification of a material that carries stress on the elements of its `region`."""

    @property
    def region(self) -> Any:
        """Name of a subdomain, element ids, or None for all elements."""

    @property
    def material(self) -> Any:
        """The material, with `check` and its moduli."""

    def hypothesis(self, mesh: ElementMesh) -> Hypothesis:
        """Which components of strain or stress vanish across the elements of this mesh."""

    def section(self, mesh: ElementMesh, n: int) -> NDArray[np.float64]:
        """Return the factor that makes a volume of the measure of an element, a number or (n,)."""


def has_stress(term: HasStress) -> bool:
    """Whether stress and energy density of a term are known; a law of forces on nodes has the attribute `has_stress`, False."""
    return bool(getattr(term, "has_stress", True))


@runtime_checkable
class HoldsShape(Protocol):
    """A specification without stress on elements that yet resists all strain of some, as springs along all their edges do."""

    def elements_held_in_shape(self, mesh: ElementMesh) -> NDArray[np.int64]:
        """(n,) ids of elements that are rigid as long as the term has no energy."""


class Deformation(NamedTuple):
    """Deformation of elements at a point of each.

    Attributes
    ----------
    elements : (n,) their ids, for messages.
    hypothesis : which components of strain or stress vanish across them.
    axes : (n, d, k) an orthonormal basis of their own line or plane at rest, as columns.
    gradient : (n, d, k) derivatives of the displacement along those.
    strain : (n, k, k) Green-Lagrange strain within, without cancellation.
    """

    elements: NDArray[Any]
    hypothesis: Hypothesis
    axes: Array
    gradient: Array
    strain: Array


class PointResponse(NamedTuple):
    """Response of a law at a point of each of n elements, in a frame of their axes, then the normals.

    Attributes
    ----------
    strain : (n, 3, 3) Green-Lagrange strain, that across them too.
    stress : (n, 3, 3) second Piola-Kirchhoff stress [Pa]; 0 where it is infinite.
    density : (n,) strain energy per rest volume [J/m^3].
    infinite : (n,) whether the stress is infinite, as where elements have no volume left.
    """

    strain: Array
    stress: Array
    density: Array
    infinite: NDArray[np.bool_]


@runtime_checkable
class HasResponse(Protocol):
    """A specification that `HasStress` by a law of its own, other than St. Venant-Kirchhoff's `S = C : E`; None if it is that."""

    def response(self, at: Deformation) -> PointResponse:
        """Strain, stress and energy of the elements of its `region`, all of them, in their order."""


@runtime_checkable
class HasPressure(Protocol):
    """A specification of an energy of the volume ratio `J`, whose stress is a pressure, on the elements of its `region`."""

    kind: str

    @property
    def region(self) -> Any:
        """Name of a subdomain, element ids, or None for all elements."""

    def moduli(self, body: Body) -> Array:
        """(n,) stiffness of the elements of the region [Pa]."""

    def density_and_slope(self, e: Array, elements: NDArray[Any]) -> tuple[Array, Array]:
        """`psi` and `psi'` (n,) for a stiffness of 1 at `e = J - 1` of these elements."""
