"""The IPC Toolkit: barriers between triangles, their friction, and the steps up to which nothing passes through anything.

Nothing else imports `ipctk`, which the extra `contact` installs.
"""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ..arguments import Array
from ..errors import ContactError

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


class Collisions(NamedTuple):
    """Pairs of primitives closer than the distance of a barrier.

    Attributes
    ----------
    x
        (m, 3) positions of the vertices [m].
    found
        The collisions as the toolkit has them.
    """

    x: Array
    found: Any


class Barrier:
    """Barrier between triangles on vertices `X` (m, 3): its energy per area is that of a material of modulus `stiffness` [Pa].

    It acts at distances below `distance` [m], and becomes infinite at zero. Positions `x` are (m, 3).

    Parameters
    ----------
    X
        (m, 3) vertices at rest [m], which determine the areas.
    triangles
        (n, 3) vertices of the triangles.
    patches
        (m,) numbers of surfaces, of which only different ones touch; None if the surface also touches itself.

    Notes
    -----
    Source: IPC Toolkit (Ferguson et al. 2020), after Li et al. (2020), with area weights and the improved maximum approximation
    (Li et al. 2023). Of the other sets of collisions, the default one gives a tangential force on sheets that do not match, and the
    energy of the offset one (OGC) jumps where a corner slides over an edge.
    """

    def __init__(
        self, X: Array, triangles: NDArray[np.int32], patches: NDArray[np.int32] | None, distance: float, stiffness: float
    ) -> None:
        self._toolkit = ipctk = _toolkit()
        self._made_of = X, triangles, patches, distance, stiffness
        self.distance, self.triangles = distance, triangles
        self.edges = ipctk.edges(triangles)
        self._mesh = ipctk.CollisionMesh(*map(np.asfortranarray, (X, self.edges, triangles)))
        if patches is not None:
            self._mesh.can_collide = ipctk.make_vertex_patches_filter(patches)
        self._potential = ipctk.BarrierPotential(distance, stiffness, use_physical_barrier=True)
        self._detection = ipctk.AdditiveCCD(max_iterations=DETECTING, conservative_rescaling=RESCALING)
        self._longest = STRETCHED * self._longest_edge(X)

    def __reduce__(self) -> tuple[type[Barrier], tuple[Any, ...]]:
        return Barrier, self._made_of  # objects of the toolkit cannot be pickled

    def collisions(self, x: Array) -> Collisions:
        """Return the collisions at `x`. They depend on nothing else."""
        found, x = self._toolkit.NormalCollisions(), np.asfortranarray(x)
        found.use_area_weighting = True
        found.collision_set_type = self._toolkit.NormalCollisions.CollisionSetType.IMPROVED_MAX_APPROX
        # LBVH takes half the time, but lists pairs of edges in either order. ipctk 1.6.1 then merges different types of nearly
        # parallel pairs, and the energy changes by 1e-3 when the body is turned.
        # SweepAndPrune finds the same pairs as HashGrid, in twice the time for large meshes.
        usual = self._longest_edge(x) <= self._longest
        found.build(self._mesh, x, self.distance, broad_phase=self._toolkit.HashGrid() if usual else self._toolkit.SweepAndPrune())
        return Collisions(x, found)

    def _longest_edge(self, x: Array) -> float:
        ends = x[self.edges]
        return float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).max(initial=0.0))

    def energy(self, at: Collisions) -> float:
        """Return the energy [J]."""
        return float(self._potential(at.found, self._mesh, at.x))

    def force(self, at: Collisions) -> Array:
        """Return the derivative (m, 3) of the energy by the positions [N]."""
        return self._potential.gradient(at.found, self._mesh, at.x).reshape(-1, 3)

    def stiffness(self, at: Collisions, clamped: bool) -> csr_matrix:
        """Return the second derivative (3 m, 3 m) [N/m], or that with positive semi-definite blocks of the collisions."""
        return self._potential.hessian(at.found, self._mesh, at.x, self._projection(clamped))

    def rubbing(self, at: Collisions, coefficient: float) -> Any:
        """Return the collisions with the normal forces and tangents of this state, for friction with this coefficient."""
        found = self._toolkit.TangentialCollisions()
        found.build(self._mesh, at.x, at.found, self._potential, coefficient)
        return found

    def friction(self, rubbing: Any, slip: Array, width: float) -> Array:
        """Return the friction (m, 3) [N] for displacements `slip` (m, 3), as an internal force; it rises up to slips of `width`."""
        potential = self._toolkit.FrictionPotential(width)
        return potential.gradient(rubbing, self._mesh, np.asfortranarray(slip)).reshape(-1, 3)

    def friction_stiffness(self, rubbing: Any, slip: Array, width: float) -> csr_matrix:
        """Return the derivative (3 m, 3 m) of the friction by `slip` [N/m]."""
        potential = self._toolkit.FrictionPotential(width)
        return potential.hessian(rubbing, self._mesh, np.asfortranarray(slip), self._projection(False))

    def limit(self, x: Array, y: Array) -> float:
        """Return the fraction of the straight way from `x` to `y` before anything passes through anything; 1 if nothing does."""
        x, y = np.asfortranarray(x), np.asfortranarray(y)
        search = self._toolkit.LBVH()
        return float(self._toolkit.compute_collision_free_stepsize(self._mesh, x, y, 0.0, search, self._detection))

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

    def intersections(self, x: Array) -> NDArray[np.int64]:
        """Return the edges and triangles (n, 2) that intersect at `x`, by number."""
        x, search = np.asfortranarray(x), self._toolkit.LBVH()
        if not self._toolkit.has_intersections(self._mesh, x, search):
            return np.empty((0, 2), dtype=np.int64)
        search.can_vertices_collide = self._mesh.can_collide
        search.build(x, self.edges, self.triangles)
        near = [(pair.edge_id, pair.face_id) for pair in search.detect_edge_face_candidates()]
        crossing = [
            (edge, face)
            for edge, face in near
            if self._toolkit.is_edge_intersecting_triangle(*x[self.edges[edge]], *x[self.triangles[face]])
        ]
        return np.array(crossing, dtype=np.int64).reshape(-1, 2)

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
