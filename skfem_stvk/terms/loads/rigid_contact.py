"""Contact of the surface of a body with a rigid shape, by a penalty, with friction."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ...arguments import Array, Quantity, number, shown
from ...edges import ALL, NodeBlocks, Tensions
from ...errors import ContactError
from ...kernels import contact_penalty as kernels
from ...kernels.contact_penalty import Surface
from ...kernels.simplex_topology import edges_of_simplices
from ...mesh import ElementMesh
from ...mesh.diagnostics import parts
from ...mesh.element import Element
from ...mesh.locations import Where
from ...mesh.points import rule_of, sizes_of
from ..body import Body
from .contact import BoundContact, Contact, Friction, numbers_of, refuse_missing_width, width_of
from .contact_surface import elements_behind, surface_at, young_of
from .load import Assumed, Assumption, Moment, Time, Value
from .rigid_shapes import RigidShape
from .spread import Spread

#: Stiffness by default, in units of E/h: Young's modulus by the mean length of the facet's edges.
STIFFNESS = 10.0
#: Gap of nodes that touch at the start of a static solve, as a fraction of the size of the body.
TOUCHING = 1e-6
#: Depth of points in the middle of a shape, as a fraction of its thickness, less round-off.
HALFWAY = 0.5 - 1e-9


@dataclass(frozen=True, eq=False)
class RigidContact(Contact):
    """Contact of a body's surface with a rigid shape: a penalty on the depth of its points in the shape.

    ::

        W = integral of psi(depth) dA        psi'' = k, or k min(1, depth/onset)

    The integral is over the surface at rest. Points are the vertices with their areas, and on quadratic elements and hexahedra the
    points of the facets' rule for masses. In `EnergyMomentum` the force is a discrete gradient of W, so that the energy is kept.

    Parameters
    ----------
    shape
        `RigidPlane`, `RigidSphere`, `RigidCylinder` or `RigidBox`.
    where
        Location of the facets that may touch, as in `Traction`; of surfaces in space a subdomain or ids. By default the whole
        surface: then the areas of all facets count at edges of the body, also of those that face away.
    stiffness
        Stiffness `k` [N/m^3]. By default `10 E/h`, with Young's modulus E of the element behind each facet and the mean length h of
        its edges: a pressure of `E/10` makes a depth of 1 % of the element.
    friction
        `Friction` between the body and the shape; by default none.
    onset
        Depth over which the stiffness rises to `k` [m]; 0 by default. It softens impacts, and lets pressed bodies sink in.
    motion
        (d,) displacement of the shape [m], which ramps with the load factor, or a function of t. By default the shape rests.
    name
        Name in results, ledgers and messages.
    simplices
        Surface in space outside the mesh, such as a membrane on tetrahedra, as in `Pressure`.

    Raises
    ------
    ContactError
        if the stiffness is not positive, the onset negative, or `shape` no rigid shape. When it is bound: if the shape has another
        dimension than the mesh, the body has no surface, or a law has no Young's modulus and `stiffness` is None.
    RegionError
        when it is bound, if there is no facet.

    Examples
    --------
    >>> import numpy as np, skfem
    >>> from skfem_stvk import RigidPlane, StVK, System
    >>> floor = RigidContact(RigidPlane((0, 0, 0), (0, 0, 1)), where=lambda x: x[2] == 0, stiffness=1e6)
    >>> cube = System(skfem.MeshTet(), [StVK(young=1.0, poisson=0.3), floor])
    >>> u = np.tile([0, 0, -0.01], 8)                       # 1 cm deep: 1/2 k depth^2 [J], k depth [N] on 1 m^2
    >>> round(cube.energy(u), 9), float(cube.internal_force(u).reshape(-1, 3).sum(axis=0)[2].round(9))
    (50.0, -10000.0)
    """

    given_by: ClassVar[str] = "motion"
    unit = "N/m^3"

    shape: Annotated[RigidShape, Quantity(None, "The rigid shape.")]
    where: Annotated[Where | None, Quantity(None, "Place of the boundary facets that may touch; by default all.")] = None
    stiffness: Annotated[float | None, Quantity("stiffness per area", "Stiffness per area; by default 10 E/h.", gt=0)] = None
    friction: Annotated[Friction | None, Quantity(None, "Friction; by default none.")] = None
    onset: Annotated[float, Quantity("length", "Depth over which the stiffness rises.", ge=0)] = 0.0
    motion: Annotated[Any, Quantity("length", "Displacement of the shape; by default it rests.", components=True)] = None
    name: Annotated[str, Quantity(None, "Name in results and messages.")] = "contact"
    simplices: Annotated[Any, Quantity(None, "A surface in space, on nodes of the mesh: the simplices of its law.")] = None

    def __post_init__(self) -> None:
        if not isinstance(self.shape, RigidShape):
            raise ContactError(
                f"RigidContact: shape = {shown(self.shape)}; expected RigidPlane(...), RigidSphere(...), RigidCylinder(...) or "
                "RigidBox(...)."
            )
        super().__post_init__()
        onset = number(f"{self.label}: onset", self.onset, "a depth [m], zero or more", 0.0, closed=True, error=ContactError)
        object.__setattr__(self, "onset", onset)

    def bind(self, body: Body | ElementMesh, dtype: DTypeLike = np.float64) -> BoundRigidContact:
        body = body if isinstance(body, Body) else Body(body, [])
        if self.shape.d != body.mesh.d:
            raise ContactError(
                f"{self.label}: its {self.shape.name} has {self.shape.d} components; expected {body.mesh.d}, as the mesh."
            )
        plain = self.motion is None and self.friction is None
        return (BoundRigidContact if plain else RigidContactWithHistory)(self, body)


Own = TypeVar("Own", bound="BoundRigidContact")


class Displacement(Protocol):
    """Displacement of a shape as a function of the load factor or time."""

    def at(self, t: Time) -> Array:
        """Return the components (d, 1) at `t` [m]."""


class ShapeInStep(NamedTuple):
    """State of a contact within a step.

    Attributes
    ----------
    assumed
        Assumption of the stiffness.
    shift, start
        (3,) displacements of the shape, and those at the beginning of the step [m].
    width
        Slip up to which friction rises [m]; 0 if there is none, as in the state at the beginning of the step.
    past
        (n, nq, 7) displacement, largest friction [N] and normal of each point at the beginning of the step.
    secants
        (n, nq) force per slip for all slips [N/m]; empty if that of the slip acts.
    factor
        Factor of friction.
    """

    assumed: Assumption = None
    shift: Array = np.zeros(3)
    start: Array = np.zeros(3)
    width: float = 0.0
    past: Array = np.zeros((0, 0, 7))
    secants: Array = np.empty((0, 0))
    factor: float = 1.0


class BoundRigidContact(BoundContact):
    """Contact on a mesh. It couples the nodes of each facet, if its points are not the vertices, and joins none of them.

    Attributes
    ----------
    contact, name
        Specification, and its name.
    areas
        (n, nq) areas of the points at rest [m^2].
    nodes, nodes_paired
        Nodes (m,) of the facets, and pairs (2, n) of nodes of a facet with points between them.
    edge, shortest_edge
        Mean length of the edges of all facets at rest, and that of the smallest facet [m].
    """

    removable = True

    def __init__(self, contact: RigidContact, body: Body) -> None:
        self.contact, self.name = contact, contact.name
        self._shape, self._now = kernels.ShapeNumbers(contact.shape.kind, contact.shape.numbers()), ShapeInStep()
        self._facets, self._element = surface_at(body, contact.where, contact.label, contact.simplices)
        edges = _edge_lengths(contact, body, self._facets, self._element)
        self.edge, self.shortest_edge = float(edges.mean()), float(edges.min())
        self._set_areas(body)
        N, t, X = self._surface
        self.nodes = np.unique(t).astype(np.int32)
        local = np.searchsorted(self.nodes, t).astype(np.int32)
        self._own_surface = Surface(N, local, X[self.nodes])
        self._first, self._second = np.triu_indices(t.shape[1], 1)
        between = np.stack([self._first, self._second], axis=1)
        pairs, self._sides = edges_of_simplices(np.ascontiguousarray(local.T), between, len(self.nodes))
        self.nodes_paired = self.nodes[pairs]

    @property
    def shape(self) -> RigidShape:
        return self.contact.shape.displaced(self._now.shift[: self._body.mesh.d])

    def at(self: Own, moment: Moment, history: Array | None) -> Own:
        return self if moment.contact is None else self._with(_now=ShapeInStep(moment.contact))

    def _set_areas(self, body: Body) -> None:
        """Use the areas of the facets of a body, and the stiffness of its materials."""
        self._body, contact = body, self.contact
        areas = _areas(contact, body, self._facets, self._element)
        self._surface, self.areas = _points_of(body.mesh, self._element, self._facets, areas)
        if contact.stiffness is None:
            stiffness = _default_stiffness(contact, body, self._facets, self._element)
            self._weights = _points_of(body.mesh, self._element, self._facets, areas * stiffness)[1]
        else:
            self._weights = contact.stiffness * self.areas

    def without(self, removed: NDArray[np.bool_]) -> BoundRigidContact:
        """Return the contact without the facets whose elements are all removed, `removed` (nt,). New faces do not touch."""
        other = self._with()
        other._set_areas(self._body.without(removed, self._body.bare))
        return other

    def moved_by(self, motion: Displacement) -> RigidContactWithHistory:
        """Return the contact with a shape that this motion displaces."""
        return RigidContactWithHistory(self.contact, self._body, motion)

    def energy_and_force(self, u: Array, force: Array | None = None) -> float:
        out = np.empty_like(u[:0]) if force is None else force
        e = self.contact.onset
        return float(kernels.energy_and_force(self._surface, self._weights, self._shape, self._now.shift, e, u, out))

    def add_blocks(self, u: Array, blocks: NodeBlocks, kept: Tensions = ALL) -> None:
        start, e, into = (self._own_surface, self._weights, self._shape), self.contact.onset, self._into(blocks)
        assumed = self._now.assumed
        if isinstance(assumed, tuple):
            u0, u1 = (one[self.nodes] for one in assumed)
            kernels.add_mean_blocks(*start, self._now.start, self._now.shift, e, u0, u1, into)
        elif assumed is not Assumed.APART:
            everywhere = assumed is Assumed.TOUCHING
            kernels.add_blocks(*start, self._now.shift, e, u[self.nodes], kept.negative, everywhere, into)

    def _into(self, blocks: NodeBlocks) -> kernels.Blocks:
        """Return the arrays of the blocks, and the numbers of the pairs of nodes."""
        assert blocks.own is not None
        return kernels.Blocks(self._sides, self._first, self._second, blocks.pairs, blocks.own)

    def mean_force(self, u0: Array, u1: Array, weights: tuple[float, float], theta: float, force: Array) -> float:
        """Add the sum of the `weights` times the discrete gradient of the energy to `force` (nv, d); return 0."""
        start, e = (self._surface, self._weights, self._shape, self._now.start, self._now.shift), self.contact.onset
        kernels.add_mean_force(*start, e, u0, u1, sum(weights), force)
        return 0.0

    def contact_limit(self, u: Array, v: Array) -> float:
        """Return the smallest `s > 0` at which a point is halfway on its way `u + s v` through the resting shape, or infinity."""
        return float(kernels.step_limit(self._surface, self._shape, self._now.shift, np.zeros(3), u, v))

    def too_soft(self, impact: float) -> str:
        """Return a sentence if a body with `v sqrt(rho h) = impact` gets farther than halfway through the shape, else "".

        The depth of a body of this speed, density and height is `v sqrt(rho h/k)`.
        """
        total, half = self._body.mesh.space.comm.total, self.contact.shape.thickness / 2
        k = total(float(self._weights.sum())) / total(float(self.areas.sum()))
        depth = impact / np.sqrt(k)
        if depth <= half:
            return ""
        return (
            f" The contact {self.name!r} is too soft: with its stiffness of {k:.3g} [N/m^3] the body gets {depth:.3g} m deep; "
            f"expected less than half of the thickness of the shape, {half:.3g} m. Take a larger stiffness."
        )

    def refuse_start(self, u: Array) -> None:
        """Raise ContactError if a part of the body lies within the shape at `u` (nv, d), or points are halfway through it.

        Other points in a shape are pushed out.
        """
        if (depth := self.depth_within(u)) > 0:
            raise ContactError(
                f"{self.contact.label}: no node of the body is outside the {self.shape.name} at the start, and the deepest is "
                f"{depth:.4g} m within; expected the body outside. Reverse the normal (inside=... of spheres and cylinders), or "
                "move the body."
            )
        if (depth := -self.smallest_gap(u)) > HALFWAY * self.shape.thickness:
            raise ContactError(
                f"{self.contact.label}: points are {depth:.4g} m deep in the {self.shape.name} at the start, halfway through it, "
                "where no direction leads out; expected them nearer to its surface. Move the body or the shape."
            )

    def depth_within(self, u: Array) -> float:
        """Return the largest depth [m] of nodes of a connected part that lies within the shape at `u` (nv, d), otherwise 0."""
        part, every = parts([body.mesh for body in (self._body, *self._body.beside)]), np.arange(len(u), dtype=np.int32)
        at_nodes = Surface(np.ones((1, 1)), every[:, None], self._surface.X)
        gaps = self._gaps(at_nodes, np.zeros((len(u), 1)), u)[0][:, 0]
        largest, smallest = np.full(part.max() + 1, -np.inf), np.full(part.max() + 1, np.inf)
        np.maximum.at(largest, part, gaps)
        np.minimum.at(smallest, part, gaps)
        size = np.maximum(largest - smallest, self.edge)  # flat parts have no size across the shape
        within = (largest <= TOUCHING * size) & (smallest < -size / 2)
        return float(-smallest[part[self.nodes]].min(initial=0.0, where=within[part[self.nodes]]))

    def passes(self, u0: Array, u1: Array) -> bool:
        """Return whether a point gets halfway through the moving shape, or farther, on the way from `u0` to `u1` (nv, d)."""
        moved = self._now.shift - self._now.start
        return bool(kernels.step_limit(self._surface, self._shape, self._now.start, moved, u0, u1 - u0) <= 1)

    def identity(self) -> list[float]:
        finite = np.nan_to_num(self._shape.numbers).tolist()
        return [
            self._shape.kind,
            *finite,
            self.contact.onset,
            *numbers_of(self.contact.friction),
            float(self._weights.sum()),
            *self._now.shift.tolist(),
        ]

    def held_directions(self, u: Array) -> tuple[NDArray[np.int64], Array]:
        """Return nodes (m,) of facets that touch at `u` (nv, d), and the normals (m, d) there.

        Friction holds nothing at the start, because it lags behind by a step.
        """
        at_nodes = Surface(np.ones((1, 1)), self.nodes[:, None], self._surface.X)
        gaps, _, normals = self._gaps(at_nodes, np.zeros((len(self.nodes), 1)), u)
        size = float(np.ptp(self._surface.X, axis=0).max())
        there = np.isin(self.nodes, self._surface.t[(self.areas > 0).any(axis=1)])
        held = (gaps[:, 0] <= TOUCHING * size) & there
        return self.nodes[held].astype(np.int64), normals[held, 0]

    def _gaps(self, surface: Surface, weights: Array, u: Array) -> tuple[Array, Array, Array]:
        """Return gaps (n, nq) [m], normal forces (n, nq) [N] and normals (n, nq, d) of the points of a surface."""
        gaps, forces, normals = np.empty_like(weights), np.empty_like(weights), np.empty((*weights.shape, u.shape[1]))
        kernels.find_gaps(surface, weights, self._shape, self._now.shift, self.contact.onset, u, gaps, forces, normals)
        return gaps, forces, normals

    def evaluated(self, u: Array) -> tuple[Array, Array, float]:
        (N, t, _), (gaps, forces, _) = self._surface, self._gaps(self._surface, self._weights, u)
        sums = [np.zeros(len(u)) for _ in range(2)]
        for values, out in zip((forces, self.areas), sums, strict=True):
            np.add.at(out, t, values @ np.abs(N))
        smallest = np.full(len(u), np.inf)
        np.minimum.at(smallest, t, gaps.min(axis=1)[:, None])
        pressure = np.divide(sums[0], sums[1], out=np.zeros(len(u)), where=sums[1] > 0)
        return pressure, smallest, float(self.areas[gaps < 0].sum())

    def smallest_gap(self, u: Array) -> float:
        return float(kernels.smallest_gap(self._surface, self._shape, self._now.shift, u))

    def add_round_off(self, u: Array, out: Array) -> None:
        """Add the stiffness of the points that touch, times the coordinates that their depths subtract [N], to `out` (nv, d)."""
        (N, t, X), (gaps, _, normals) = self._surface, self._gaps(self._surface, self._weights, u)
        largest = (np.abs(X[t]) + np.abs(u[t])).max(axis=(1, 2)) + np.abs([*self._shape.numbers[:3], *self._now.shift]).max()
        touching = np.where(gaps < 0, self._weights, 0.0) * largest[:, None]
        np.add.at(out, t, np.einsum("nq,qm,nqd->nmd", touching, np.abs(N), np.abs(normals)))

    def memory(self) -> dict[str, int]:
        arrays = *self._surface, *self._own_surface, self.areas, self._weights, self._sides, self._facets, self.nodes
        return {"contact": sum(array.nbytes for array in (*arrays, self.nodes_paired))}


class RigidContactWithHistory(BoundRigidContact):
    """Contact with a shape that moves, or with friction.

    The history is the displacement (3,) of the shape at the beginning of the step, and its time. With friction, the displacement,
    the largest friction [N] and the normal of each point follow, (n, nq, 7). A `motion` may replace that of the contact.
    """

    does_work = has_history = True

    def __init__(self, contact: RigidContact, body: Body, motion: Displacement | None = None) -> None:
        super().__init__(contact, body)
        d, given = body.mesh.d, np.zeros(body.mesh.d) if contact.motion is None else contact.motion
        self._is_moved = motion is not None
        self._motion = motion or Value(given, (d,), np.zeros((d, 1)), contact.label, ContactError, "motion")
        self.has_friction = contact.friction is not None

    def for_analysis(self, in_time: bool) -> RigidContactWithHistory:
        if self.contact.friction is not None:
            refuse_missing_width(self.contact.friction, in_time, self.contact.label)
        return RigidContactWithHistory(self.contact, self._body) if self._is_moved else self

    def first_history(self) -> Array:
        return np.zeros(4 + (7 * self.areas.size if self.has_friction else 0))

    def return_to(self, history: Array) -> None:
        size = self.first_history().size
        if history.shape != (size,) or history.dtype != np.float64 or not np.isfinite(history).all():
            raise ValueError(f"the history of {self.contact.label} is {shown(history)}; expected {size} numbers")

    def at(self, moment: Moment, history: Array | None) -> RigidContactWithHistory:
        shift, step, friction = self._shift_at(moment), moment.step, self.contact.friction
        if history is None or step is None:
            return self._with(_now=ShapeInStep(moment.contact, shift))
        now = ShapeInStep(moment.contact, shift, history[:3])
        if friction is not None:
            width, past = width_of(friction, moment.time - history[3], step.in_time), history[4:].reshape(*self.areas.shape, 7)
            now = now._replace(width=width, past=past, factor=step.friction)
            if step.predicted is not None and width > 0:
                now = now._replace(secants=self._secants_at(step.predicted, now))
        return self._with(_now=now)

    def _shift_at(self, moment: Moment) -> Array:
        """Return the displacement (3,) of the shape [m]."""
        shift = np.zeros(3)
        shift[: self._body.mesh.d] = self._motion.at(moment)[:, 0]
        return shift

    def advanced(self, history: Array, u: Array, moment: Moment) -> Array:
        after = np.concatenate([self._shift_at(moment), [moment.time], history[4:]])
        if self.contact.friction is not None:
            past = after[4:].reshape(*self.areas.shape, 7)
            kernels.remember(*self._touching, after[:3], self.contact.onset, u, self.contact.friction.coefficient, past)
        return after

    @property
    def _touching(self) -> tuple[Surface, Array, kernels.ShapeNumbers]:
        return self._surface, self._weights, self._shape

    @property
    def _slips(self) -> bool:
        """Whether friction acts now: not in the state at the beginning of a step."""
        return self._now.width > 0

    @property
    def _slipped(self) -> tuple[Array, Array, float]:
        """Arguments of the kernels of friction."""
        return self._now.shift, self._now.past, self._now.width

    def energy_and_force(self, u: Array, force: Array | None = None) -> float:
        if force is not None and self._slips:
            kernels.add_friction(self._surface, *self._slipped, self._now.secants, u, self._now.factor, force)
        return super().energy_and_force(u, force)

    def add_blocks(self, u: Array, blocks: NodeBlocks, kept: Tensions = ALL) -> None:
        super().add_blocks(u, blocks, kept)
        assumed = self._now.assumed
        if self._slips and not isinstance(assumed, Assumed):
            end, factor = (u, self._now.factor) if assumed is None else (assumed[1], 2.0)
            slipped = *self._slipped, self._now.secants
            kernels.add_friction_blocks(self._own_surface, *slipped, end[self.nodes], factor, self._into(blocks))

    def mean_force(self, u0: Array, u1: Array, weights: tuple[float, float], theta: float, force: Array) -> float:
        if self._slips:
            kernels.add_friction(self._surface, *self._slipped, self._now.secants, u1, sum(weights), force)
        return super().mean_force(u0, u1, weights, theta, force)

    def missing_friction(self, u: Array) -> tuple[Array, float]:
        """Return the friction (n, 3) that points lack which slip by more than the width, and the largest of all points [N]."""
        past = self._now.past
        if self.contact.friction is None or not past[..., 4:].any():  # before the first state there is no slip
            return np.zeros((0, 3)), 0.0
        now = np.empty_like(past)
        kernels.remember(*self._touching, self._now.shift, self.contact.onset, u, self.contact.friction.coefficient, now)
        change, normals = now[..., :3] - past[..., :3], past[..., 4:]
        across = change - (change * normals).sum(axis=2, keepdims=True) * normals
        slip = np.linalg.norm(across, axis=2)
        missing = (now - past)[..., 3] / np.where(slip > self._now.width, slip, np.inf)
        return (missing[..., None] * across).reshape(-1, 3), max(now[..., 3].sum(), past[..., 3].sum())

    def drag(self, u: Array) -> Array:
        (N, t, _), drag, friction = self._surface, np.zeros(len(u)), self.contact.friction
        if friction is not None and friction.slip_speed is not None:  # the slope of f1 at zero is 2
            slopes = 2 * friction.coefficient / friction.slip_speed * self._gaps(self._surface, self._weights, u)[1]
            np.add.at(drag, t, (slopes * np.abs(N).sum(axis=1)) @ np.abs(N))
        return drag

    def _secants_at(self, u: Array, now: ShapeInStep) -> Array:
        """Return the force per slip (n, nq) [N/m] at `u` (nv, d)."""
        secants = np.zeros(self.areas.shape)
        kernels.find_secants(self._surface, now.shift, now.past, now.width, u, secants)
        return secants

    def add_round_off(self, u: Array, out: Array) -> None:
        """Add that of the normal force, and the force per slip times the displacements that the slip subtracts [N]."""
        super().add_round_off(u, out)
        if self._slips:
            N, t, _ = self._surface
            largest = np.abs(u[t]).max(axis=(1, 2)) + np.abs([*self._now.shift, *self._now.start]).max()
            rubbing = self._now.factor * self._secants_at(u, self._now) * largest[:, None]
            np.add.at(out, t, (rubbing @ np.abs(N))[:, :, None])

    def work(self, u0: Array, u1: Array) -> tuple[float, float]:
        """Return the work [J] of the moving shape on the body, and that against friction, from the last accepted state to `u1`."""
        moved, work, lost = self._now.shift - self._now.start, 0.0, 0.0
        if self._slips:
            force = np.zeros_like(u1)
            lost = float(kernels.add_friction(self._surface, *self._slipped, self._now.secants, u1, 1.0, force))
            work -= float(force.sum(axis=0) @ moved[: u1.shape[1]])
        if moved.any():
            force = np.zeros_like(u1)
            BoundRigidContact.mean_force(self, u0, u1, (0.5, 0.5), 0.5, force)
            work -= float(force.sum(axis=0) @ moved[: u1.shape[1]])
        return work, lost


def rigid(contacts: Iterable[BoundContact]) -> list[BoundRigidContact]:
    """Return the contacts with a rigid shape into which points go."""
    return [contact for contact in contacts if isinstance(contact, BoundRigidContact)]


def _areas(contact: RigidContact, body: Body, facets: NDArray[np.int32], element: Element) -> Array:
    """Return the areas (n,) of the facets at rest [m^2]."""
    mesh: Any = body.mesh
    if contact.simplices is not None:
        return sizes_of(mesh.p, facets, element)
    return body.facet_areas(facets) if mesh.k == mesh.d else body.sizes[mesh.elements(contact.where)]


def _points_of(mesh: ElementMesh, element: Element, facets: NDArray[np.int32], sizes: Array) -> tuple[Surface, Array]:
    """Return the points of facets (m, n), and their shares (n, nq) of the `sizes` (n,) of the facets."""
    spread, X = Spread(mesh, element, facets, sizes), np.ascontiguousarray(mesh.p.T)
    if element.is_linear_simplex:  # the vertices
        return Surface(np.ones((1, 1)), spread.vertices[:, None].astype(np.int32), X), spread.total[:, None]
    N = np.ascontiguousarray(element.values(rule_of(element, "mass").points))
    return Surface(N, np.ascontiguousarray(facets.T, dtype=np.int32), X), np.ascontiguousarray(spread.at_points.T)


def _default_stiffness(contact: RigidContact, body: Body, facets: NDArray[np.int32], element: Element) -> Array:
    """Return `10 E/h` (n,) [N/m^3] of the facets."""
    if contact.simplices is not None:
        raise ContactError(f"{contact.label}: stiffness = None with simplices; expected a positive number [N/m^3].")
    expected = "stiffness=... [N/m^3], such as 10 E/h of the softest body"
    E = young_of(body, elements_behind(body, contact.where, facets), contact.label, expected)
    return STIFFNESS * E / _edge_lengths(contact, body, facets, element)


def _edge_lengths(contact: RigidContact, body: Body, facets: NDArray[np.int32], element: Element) -> Array:
    """Return the mean length (n,) of the edges of each facet [m]; of ends of bars that of their elements."""
    if element.k == 0:
        return body.sizes[elements_behind(body, contact.where, facets)]
    ends = body.mesh.p[:, facets[np.array(element.edges).T]]
    return np.asarray(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=0).mean(axis=0))
