"""Dead loads: forces on the nodes, the volume or the surface of a body that do not depend on its motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from ...arguments import Array, Quantity
from ...mesh import ElementMesh
from ...mesh.locations import Where, describe, facets_at, in_value_order, vertices_at
from ..body import Body
from .load import BoundLoad, Load, Moment, Time, Value
from .spread import Spread

Values = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Gravity(Load):
    """Weight: `f_a = integral of rho N_a g dV`, with the densities of the materials.

    The weight is `M g` with the consistent masses. In dynamics it is `M g` with the masses of the motion, also lumped ones, so that
    a free body falls without strain.

    Parameters
    ----------
    g
        Acceleration [m/s^2]: components, which ramp with the load factor; or a function of t or of (x, t), used without a ramp.

    Raises
    ------
    MaterialError
        when it is bound, if a material has no density.
    LoadError
        if `g` is not made of finite numbers; when it is bound, if it does not have one value per component.

    Examples
    --------
    >>> import numpy as np, skfem
    >>> from skfem_stvk import StVK, System
    >>> cube = System(skfem.MeshTet(), [StVK(young=1.0, poisson=0.3, density=2700.0), Gravity(g=(0, 0, -9.81))])
    >>> cube.external_force(np.zeros(cube.ndofs)).reshape(-1, 3).sum(axis=0).round(6)
    array([     0.,      0., -26487.])
    """

    given_by, needs_density, per_element = "g", True, True

    g: Annotated[Any, Quantity("acceleration", "Acceleration.", components=True)]

    def bind(self, body: Body) -> Weight:
        spread = spread_over(body, lambda one: one.mass)
        lumped = Nodes(body.mesh, spread.vertices, body.lumped_mass[spread.vertices])
        return Weight(body.mesh, spread, lumped, self.value(body.mesh, spread.x, "Gravity"))


@dataclass(frozen=True, eq=False)
class BodyForce(Load):
    """Dead force on the volume: `f_a = integral of N_a b dV` over the body at rest; thickness and area of its terms count.

    Parameters
    ----------
    force
        Force `b` per volume at rest [N/m^3]: components, which ramp with the load factor; or a function of t or of (x, t), used
        without a ramp and interpolated between nodes by their shape functions.
    region
        Elements: name of a subdomain, element ids, or None for all elements, including those of the bodies in `beside`.

    Raises
    ------
    RegionError
        when it is bound, if the region is not in the mesh.
    LoadError
        if `force` is not made of finite numbers; when it is bound, if it does not have one value per component.

    Examples
    --------
    >>> import numpy as np, skfem
    >>> from skfem_stvk import StVK, System
    >>> cube = System(skfem.MeshTet(), [StVK(young=1.0, poisson=0.3), BodyForce(lambda x, t: (t * x[2], 0, 0))])
    >>> cube.external_force(np.zeros(cube.ndofs), t=0.5).reshape(-1, 3).sum(axis=0).round(6)
    array([0.25, 0.  , 0.  ])
    """

    given_by, per_element = "force", True

    force: Annotated[Any, Quantity("force per volume", "Force per volume at rest.", components=True)]
    region: Annotated[str | NDArray[Any] | None, Quantity(None, "Elements it acts on; by default all.")] = None

    def bind(self, body: Body) -> DeadLoad:
        if self.region is None:
            spread = spread_over(body, lambda one: one.volumes)
        else:
            ids = body.mesh.elements(self.region)
            spread = Spread(body.mesh, body.mesh.element, body.mesh.t[:, ids], body.volumes[ids])
        return DeadLoad(body.mesh, spread, self.value(body.mesh, spread.x, "BodyForce"))


@dataclass(frozen=True, eq=False)
class NodalLoad(Load):
    """Dead force on each node at a place: vertices, and the middles of edges that quadratic elements have.

    Parameters
    ----------
    where
        Location: name of a boundary or of a node set, node ids or a mask, predicate of x (d, n), or scikit-fem's get_dofs(...).
    force
        Force on *each* node [N]: components, or (d, n) with one column for each node, in the order of user-supplied ids, otherwise
        ascending; these ramp with the load factor. Or a function of t or of (x, t), used without a ramp.

    Raises
    ------
    RegionError
        when it is bound, if there is no node.
    LoadError
        if `force` is not made of finite numbers; when it is bound, if it does not have one value per component.

    Examples
    --------
    >>> import numpy as np, skfem
    >>> from skfem_stvk import StVK, System
    >>> bar = System(skfem.MeshLine(), [StVK(young=1.0, poisson=0.3), NodalLoad(lambda x: x[0] == 1, [5.0])])
    >>> bar.external_force(np.zeros(2), t=0.1)
    array([0. , 0.5])
    """

    given_by, per_element = "force", True

    where: Annotated[Where, Quantity(None, "Place of the nodes.")]
    force: Annotated[Any, Quantity("force", "Force on each node.", components=True)]

    def bind(self, body: Body) -> DeadLoad:
        what = f"NodalLoad on {describe(self.where)}"
        vertices = vertices_at(body.mesh, self.where, what)
        weights = body.mesh.space.counted(np.where(body.bare, 0.0, 1.0))[vertices]  # each node once in a divided body
        nodes = Nodes(body.mesh, vertices, None if weights.all() else weights)
        return DeadLoad(body.mesh, nodes, self.value(body.mesh, nodes.x, what))


@dataclass(frozen=True, eq=False)
class Traction(Load):
    """Dead traction: `f_a = integral of N_a T dA` over facets of the body at rest.

    The facets of surfaces are edges, whose area is length times thickness; those of segments are ends, with the segment's area.

    Parameters
    ----------
    where
        Location: name of a boundary; or another location (name of a node set, node ids or a mask, predicate of x (d, n),
        scikit-fem's get_dofs(...)): all boundary facets with all of their nodes there.
    traction
        Force `T` per area at rest [N/m^2]: components, or (d, n) with one column for each node of the facets, in the order of
        user-supplied ids, otherwise ascending; these ramp with the load factor. Or a function of t or of (x, t), used without a
        ramp. Interpolated between nodes by their shape functions.

    Raises
    ------
    RegionError
        when it is bound, if there is no facet.
    LoadError
        if `traction` is not made of finite numbers; when it is bound, if it does not have one value per component.

    Examples
    --------
    >>> import numpy as np, skfem
    >>> from skfem_stvk import StVK, System
    >>> cube = System(skfem.MeshTet(), [StVK(young=1.0, poisson=0.3), Traction(lambda x: x[0] == 1, (0, 0, -2e6))])
    >>> cube.external_force(np.zeros(cube.ndofs), t=0.5).reshape(-1, 3).sum(axis=0)
    array([       0.,        0., -1000000.])
    """

    given_by, per_element = "traction", True

    where: Annotated[Where, Quantity(None, "Place of the boundary facets.")]
    traction: Annotated[Any, Quantity("stress", "Force per area at rest.", components=True)]

    def bind(self, body: Body) -> DeadLoad:
        what = f"Traction on {describe(self.where)}"
        facets = facets_at(body.mesh, self.where, what)
        spread = Spread(body.mesh, body.facet, facets, body.facet_areas(facets), in_value_order(body.mesh, self.where, facets))
        return DeadLoad(body.mesh, spread, self.value(body.mesh, spread.x, what))


def spread_over(body: Body, sizes: Callable[[Body], Values]) -> Spread | CombinedSpread:
    """Return the spread over all elements of a body, with these sizes (nt,), including those of the bodies in `beside`."""
    own = Spread(body.mesh, body.mesh.element, body.mesh.t, sizes(body))
    if not body.beside:
        return own
    return CombinedSpread(body.mesh, [own, *(Spread(one.mesh, one.mesh.element, one.mesh.t, sizes(one)) for one in body.beside)])


class CombinedSpread:
    """All elements of several kinds on the same nodes, with the interface of `Spread`, which has one kind."""

    def __init__(self, mesh: ElementMesh, spreads: Sequence[Spread]) -> None:
        self.vertices, self.x, self._spreads = np.arange(mesh.nv), mesh.p, spreads

    def integrate(self, values: Values) -> Values:
        """Return the integral (nv, d) of `N_a f` over all of them, from `values` (d, nv) or (d, 1)."""
        found = np.zeros(self.x.T.shape)
        for spread in self._spreads:
            found[spread.vertices] += spread.integrate(values if values.shape[1] == 1 else values[:, spread.vertices])
        return found


class Nodes:
    """Nodes that take the values unchanged, or times a weight (n,): the counterpart of `Spread` for forces on nodes."""

    def __init__(self, mesh: ElementMesh, vertices: NDArray[np.int64], weights: Values | None = None) -> None:
        self.vertices, self.x, self._weights = vertices, mesh.p[:, vertices], weights

    def integrate(self, values: Values) -> Values:
        """Return the `values` (d, nv) or (d, 1) as (nv, d)."""
        each = np.broadcast_to(values.T, self.x.T.shape)
        return each if self._weights is None else self._weights[:, None] * each


class DeadLoad(BoundLoad):
    """Load with values `f(t)` at the nodes of the `spread`, and the potential `-f . u`.

    Constants are spread once. Values of a function are spread again when they differ from those of the previous call, since the
    function may depend on more than `t`.
    """

    def __init__(self, mesh: ElementMesh, spread: Spread | CombinedSpread | Nodes, value: Value) -> None:
        self._at: Any = slice(None) if np.array_equal(spread.vertices, np.arange(mesh.nv)) else spread.vertices
        self._spread, self._value = spread, value
        self._unit = None if value.constant is None else spread.integrate(value.constant)
        self.steady = self._unit is not None
        self._known: tuple[Any, Values] = None, np.empty(0)
        self.forces(1.0)

    def forces(self, t: Time) -> Values:
        """Return the forces (n, d) on its nodes [N]."""
        moment, (key, forces) = Moment.of(t), self._known  # read once, since other threads write it
        values = None if self.steady else self._value.at(moment)
        key_now = (moment.factor if values is None else values.tobytes(), moment.mass)
        if key != key_now:
            forces = self._compute(moment, values)
            self._known = key_now, forces
        return forces

    def _compute(self, moment: Moment, values: Values | None) -> Values:
        """Return the forces of these values, or of the constants."""
        if self._unit is not None:
            return moment.factor * self._unit
        assert values is not None
        return self._spread.integrate(values)

    def potential(self, u: Array, t: Time) -> float:
        """Return `-f(t) . u` [J]."""
        return -float(np.einsum("ic,ic", self.forces(t), u[self._at]))  # BLAS is avoided: its threads wait for ours

    def add_force(self, u: Array, t: Time, out: Array) -> None:
        out[self._at] += self.forces(t)

    def memory(self) -> dict[str, int]:
        return {"loads": self._known[1].nbytes}


class Weight(DeadLoad):
    """Weight of consistent masses, spread over elements; at times that ask for lumped masses, the weight of these."""

    def __init__(self, mesh: ElementMesh, spread: Spread | CombinedSpread, lumped: Nodes, value: Value) -> None:
        self._lumped = lumped
        super().__init__(mesh, spread, value)

    def _compute(self, moment: Moment, values: Values | None) -> Values:
        if moment.mass != "lumped":
            return super()._compute(moment, values)
        return self._lumped.integrate(self._value.at(moment) if values is None else values)
