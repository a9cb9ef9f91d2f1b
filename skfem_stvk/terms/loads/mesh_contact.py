"""Contact between the surfaces of a mesh, by a barrier, with friction."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, NamedTuple, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray
from scipy.sparse import csr_matrix

from ...arguments import Array, Quantity, number, shown
from ...edges import ALL, NodeBlocks, Tensions
from ...errors import ContactError, name_ids
from ...mesh import ElementMesh
from ...mesh.diagnostics import parts
from ...mesh.facets import linked
from ...mesh.locations import Where
from ..body import Body
from .contact import BoundContact, Contact, Friction, numbers_of, refuse_missing_width, width_of
from .contact_surface import elements_behind, pieces_of, remaining_surface, surface_at, young_of
from .ipc import Barrier, Collisions
from .load import Assumed, Assumption, Moment
from .rigid_mesh import RigidMesh, winding_numbers

EPS = float(np.finfo(float).eps)
#: Points between 0 and 1 of the straight way of a step at which its force is evaluated, and their weights (Simpson's rule).
POINTS, WEIGHTS = np.array([0.0, 0.5, 1.0]), np.array([1.0, 4.0, 1.0]) / 6
#: Round-off of the sum of two energies, as a part of it.
ROUND_OFF = 4 * EPS
#: Pairs of nodes that are not in contact stay in K until they are this fraction of all.
UNUSED = 0.25


@dataclass(frozen=True, eq=False)
class MeshContact(Contact):
    """Contact of two surfaces, or of a surface with itself: a barrier at small distances, which nothing passes.

    ::

        W = sum over pairs of primitives of w b(distance)        b = 0 beyond `distance`, infinite at 0

    Primitives are triangles, edges and vertices, and `w` their areas at rest. Facets of quadratic elements count as four triangles,
    and quadrilaterals as two. In the plane, primitives are segments and vertices, and `w` lengths times the smallest thickness;
    quadratic edges count as two segments. Faces that the removal of elements exposes touch as well, unless the surface is a named
    boundary. It is for statics and implicit integrators except `LinearBackwardEuler`. It requires the IPC Toolkit: `pip install
    'skfem-stvk[contact]'`.

    Parameters
    ----------
    first
        Location of the facets of the first surface, as in `Traction`, or the name of a subdomain, for its part of the surface of
        the body; of surfaces in space a subdomain or ids. None for the whole surface.
    second
        The same for the second surface, or a `RigidMesh`. By default the first surface touches itself.
    distance
        Distance below which the surfaces repel each other [m], at most the length of the shortest edge of the body's surfaces.
    stiffness
        Stiffness of the barrier [Pa]: by default the smallest Young's modulus of the elements behind the facets.
    friction
        `Friction` between the surfaces; by default none.
    name
        Name in results, ledgers and messages.

    Raises
    ------
    ContactError
        if a value is not positive. When it is bound: if the mesh has 1 dimension or another one than the `RigidMesh`, the surfaces
        share nodes, intersect or lie inside each other at rest, the distance is larger than the shortest edge, a law has no Young's
        modulus and `stiffness` is None, or the toolkit is not installed.
    RegionError
        when it is bound, if there is no facet.

    Notes
    -----
    Source: IPC Toolkit, see `skfem_stvk.terms.loads.ipc`.

    Examples
    --------
    >>> import numpy as np, skfem
    >>> from skfem_stvk import StVK, System
    >>> cubes = skfem.MeshTet() + skfem.MeshTet().translated((0.2, 0.1, 1.05))         # 5 cm apart
    >>> cubes = cubes.with_subdomains({"lower": lambda x: x[2] < 1, "upper": lambda x: x[2] > 1})
    >>> pair = System(cubes, [StVK(young=1e5, poisson=0.3), MeshContact("lower", "upper", distance=0.1)])
    >>> force = pair.internal_force(np.zeros(pair.ndofs)).reshape(-1, 3)
    >>> bool(force[cubes.p[2] < 1.04, 2].sum() > 100), bool(abs(force.sum(axis=0)).max() < 1e-9)
    (True, True)
    """

    between_parts: ClassVar[bool] = True
    unit = "Pa"

    first: Annotated[Where | None, Quantity(None, "Place of the facets of the first surface; None for all.")]
    second: Annotated[
        Where | RigidMesh | None, Quantity(None, "Place of the facets of the second surface, or a rigid one; by default the first.")
    ] = None
    distance: Annotated[float, Quantity("length", "Distance below which the surfaces repel each other.", gt=0)] = field(
        kw_only=True
    )
    stiffness: Annotated[float | None, Quantity("stress", "Stiffness of the barrier; by default Young's modulus.", gt=0)] = field(
        default=None, kw_only=True
    )
    friction: Annotated[Friction | None, Quantity(None, "Friction between the surfaces.")] = field(default=None, kw_only=True)
    name: Annotated[str, Quantity(None, "Name in results and messages.")] = field(default="contact", kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        distance = number(f"{self.label}: distance", self.distance, "a positive distance [m]", 0.0, error=ContactError)
        object.__setattr__(self, "distance", distance)

    def bind(self, body: Body | ElementMesh, dtype: DTypeLike = np.float64) -> BoundMeshContact:
        body = body if isinstance(body, Body) else Body(body, [])
        d = body.mesh.d
        if d == 1:
            raise ContactError(f"{self.label}: the mesh has 1 dimension; expected 2 or 3.")
        if isinstance(self.second, RigidMesh) and self.second.d != d:
            raise ContactError(f"{self.label}: its RigidMesh has {self.second.d} components; expected {d}, as the mesh.")
        return (BoundMeshContact if self.friction is None else MeshContactWithFriction)(self, body)


class Mean(NamedTuple):
    """Mean force on the straight way between two states.

    Attributes
    ----------
    x0, x1
        (m, d) positions at both ends [m].
    force
        (m, d) sum of the `weights` times the forces at the `POINTS` [N].
    weights
        (n,) weights with which the work of the force is the change of the energy.
    states
        Collisions at the points.
    error
        Relative error of the force by round-off of the energies to which it is scaled.
    """

    x0: Array
    x1: Array
    force: Array
    weights: Array
    states: list[Collisions]
    error: float


class ContactBlocks(NamedTuple):
    """Blocks of the stiffness of a contact.

    Attributes
    ----------
    keys
        (n,) numbers `a nv + b` of the pairs of nodes `a < b`, ascending.
    pairs
        (n, d, d) blocks `K_ab` of these pairs [N/m].
    own
        (m, d, d) blocks `K_aa` of the m nodes of the surface, if the contact is not balanced.
    """

    keys: NDArray[np.int64]
    pairs: Array
    own: Array | None


class CoupledPairs:
    """Pairs of nodes in K, which change as surfaces meet and part: the pattern of K belongs to an analysis, not to a state.

    Attributes
    ----------
    keys
        (n,) numbers `a nv + b` of the pairs `a < b`, ascending.
    version
        Number of changes, also before a copy: bodies that share a pattern of K tell by it whether the pattern is theirs.
    grow
        Whether pairs remain that are not in contact any more, as in an analysis; otherwise the pairs are those of the last K.
    """

    def __init__(self, grow: bool = False, keys: NDArray[np.int64] | None = None, version: int = 0) -> None:
        self.keys = np.empty(0, dtype=np.int64) if keys is None else keys
        self.version, self.grow = version, grow

    def use(self, keys: NDArray[np.int64]) -> None:
        """Couple the pairs with these keys."""
        if not np.array_equal(keys, self.keys):
            self.keys, self.version = keys, self.version + 1


class LastResults:
    """Results of the last calls, which calls at the same state use again. Copies and pickles have none of these objects.

    Attributes
    ----------
    collisions, mean
        Collisions at a state, and the mean force between two.
    rubbing
        History of a step, and the collisions that rub.
    blocks
        Key, history of the step, displacements of the nodes, and blocks.
    """

    def __init__(self) -> None:
        self.collisions: Collisions | None = None
        self.mean: Mean | None = None
        self.rubbing: tuple[Array, Any] | None = None
        self.blocks: tuple[Any, Array | None, tuple[Array, ...], ContactBlocks] | None = None

    def __reduce__(self) -> tuple[type[LastResults], tuple[()]]:
        return LastResults, ()


class SurfacesInStep(NamedTuple):
    """State of a contact within a step.

    Attributes
    ----------
    assumed
        Assumption of the stiffness.
    width
        Slip up to which friction rises [m]; 0 if there is none, as in the state at the beginning of the step.
    factor
        Factor of friction.
    history
        History at the beginning of the step.
    """

    assumed: Assumption = None
    width: float = 0.0
    factor: float = 1.0
    history: Array | None = None


Own = TypeVar("Own", bound="BoundMeshContact")


class BoundMeshContact(BoundContact):
    """Contact between surfaces of a body, or with a rigid one, whose vertices follow those of the body in positions (m, d).

    It joins no nodes, and couples those of the collisions at the present state.

    The history is the time of the beginning of the step, the number of pairs of nodes in K, and the pairs. In an analysis they
    grow, so that the pattern of K changes seldom; elsewhere K has the pairs of its state alone. With friction the displacements
    (nv, d) at the beginning of the step follow.

    Attributes
    ----------
    contact, name, distance
        Specification, its name and its distance.
    balanced
        Whether the forces on the body add up to zero: with a rigid surface they do not.
    nodes
        Nodes (n,) of the first of two surfaces, on which the resultant of the contact acts, otherwise of the whole surface.
    """

    is_barrier = removable = has_history = pairs_change = True

    def __init__(self, contact: MeshContact, body: Body) -> None:
        self.contact, self.name, self._body = contact, contact.name, body
        self.distance = contact.distance
        self._now, self._pairs, self._last = SurfacesInStep(), CoupledPairs(), LastResults()
        self._d, self._rigid = body.mesh.d, contact.second if isinstance(contact.second, RigidMesh) else None
        self.balanced = self._rigid is None
        one = contact.second is None or not self.balanced
        self._wheres = (contact.first,) if one else (contact.first, contact.second)
        self._facets = [surface_at(body, where, contact.label)[0] for where in self._wheres]
        self._behind = [elements_behind(body, where, facets) for where, facets in zip(self._wheres, self._facets, strict=True)]
        behind, expected = np.concatenate(self._behind), "stiffness=... [Pa], such as that of the softest body"
        self._stiffness = contact.stiffness or float(young_of(body, behind, contact.label, expected).min())
        self._thickness = float(body.section[behind].min()) if body.mesh.k == self._d == 2 else 1.0
        if self._rigid is not None:
            ends = body.mesh.p.T[pieces_of(self._facets[0], self._d)]
            mean = np.linalg.norm(ends - np.roll(ends, 1, axis=1), axis=2).mean()
            self._rigid_points, self._rigid_simplices = self._rigid.refined(float(mean))
        self._set_surface(body)
        self._refuse_long_distance()
        self.refuse_start(np.zeros((self._nv, self._d)))

    def _set_surface(self, body: Body) -> None:
        """Use the surface of the elements of a body that are not removed."""
        of = zip(self._wheres, self._facets, self._behind, strict=True)
        kept = [remaining_surface(body, where, facets, behind)[0] for where, facets, behind in of]
        nodes = [np.unique(facets) for facets in kept]  # a vertex of no triangle would be a point that touches
        self._nodes, self.nodes, patches = np.unique(np.concatenate(nodes)), nodes[0].astype(np.int32), None
        if len(nodes) == 2:
            both = np.intersect1d(nodes[0], nodes[1])
            if len(both):
                raise ContactError(
                    f"{self.contact.label}: {name_ids(both, 'node')} in both surfaces; expected surfaces without common nodes, or "
                    "one name for contact of a surface with itself."
                )
            patches = np.isin(self._nodes, nodes[1]).astype(np.int32)
        self._X, n = body.mesh.p.T[self._nodes], len(self._nodes)
        simplices: list[NDArray[Any]] = [np.searchsorted(self._nodes, pieces_of(facets, self._d)) for facets in kept]
        if self._rigid is not None:
            self._X = np.vstack([self._X, self._rigid_points])
            simplices.append(self._rigid_simplices + n)
            patches = (np.arange(len(self._X)) >= n).astype(np.int32)
        modulus = self._stiffness * self._thickness
        self._barrier = Barrier(self._X, np.concatenate(simplices).astype(np.int32), patches, self.contact.distance, modulus)
        self._nv = body.mesh.nv

    def _refuse_long_distance(self) -> None:
        """Raise ContactError if the distance is larger than the shortest edge: neighbours of a primitive would repel it."""
        edges = self._barrier.edges[(self._barrier.edges < len(self._nodes)).all(axis=1)]
        ends = self._X[edges]
        lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        if self.contact.distance > lengths.min():
            a, b = self._nodes[edges[lengths.argmin()]]
            raise ContactError(
                f"{self.contact.label}: distance = {self.contact.distance:.4g} m; expected at most the shortest edge of the "
                f"surfaces, {lengths.min():.4g} m between nodes {a} and {b}. A tenth of the usual edge is a good choice."
            )

    def refuse_start(self, u: Array) -> None:
        """Raise ContactError if surfaces at `u` (nv, d) intersect, or one lies inside the other body."""
        x = self._moved(u)
        crossing = self._barrier.intersections(x)
        if crossing:
            edge, other = (self._named(vertices) for vertices in crossing[0])
            raise ContactError(
                f"{self.contact.label}: {len(crossing)} {'edges and triangles' if self._d == 3 else 'pairs of edges'} intersect at "
                f"the start, first the edge of {edge} and the {'triangle' if self._d == 3 else 'edge'} of {other}; expected "
                "surfaces apart. Move the bodies, or mesh them again."
            )
        positions = self._body.mesh.p.T + u
        if len(within := self._rigid_inside(positions)):
            raise ContactError(
                f"{self.contact.label}: the RigidMesh at {tuple(within[0].round(6).tolist())} inside the body at the start; "
                "expected it outside. Move the body or the surface."
            )
        inside = self._inside(positions)
        if len(inside):
            other = "another part of the body" if self._rigid is None else "the RigidMesh"
            turn = "" if self._rigid is None else ", or reverse the order of the vertices if the body belongs on this side"
            raise ContactError(
                f"{self.contact.label}: {name_ids(inside, 'node')} inside {other} at the start; expected them outside. Move the "
                f"body{turn}."
            )

    def _named(self, vertices: NDArray[np.int32]) -> str:
        """Return the nodes of a primitive, or the points of the RigidMesh, in words."""
        n = len(self._nodes)
        if vertices[0] < n:
            return f"nodes {tuple(self._nodes[vertices].tolist())}"
        return f"the RigidMesh from {tuple(self._X[vertices[0]].round(6).tolist())}"

    def _rigid_inside(self, p: Array) -> Array:
        """Return points (n, d), one of each part of the RigidMesh at most, inside the elements with nodes at `p` (nv, d)."""
        mesh = self._body.mesh
        if self._rigid is None or mesh.k < self._d:
            return np.empty((0, self._d))
        ends = self._rigid_simplices[:, 1:]
        part = linked(self._rigid_simplices[:, :1].repeat(ends.shape[1], axis=1).ravel(), ends.ravel(), len(self._rigid_points))
        probes = self._rigid_points[np.unique(part, return_index=True)[1]]
        return probes[np.abs(winding_numbers(probes, p[pieces_of(mesh.surface, self._d)])) > 0.5]

    def _inside(self, p: Array) -> NDArray[np.int64]:
        """Return nodes, one of each part of the surfaces at most, that are inside the elements of another part."""
        mesh = self._body.mesh
        part = parts([mesh])
        numbers, first = np.unique(part[self._nodes], return_index=True)
        probes = self._nodes[first]
        inside = np.zeros(len(probes), dtype=bool)
        if self._rigid is not None:
            inside |= self._rigid.closed and self._rigid.behind(p[probes])
        elif mesh.k == self._d:
            sides = pieces_of(mesh.surface, self._d)
            for number_of_part in np.unique(part[sides[:, 0]]) if len(numbers) > 1 else ():
                around = winding_numbers(p[probes], p[sides[part[sides[:, 0]] == number_of_part]])
                inside |= (np.abs(around) > 0.5) & (numbers != number_of_part)
        return probes[inside].astype(np.int64)

    @property
    def nodes_paired(self) -> NDArray[np.int32]:
        """Pairs of nodes `a < b` (2, n) in K at present."""
        return np.stack(np.divmod(self._pairs.keys, self._nv)).astype(np.int32)

    @property
    def pattern_version(self) -> int:  # type: ignore[override]
        """Number of changes of the pairs."""
        return self._pairs.version

    def _moved(self, u: Array) -> Array:
        """Return the positions (m, d) of all vertices for displacements `u` (nv, d)."""
        x = self._X.copy()
        x[: len(self._nodes)] += u[self._nodes]
        return x

    def _on_body(self, force: Array) -> Array:
        """Return the rows (n, d) of the vertices of the body."""
        return force[: len(self._nodes)]

    def _collisions(self, x: Array) -> Collisions:
        """Return the collisions at `x` (m, d), those of the last call if nothing has moved."""
        found = self._last.collisions
        if found is None or not np.array_equal(found.x, x):
            self._last.collisions = found = self._barrier.collisions(x)
        return found

    def look(self, u: Array) -> None:
        if self._now.assumed is Assumed.APART:
            return
        keys, pairs = self._blocks_at(u, clamped=False).keys, self._pairs
        if not pairs.grow:
            pairs.use(keys)
        elif not np.isin(keys, pairs.keys, assume_unique=True).all():
            pairs.use(np.union1d(pairs.keys, keys))

    def _sorted_blocks(self, K: csr_matrix) -> ContactBlocks:
        """Return the blocks of a symmetric matrix over the vertices, without those of a rigid surface."""
        n, d = len(self._nodes), self._d
        if not self.balanced:
            K = K[: n * d, : n * d]
        blocks = K.T.tobsr((d, d))
        blocks.sort_indices()  # SciPy lists blocks by their first entry, and K has no entries that are zero
        row = np.repeat(np.arange(n), np.diff(blocks.indptr))
        column, own = blocks.indices, None
        if not self.balanced:
            own, same = np.zeros((n, d, d)), row == column
            own[row[same]] = blocks.data[same]
        upper = row < column
        keys = self._nodes[row[upper]].astype(np.int64) * self._nv + self._nodes[column[upper]]
        return ContactBlocks(keys, blocks.data[upper], own)

    def _blocks_at(self, u: Array, clamped: bool) -> ContactBlocks:
        """Return the blocks at `u`, or those of the mean force if that is assumed; computed once."""
        states = self._now.assumed if isinstance(self._now.assumed, tuple) else (u,)
        own, now, last = tuple(state[self._nodes] for state in states), self._now, self._last.blocks
        key = clamped, len(states), now.width, now.factor
        if last is None or last[0] != key or last[1] is not now.history or not np.array_equal(last[2], own):
            self._last.blocks = last = key, now.history, own, self._sorted_blocks(self._stiffness_at(states, clamped))
        return last[3]

    def _stiffness_at(self, states: tuple[Array, ...], clamped: bool) -> csr_matrix:
        """Return the stiffness (d m, d m) at a state, or twice the derivative of the mean force between two by the second one."""
        xs = tuple(self._moved(state) for state in states)
        if len(xs) == 1:
            return self._barrier.stiffness(self._collisions(xs[0]), clamped)
        mean = self._mean(*xs)
        parts = [(2 * s * w, state) for s, w, state in zip(POINTS, mean.weights, mean.states, strict=True) if s]
        first, *others = [factor * self._barrier.stiffness(state, clamped) for factor, state in parts]
        return sum(others, first)

    def energy_and_force(self, u: Array, force: Array | None = None) -> float:
        at = self._collisions(self._moved(u))
        if force is not None:
            force[self._nodes] += self._on_body(self._barrier.force(at))
        return self._barrier.energy(at)

    def add_blocks(self, u: Array, blocks: NodeBlocks, kept: Tensions = ALL) -> None:
        """Add the blocks of K [N/m] at `u` (nv, d), or under the assumption; `look` must have been called for it."""
        if self._now.assumed is not Assumed.APART:
            found = self._blocks_at(u, clamped=kept.negative < 1 and not isinstance(self._now.assumed, tuple))
            blocks.pairs[np.searchsorted(self._pairs.keys, found.keys)] += found.pairs
            if found.own is not None and blocks.own is not None:
                blocks.own[:] += found.own

    def add_round_off(self, u: Array, out: Array) -> None:
        at = self._collisions(self._moved(u))
        K = self._barrier.stiffness(at, clamped=False)
        sums = (abs(K) @ np.abs(at.x).ravel()).reshape(-1, self._d) + np.abs(self._barrier.force(at))
        if isinstance(self._now.assumed, tuple):
            mean = self._mean(*(self._moved(state) for state in self._now.assumed))
            sums += 2 * mean.error / EPS * np.abs(mean.force)
        out[self._nodes] += self._on_body(sums)

    def mean_force(self, u0: Array, u1: Array, weights: tuple[float, float], theta: float, force: Array) -> float:
        """Add the sum of the `weights` times the mean force on the straight way, whose work is `W(u1) - W(u0)`; return 0."""
        force[self._nodes] += sum(weights) * self._on_body(self._mean(self._moved(u0), self._moved(u1)).force)
        return 0.0

    def _mean(self, x0: Array, x1: Array) -> Mean:
        """Return the mean force from `x0` to `x1` (m, d), that of the last call if the states are the same.

        The weights of the points are changed by least squares until the work is that of the energy. With `g_k = F_k . (x1 - x0)`,
        they are `w_k (1 + b g_k)` and `b = (W1 - W0 - sum w_k g_k) / sum w_k g_k^2`. A change of the weights is at most 1, and
        round-off of the energies changes none.
        """
        last, barrier = self._last.mean, self._barrier
        if last is not None and np.array_equal(last.x1, x1) and np.array_equal(last.x0, x0):
            return last
        first = self._collisions(x0) if last is None or not np.array_equal(last.x0, x0) else last.states[0]
        states = [first, *barrier.collisions_along(x0, x1, POINTS[1:])]
        self._last.collisions = states[-1]
        forces = np.array([barrier.force(state) for state in states])
        works, energies = np.tensordot(forces, x1 - x0), (barrier.energy(states[0]), barrier.energy(states[-1]))
        missing, square, weights, error = energies[1] - energies[0] - WEIGHTS @ works, WEIGHTS @ works**2, WEIGHTS, 0.0
        of_positions = EPS * float((np.abs(np.tensordot(WEIGHTS, forces, 1)) * np.abs(x1)).sum())
        round_off = ROUND_OFF * sum(energies) + of_positions
        if square > 0 and abs(missing) > round_off:
            missing -= np.sign(missing) * round_off
            weights = WEIGHTS * (1 + np.clip(missing / square * works, -1.0, 1.0))
            error = round_off / np.sqrt(square)
        self._last.mean = mean = Mean(x0, x1, np.tensordot(weights, forces, 1), weights, states, error)
        return mean

    def contact_limit(self, u: Array, v: Array) -> float:
        """Return the largest `s <= 2` up to which nothing passes through anything on the way `u + s v`."""
        x, y = self._moved(u), self._moved(u + 2 * v)
        if 2 * np.linalg.norm(y - x, axis=1).max() < self._barrier.smallest_distance(self._collisions(x)):
            return 2.0  # too short a way to meet
        return 2 * self._barrier.limit(x, y)

    def passes(self, u0: Array, u1: Array) -> bool:
        """Return whether something passes through something on the straight way from `u0` to `u1` (nv, d)."""
        return self._barrier.limit(self._moved(u0), self._moved(u1)) < 1

    def identity(self) -> list[float]:
        return [
            self.contact.distance,
            self._stiffness,
            *numbers_of(self.contact.friction),
            len(self._nodes),
            float(self._barrier.areas().sum()),
            *self._X[len(self._nodes) :].ravel().tolist(),
        ]

    def held_directions(self, u: Array) -> tuple[NDArray[np.int64], Array]:
        """Return nodes (n,) that a rigid surface repels at `u` (nv, d), and the directions (n, d) of the forces.

        Parts of a body hold each other, but not to the ground.
        """
        if self._rigid is None:
            return np.empty(0, dtype=np.int64), np.empty((0, self._d))
        force = self._on_body(self._barrier.force(self._collisions(self._moved(u))))
        sizes = np.linalg.norm(force, axis=1)
        held = sizes > 0
        return self._nodes[held].astype(np.int64), -force[held] / sizes[held, None]

    def evaluated(self, u: Array) -> tuple[Array, Array, float]:
        at, areas = self._collisions(self._moved(u)), self._thickness * self._on_body(self._barrier.areas())
        forces = np.linalg.norm(self._on_body(self._barrier.force(at)), axis=1)
        pressure, gap = np.zeros(self._nv), np.full(self._nv, np.inf)
        pressure[self._nodes] = np.divide(forces, areas, out=np.zeros(len(areas)), where=areas > 0)
        gap[self._nodes] = self._on_body(self._barrier.smallest_distances(at))
        return pressure, gap, float(areas[forces > 0].sum())

    def at(self: Own, moment: Moment, history: Array | None) -> Own:
        return self if moment.contact is None else self._with(_now=SurfacesInStep(moment.contact))

    def for_analysis(self: Own, in_time: bool) -> Own:
        """Return the contact with pairs of nodes in K, and results, of its own: several analyses may run at once."""
        pairs = CoupledPairs(grow=True, version=self._pairs.version + (len(self._pairs.keys) > 0))
        return self._with(_pairs=pairs, _last=LastResults())

    def first_history(self) -> Array:
        return np.zeros(2)

    def advanced(self, history: Array, u: Array, moment: Moment) -> Array:
        """Return the history of a step from `u` (nv, d). If too many pairs are not in contact any more, K leaves them out."""
        touching, pairs = self._collisions(self._moved(u)), self._pairs
        keys = self._sorted_blocks(self._barrier.stiffness(touching, clamped=False)).keys
        if len(keys) < (1 - UNUSED) * len(pairs.keys):
            pairs.use(keys)
        return np.concatenate([[moment.time, len(pairs.keys)], pairs.keys])

    def after_step(self, history: Array) -> Array:
        """Return the history with the pairs that K has by now."""
        start, keys = history[2 + int(history[1]) :], self._pairs.keys
        return np.concatenate([history[:1], [len(keys)], keys, start])

    def return_to(self, history: Array) -> None:
        """Let K couple the pairs of a history."""
        count = int(history[1]) if len(history) > 1 and np.isfinite(history).all() else -1
        keys, start = history[2 : 2 + count].astype(np.int64), history[2 + count :]
        right = count >= 0 and len(keys) == count and (np.diff(keys) > 0).all() and len(start) in (0, self._nv * self._d)
        if not right or (keys < 0).any() or (keys >= self._nv**2).any():
            raise ValueError(
                f"the history of {self.contact.label} is {shown(history)}; expected a time, pairs of nodes and displacements"
            )
        self._pairs.use(keys)

    def without(self, removed: NDArray[np.bool_]) -> BoundMeshContact:
        """Return the contact without the facets whose elements are removed, `removed` (nt,), and with the faces that these expose,
        unless the surface is a boundary.
        """
        version = self._pairs.version + (not self.balanced)  # K has blocks for other nodes
        other = self._with(_pairs=CoupledPairs(self._pairs.grow, self._pairs.keys, version), _last=LastResults())
        other._set_surface(self._body.without(removed, self._body.bare))
        return other

    def memory(self) -> dict[str, int]:
        """Return the bytes of its arrays, by part, without those of the toolkit."""
        arrays = self._X, self._nodes, self._pairs.keys, self._barrier.edges, self._barrier.triangles, *self._facets, *self._behind
        return {"contact": sum(array.nbytes for array in arrays)}


class MeshContactWithFriction(BoundMeshContact):
    """Contact between surfaces that rub, with the normal forces and the tangents of the beginning of each step."""

    has_friction = does_work = True

    def for_analysis(self, in_time: bool) -> MeshContactWithFriction:
        refuse_missing_width(self._friction, in_time, self.contact.label)
        return super().for_analysis(in_time)

    @property
    def _friction(self) -> Friction:
        assert self.contact.friction is not None
        return self.contact.friction

    def at(self, moment: Moment, history: Array | None) -> MeshContactWithFriction:
        step = moment.step
        if history is None or step is None:
            return super().at(moment, history)
        width = width_of(self._friction, moment.time - float(history[0]), step.in_time)
        return self._with(_now=SurfacesInStep(moment.contact, width, step.friction, history))

    def advanced(self, history: Array, u: Array, moment: Moment) -> Array:
        return np.concatenate([super().advanced(history, u, moment), u.ravel()])

    @property
    def _start(self) -> Array | None:
        """Displacements (nv, d) at the beginning of the step [m]; None before the first step."""
        history = self._now.history
        start = np.empty(0) if history is None else history[2 + int(history[1]) :]
        return start.reshape(-1, self._d) if len(start) else None

    def _slip(self, u: Array) -> tuple[Any, Array, float] | None:
        """Return the arguments of friction at `u` (nv, d); None in the state at the beginning of a step, where it is zero.

        The slip is a difference of displacements: positions far from the origin would leave their rounding in it.
        """
        start, history, last = self._start, self._now.history, self._last
        if start is None or history is None or not self._now.width > 0:
            return None
        if last.rubbing is None or last.rubbing[0] is not history:
            touching = self._collisions(self._moved(start))
            last.rubbing = history, self._barrier.rubbing(touching, self._friction.coefficient)
        slip = np.zeros_like(self._X)
        slip[: len(self._nodes)] = (u - start)[self._nodes]
        return last.rubbing[1], slip, self._now.width

    def _friction_at(self, u: Array) -> Array:
        """Return the friction (n, d) [N] on the body, as an internal force."""
        slip = self._slip(u)
        return np.zeros((len(self._nodes), self._d)) if slip is None else self._on_body(self._barrier.friction(*slip))

    def energy_and_force(self, u: Array, force: Array | None = None) -> float:
        if force is not None:
            force[self._nodes] += self._now.factor * self._friction_at(u)
        return super().energy_and_force(u, force)

    def mean_force(self, u0: Array, u1: Array, weights: tuple[float, float], theta: float, force: Array) -> float:
        force[self._nodes] += sum(weights) * self._friction_at(u1)
        return super().mean_force(u0, u1, weights, theta, force)

    def _stiffness_at(self, states: tuple[Array, ...], clamped: bool) -> csr_matrix:
        K, slip = super()._stiffness_at(states, clamped), self._slip(states[-1])
        factor = self._now.factor if len(states) == 1 else 2.0
        return K if slip is None else K + factor * self._barrier.friction_stiffness(*slip)

    def add_round_off(self, u: Array, out: Array) -> None:
        """Add that of the barrier, and the stiffness of friction times the displacements that the slip subtracts [N]."""
        super().add_round_off(u, out)
        slip = self._slip(u)
        if slip is not None:
            largest = np.full(self._X.size, np.abs(u[self._nodes]).max())
            rubbing = self._now.factor * (abs(self._barrier.friction_stiffness(*slip)) @ largest)
            out[self._nodes] += self._on_body(rubbing.reshape(-1, self._d))

    def missing_friction(self, u: Array) -> tuple[Array, float]:
        """Return the friction (n, d) that the nodes of the first surface lack, and the largest friction there [N]."""
        x, slip, start = self._moved(u), self._slip(u), self._start
        if slip is None or start is None:
            return np.zeros((0, self._d)), 0.0
        barrier, coefficient, at = self._barrier, self._friction.coefficient, self._collisions(x)
        on_first, states = np.isin(self._nodes, self.nodes), (at, self._collisions(self._moved(start)))
        used, present = (
            self._on_body(barrier.friction(one, *slip[1:]))[on_first] for one in (slip[0], barrier.rubbing(at, coefficient))
        )
        normal = max(np.linalg.norm(self._on_body(barrier.force(state))[on_first], axis=1).sum() for state in states)
        return present - used, coefficient * normal

    def work(self, u0: Array, u1: Array) -> tuple[float, float]:
        """Return no external work, and the work [J] against friction from the last accepted state to `u1`."""
        start = self._start
        return 0.0, 0.0 if start is None else float((self._friction_at(u1) * (u1 - start)[self._nodes]).sum())
