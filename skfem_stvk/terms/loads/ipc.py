"""The IPC Toolkit: barriers between triangles or segments, their friction, and steps up to which nothing passes through anything.

Nothing else imports `ipctk`, which the extra `contact` installs.
"""

from __future__ import annotations

from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, version
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ...arguments import Array
from ...errors import ContactError

#: Versions of the toolkit that were tried: the first one, and the first one that was not.
FIRST, BEYOND = (1, 6, 1), (1, 7)
INSTALL = "pip install 'skfem-stvk[contact]'"
#: Fraction of the distance between two primitives after which continuous collision detection counts them as in contact.
RESCALING = 0.999
#: Most iterations of the detection for two primitives; then the part of the way up to there is free. Primitives that are very close
#: and move far along each other would take up to 1e7 iterations, minutes in all.
DETECTING = 10_000
#: Stretch of the longest edge beyond which the search for collisions does not use a grid: its cells in a triangle fill the memory.
STRETCHED = 4.0
#: Part of the distance that vertices may move until the next search.
MARGIN = 0.25


class Collisions(NamedTuple):
    """Pairs of primitives closer than the distance of a barrier.

    Attributes
    ----------
    x
        (m, d) positions of the vertices [m].
    found
        The collisions as the toolkit has them.
    """

    x: Array
    found: Any


class Barrier:
    """Barrier between triangles on vertices `X` (m, 3): its energy per area is that of a material of modulus `stiffness` [Pa].

    It acts at distances below `distance` [m], and becomes infinite at zero. Positions `x` are (m, d). In two dimensions it is
    between segments, all forces are per thickness [N/m], and areas are lengths.

    Parameters
    ----------
    X
        (m, d) vertices at rest [m], which determine the areas.
    simplices
        (n, d) vertices of the triangles or segments.
    patches
        (m,) numbers of surfaces, of which only different ones touch; None if the surface also touches itself.

    Notes
    -----
    Source: IPC Toolkit (Ferguson et al. 2020), after Li et al. (2020), with area weights and the improved maximum approximation
    (Li et al. 2023). Of the other sets of collisions, the default one gives a tangential force on sheets that do not match, and the
    energy of the offset one (OGC) jumps where a corner slides over an edge.
    """

    def __init__(
        self, X: Array, simplices: NDArray[np.int32], patches: NDArray[np.int32] | None, distance: float, stiffness: float
    ) -> None:
        self._toolkit = ipctk = _toolkit()
        self._made_of = X, simplices, patches, distance, stiffness
        self.distance, self._d = distance, X.shape[1]
        flat = self._d == 2
        self.triangles = triangles = np.empty((0, 3), dtype=np.int32) if flat else simplices
        self.edges = simplices if flat else ipctk.edges(triangles)
        self._mesh = ipctk.CollisionMesh(*map(np.asfortranarray, (X, self.edges, triangles)))
        if patches is not None:
            self._mesh.can_collide = ipctk.make_vertex_patches_filter(patches)
        self._potential = ipctk.BarrierPotential(distance, stiffness, use_physical_barrier=True)
        self._detection = ipctk.AdditiveCCD(max_iterations=DETECTING, conservative_rescaling=RESCALING)
        self._longest = STRETCHED * self._longest_edge(X)
        #: Positions at both ends of the way of the last search, whether they were far-stretched, and the pairs that it found.
        self._near: tuple[Array, Array, bool, Any] | None = None

    def __reduce__(self) -> tuple[type[Barrier], tuple[Any, ...]]:
        return Barrier, self._made_of  # objects of the toolkit cannot be pickled

    def collisions(self, x: Array) -> Collisions:
        """Return the collisions at `x`. They depend on nothing else."""
        return self.collisions_along(x, x, (0.0,))[0]

    def collisions_along(self, x0: Array, x1: Array, points: Iterable[float]) -> list[Collisions]:
        """Return the collisions at `x0 + s (x1 - x0)` for each of the points `s` between 0 and 1, from one search."""
        pairs = self._near_pairs(x0, x1)
        return [self._among(pairs, np.asfortranarray((1 - s) * x0 + s * x1)) for s in points]

    def _among(self, pairs: Any, x: Array) -> Collisions:
        """Return the collisions at `x` among pairs of primitives."""
        found = self._toolkit.NormalCollisions()
        found.use_area_weighting = True
        found.collision_set_type = self._toolkit.NormalCollisions.CollisionSetType.IMPROVED_MAX_APPROX
        found.build(pairs, self._mesh, x, self.distance)
        return Collisions(x, found)

    def _near_pairs(self, x0: Array, x1: Array) -> Any:
        """Return all pairs of primitives closer than the distance on the straight way from `x0` to `x1`, and more.

        Their order depends on their ids alone. A search lists pairs up to the distance and twice the `MARGIN`. They serve until a
        vertex at an end of the way has moved by the margin. A search takes three times as long as the collisions among its pairs,
        whose bits do not depend on where it was made.
        """
        near, far = self._near, not all(self._longest_edge(x) <= self._longest for x in (x0, x1))
        limit = (MARGIN * self.distance) ** 2
        ends = [] if near is None or near[2] != far else [(x0, near[0]), (x1, near[1])]
        if near is None or not ends or not all(np.square(x - then).sum(axis=1).max() < limit for x, then in ends):
            self._near = near = x0.copy(), x1.copy(), far, self._search(x0, x1, far)
        return near[3]

    def _search(self, x0: Array, x1: Array, far: bool) -> Any:
        """Return the pairs for `_near_pairs`; `far` says that an edge is far-stretched."""
        pairs, (start, end) = self._toolkit.Candidates(), map(np.asfortranarray, (x0, x1))
        # LBVH takes half the time, but lists pairs of edges in either order. ipctk 1.6.1 then merges different types of nearly
        # parallel pairs, and the energy changes by 1e-3 when the body is turned.
        # HashGrid fills the memory for a far-stretched body. SweepAndPrune finds the same pairs, in twice the time.
        search = self._toolkit.SweepAndPrune() if far else self._toolkit.HashGrid()
        pairs.build(self._mesh, start, end, (0.5 + MARGIN) * self.distance, broad_phase=search)
        return pairs

    def _longest_edge(self, x: Array) -> float:
        ends = x[self.edges]
        return float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).max(initial=0.0))

    def energy(self, at: Collisions) -> float:
        """Return the energy [J]."""
        return float(self._potential(at.found, self._mesh, at.x))

    def force(self, at: Collisions) -> Array:
        """Return the derivative (m, d) of the energy by the positions [N]."""
        return self._potential.gradient(at.found, self._mesh, at.x).reshape(-1, self._d)

    def stiffness(self, at: Collisions, clamped: bool) -> csr_matrix:
        """Return the second derivative (d m, d m) [N/m], or that with positive semi-definite blocks of the collisions."""
        return self._potential.hessian(at.found, self._mesh, at.x, self._projection(clamped))

    def rubbing(self, at: Collisions, coefficient: float) -> Any:
        """Return the collisions with the normal forces and tangents of this state, for friction with this coefficient."""
        found = self._toolkit.TangentialCollisions()
        found.build(self._mesh, at.x, at.found, self._potential, coefficient)
        return found

    def friction(self, rubbing: Any, slip: Array, width: float) -> Array:
        """Return the friction (m, d) [N] for displacements `slip` (m, d), as an internal force; it rises up to slips of `width`."""
        potential = self._toolkit.FrictionPotential(width)
        return potential.gradient(rubbing, self._mesh, np.asfortranarray(slip)).reshape(-1, self._d)

    def friction_stiffness(self, rubbing: Any, slip: Array, width: float) -> csr_matrix:
        """Return the derivative (d m, d m) of the friction by `slip` [N/m]."""
        potential = self._toolkit.FrictionPotential(width)
        return potential.hessian(rubbing, self._mesh, np.asfortranarray(slip), self._projection(False))

    def limit(self, x: Array, y: Array) -> float:
        """Return the fraction of the straight way from `x` to `y` before anything passes through anything; 1 if nothing does."""
        x, y = np.asfortranarray(x), np.asfortranarray(y)
        search = self._toolkit.LBVH()
        return float(self._toolkit.compute_collision_free_stepsize(self._mesh, x, y, 0.0, search, self._detection))

    def smallest_distance(self, at: Collisions) -> float:
        """Return a distance [m] below which no two primitives are, at most that of the barrier."""
        return min(float(np.sqrt(at.found.compute_minimum_distance(self._mesh, at.x))), self.distance)

    def smallest_distances(self, at: Collisions) -> Array:
        """Return the smallest distance (m,) of each vertex's primitives in the collisions [m]; infinity where there are none."""
        smallest = np.full(len(at.x), np.inf)
        for i in range(len(at.found)):
            collision = at.found[i]
            corners = [v for v in collision.vertex_ids(self.edges, self.triangles) if v >= 0]
            squared = collision.compute_distance(at.x[corners].ravel())
            smallest[corners] = np.minimum(smallest[corners], np.sqrt(squared))
        return smallest

    def areas(self) -> Array:
        """Return the areas (m,) at rest of the vertices [m^2]."""
        return np.asarray(self._mesh.vertex_areas)

    def intersections(self, x: Array) -> list[tuple[NDArray[np.int32], NDArray[np.int32]]]:
        """Return the vertices of each edge, and of the triangle or other edge that it intersects at `x`."""
        x, search, toolkit, edges = np.asfortranarray(x), self._toolkit.LBVH(), self._toolkit, self.edges
        if not toolkit.has_intersections(self._mesh, x, search):
            return []
        search.can_vertices_collide = self._mesh.can_collide
        search.build(x, edges, self.triangles)
        if self._d == 2:
            near = [(edges[pair.edge0_id], edges[pair.edge1_id]) for pair in search.detect_edge_edge_candidates()]
            crosses = toolkit.segment_segment_intersect
        else:
            near = [(edges[pair.edge_id], self.triangles[pair.face_id]) for pair in search.detect_edge_face_candidates()]
            crosses = toolkit.is_edge_intersecting_triangle
        return [(edge, other) for edge, other in near if crosses(*x[edge], *x[other])]

    def _projection(self, clamped: bool) -> Any:
        method = self._toolkit.PSDProjectionMethod
        return method.CLAMP if clamped else method.NONE


def _toolkit() -> Any:
    """Return the package `ipctk` with one thread, since with several the last bits differ from run to run."""
    try:
        found = version("ipctk")
        import ipctk
    except (PackageNotFoundError, ImportError) as error:
        raise ContactError(f"MeshContact: the IPC Toolkit is not installed; expected the package ipctk. Run {INSTALL}.") from error
    numbers = tuple(int(part) if part.isdigit() else 0 for part in found.split(".")[:3])
    if not FIRST <= numbers < BEYOND:
        raise ContactError(f"MeshContact: ipctk {found} is installed; expected 1.6.1 or later, before 1.7. Run {INSTALL}.")
    ipctk.set_num_threads(1)
    ipctk.set_logger_level(ipctk.LoggerLevel.error)
    return ipctk
