"""What a term is: a specification that binds to a mesh, and what it is then."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..arguments import Array
from ..edges import ALL, Linearized, Rows, Tensions
from ..edges.rows import Places
from ..materials import Hypothesis
from ..mesh import SimplexMesh

if TYPE_CHECKING:
    from .body import Body
    from .load import Time


class BoundTerm(Protocol):
    """An elastic term on a mesh: it adds what it contributes at displacements `u` (nv, d) to arrays that it is handed."""

    @property
    def edges(self) -> NDArray[np.int32]:
        """(2, ne) pairs of vertices `a < b` that it couples, in lexicographic order."""

    def energy(self, u: Array, force: Array | None = None) -> float:
        """Strain energy [J]; adds the internal force [N] to `force` (nv, d)."""

    def rows(self, pattern: Places) -> Rows:
        """Where its blocks stand in the values of a matrix of this pattern."""

    def tangent(self, u: Array, rows: Rows, data: Array, add: bool, force: Array | None = None, kept: Tensions = ALL) -> Linearized:
        """Write the tangent stiffness [N/m] of its edges and vertices to CSR values, or add it; adds the force to `force` (nv, d).

        `kept`: which tensions of edges stay in it; the factor of negative ones is that of `psi' d2J` of volumes as well.
        """

    def edge_blocks(
        self, u: Array, force: Array | None = None, out: Array | None = None, kept: Tensions = ALL
    ) -> tuple[float, Array]:
        """The energy [J], and what `add_product` needs at `u`, in which K is linear; `out` is what it returned before, to be filled anew."""

    def add_product(self, blocks: Array, v: Array, out: Array) -> None:
        """Add `K v` to `out` (nv, d)."""

    def add_diagonal(self, blocks: Array, out: Array) -> None:
        """Add the diagonal blocks `K_aa` to `out` (nv, d, d)."""

    def add_norms(self, blocks: Array, x: Array, out: Array) -> None:
        """Add `sum_b |K_ab| x_b` over the other vertices `b` to `out` (nv,), for `x` (nv,), with norms not below the 2-norm."""

    def add_round_off(self, u: Array, out: Array) -> None:
        """Add to `out` (nv, d) the absolute values of all that adds up to the force [N]: times eps, the size of its rounding error."""

    def memory(self) -> dict[str, int]:
        """Bytes of what there is now, by part."""


@runtime_checkable
class Quartic(Protocol):
    """A term whose energy along any line is exactly a quartic."""

    def along(self, u: Array, v: Array) -> NDArray[np.float64]:
        """(5,) coefficients of the energy along `u + s v`: `c0 + c1 s + c2 s^2 + c3 s^3 + c4 s^4` [J]."""


@runtime_checkable
class HasMeanForce(Protocol):
    """A term with a force between two states whose work is the difference of their energies."""

    def mean_force(self, u0: Array, u1: Array, weights: tuple[float, float], theta: float, force: Array) -> float:
        """Add to `force` (nv, d) the force [N] of weighted tensions at `u0` and `u1`, along the edges at `(1 - theta) u0 + theta u1`.

        For `theta = 1/2` and weights of sum 1 its work over `u1 - u0` is `W(u1) - W(u0) + (w1 - w0) R` with the `R >= 0` [J] that is returned.
        """


@runtime_checkable
class HasDampingForce(Protocol):
    """A term that can resist the rate of its strain."""

    def damping_force(self, u: Array, v: Array, force: Array) -> float:
        """Add to `force` (nv, d) the product of its Gauss-Newton tangent at `u` with velocities `v`; half the power that it takes [W]."""


@runtime_checkable
class Grounded(Protocol):
    """A term that ties a body to the ground, so that its force is one from outside."""

    @property
    def grounded(self) -> NDArray[np.int64]:
        """Degrees of freedom that it ties to the ground."""

    def energy(self, u: Array, force: Array | None = None) -> float:
        """Strain energy [J]; adds the internal force [N], minus that of the ground on the body, to `force` (nv, d)."""


@runtime_checkable
class HasVolume(Protocol):
    """A term with simplices that can turn inside out; its specification has their `region`."""

    def volume_ratios(self, u: Array) -> NDArray[np.float64]:
        """(n,) volume at `u` (nv, d) over that at rest of the region's simplices, in their order."""

    def smallest_volume_ratio(self, u: Array) -> float:
        """The smallest of them."""

    def step_limit(self, u: Array, v: Array) -> float:
        """The smallest `s > 0` at which a simplex that is right side out at `u` has no volume left at `u + s v`; or infinity."""


@runtime_checkable
class HasStress(Protocol):
    """A specification of a material that carries stress on the elements of its `region`."""

    @property
    def region(self) -> Any:
        """Name of a subdomain, element ids, or None for all elements."""

    @property
    def material(self) -> Any:
        """The material, with `check`, `density` and its moduli."""

    def hypothesis(self, mesh: SimplexMesh) -> Hypothesis:
        """Which components of strain or stress vanish across the simplices of this mesh."""

    def section(self, mesh: SimplexMesh, n: int) -> NDArray[np.float64]:
        """What turns the measure of a simplex into a volume, a number or (n,)."""


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


@runtime_checkable
class HasStretch(Protocol):
    """A term with simplices that can be compressed; its specification has their `region`."""

    def smallest_stretches(self, u: Array) -> NDArray[np.float64]:
        """(n,) smallest principal stretch at `u` (nv, d) of the region's simplices, in their order, within their own dimensions."""

    def smallest_stretch(self, u: Array) -> float:
        """The smallest of them."""


class Term(Protocol):
    """A specification without a mesh."""

    def bind(self, body: Body, dtype: DTypeLike) -> BoundTerm:
        """The term on this body, with results of this type."""


class BoundLoad(Protocol):
    """What acts on a body from outside, at displacements `u` (nv, d) and load factor or moment `t`."""

    @property
    def has_potential(self) -> bool:
        """Whether its force is minus the gradient of a potential; otherwise its stiffness is not symmetric."""

    @property
    def dead(self) -> bool:
        """Whether its force is the same wherever the body goes: it has a potential, linear in `u`, and no stiffness."""

    @property
    def steady(self) -> bool:
        """Whether it is given by constants, not by a function of time."""

    @property
    def edges(self) -> NDArray[np.int32]:
        """(2, ne) pairs of vertices `a < b` that its stiffness couples, in lexicographic order; none if it couples each vertex with itself at most."""

    def potential(self, u: Array, t: Time) -> float:
        """Its potential [J]; the force is `-d potential/du`."""

    def add_force(self, u: Array, t: Time, out: Array) -> None:
        """Add the external force [N] to `out` (nv, d)."""

    def places(self, pattern: Places) -> Any:
        """Where its blocks stand in the values of a matrix of this pattern."""

    def add_stiffness(self, u: Array, t: Time, places: Any, data: Array) -> None:
        """Add `-d force/du` [N/m] to CSR values."""

    def memory(self) -> dict[str, int]:
        """Bytes of what there is now, by part."""
