"""Rigid surfaces from triangles, such as those of an STL file."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...arguments import Array, Quantity, Specification, own
from ...errors import ContactError, MeshError, StvkError, name_ids, warn
from ...mesh import ElementMesh, read_mesh
from .contact_surface import pieces_of

#: A triangle is degenerate if its area is below this fraction of the square of its longest edge.
DEGENERATE = 1e-9
#: Largest number of triangles in the finer surface of a contact.
MOST = 100_000


@dataclass(frozen=True, eq=False)
class RigidMesh(Specification):
    """Rigid surface at rest: the triangles of a file or a mesh, and in the plane the segments of a mesh.

    Vertices at the same coordinates become one, because STL files have three for each triangle. If the surface is closed and
    oriented, bodies are on the side of its normals: outside a block, and inside a box whose normals point inwards. A start on the
    other side is refused. Other surfaces are two-sided: bodies may start on either side.

    A contact bisects edges that are longer than the mean edge of the body's surface, because the force would concentrate on them.

    Parameters
    ----------
    file
        Path of a file with triangles, in a format of `read_mesh` (STL, PLY, OFF, VTU, ...), or a mesh: arrays `(p, t)`, an
        `ElementMesh` or a `meshio.Mesh`. Normals follow the order of the vertices: a triangle is counterclockwise if seen from the
        body, and a segment has the rigid side on its left. Quadrilaterals count as two triangles, quadratic triangles as four.

    Attributes
    ----------
    points, simplices
        Vertices (n, d) [m], and those of each triangle or segment (m, d).
    closed
        Whether the surface is closed and oriented, so that it has a rigid side.

    Raises
    ------
    MeshError
        as `read_mesh`, or as `ElementMesh.of`.
    ContactError
        if the elements are no triangles in space or segments in the plane, or if some are degenerate.

    Warns
    -----
    StvkWarning
        if the surface is not closed or not oriented, and so is two-sided.

    Examples
    --------
    >>> from skfem_stvk.mesh import box
    >>> die = box((1.0, 1.0, 1.0), (2, 2, 2))
    >>> rigid = RigidMesh((die.p, die.surface))
    >>> rigid.points.shape, rigid.simplices.shape, rigid.closed
    ((26, 3), (48, 3), True)
    """

    error: ClassVar[type[StvkError]] = ContactError

    file: Annotated[Any, Quantity(None, "File with the triangles of the surface, relative to the scene.")]
    points: Array = field(init=False, repr=False)
    simplices: NDArray[np.int32] = field(init=False, repr=False)
    closed: bool = field(init=False, repr=False)

    def __post_init__(self) -> None:
        read = isinstance(self.file, str | os.PathLike)
        try:
            mesh = read_mesh(self.file, dimension=3) if read else ElementMesh.of(self.file)
        except MeshError as error:
            raise MeshError(f"RigidMesh: {error}") from error
        if not 1 <= mesh.k == mesh.d - 1:
            raise ContactError(
                f"RigidMesh: {mesh.kind}; expected a surface, triangles in 3D or segments in 2D. RigidMesh((mesh.p, mesh.surface)) "
                "takes the surface of an ElementMesh; triangles in space need three coordinates."
            )
        bad = np.flatnonzero(~np.isfinite(mesh.p).all(axis=0))
        if len(bad):
            raise ContactError(f"RigidMesh: {name_ids(bad, 'vertex')} not finite; expected finite coordinates [m].")
        points, number = np.unique(mesh.p.T + 0.0, axis=0, return_inverse=True)  # -0.0 becomes 0.0
        used, simplices = np.unique(number.ravel()[pieces_of(mesh.t, mesh.d)], return_inverse=True)
        values = {
            "file": os.path.abspath(self.file) if read else self.file,
            "points": points[used],
            "simplices": simplices.reshape(-1, mesh.d).astype(np.int32),
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)
        self._refuse_degenerate()
        odd = self._unmatched()
        object.__setattr__(self, "closed", not len(odd))
        own(self)
        if len(odd):
            warn(
                f"RigidMesh: {name_ids(odd, self._kind)} of {len(self.simplices)} with an edge that is not shared with exactly one "
                "neighbour of the same orientation: the surface is not closed or not oriented, so it counts as two-sided. A body "
                "behind it is not noticed."
            )

    @property
    def d(self) -> int:
        """Dimension of the space."""
        return self.points.shape[1]

    @property
    def _kind(self) -> str:
        return "triangle" if self.d == 3 else "segment"

    def _refuse_degenerate(self) -> None:
        corners = self.points[self.simplices]
        edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
        bad = np.flatnonzero(self._areas() <= DEGENERATE * edges ** (self.d - 1))
        if len(bad):
            raise ContactError(
                f"RigidMesh: {name_ids(bad, self._kind)} of {len(corners)} without area; expected corners that are no line. Remove "
                "them, or mesh the surface again."
            )

    def _areas(self) -> Array:
        """Return the areas (m,) of the triangles [m^2], or the lengths of the segments [m]."""
        corners = self.points[self.simplices]
        sides = corners[:, 1:] - corners[:, :1]
        normals = np.cross(sides[:, 0], sides[:, 1]) / 2 if self.d == 3 else sides[:, 0]
        areas: Array = np.linalg.norm(normals, axis=1)
        return areas

    def _unmatched(self) -> NDArray[np.int64]:
        """Return the numbers of the simplices with a side that no single neighbour has in the other direction."""
        t: NDArray[Any] = self.simplices.astype(np.int64)
        n = len(self.points)
        if self.d == 3:
            begin, end = t.ravel(), np.roll(t, -1, axis=1).ravel()
            there, back = begin * n + end, end * n + begin
        else:  # each vertex ends one segment and begins one
            there, back = (t + np.array([0, n])).ravel(), (t + np.array([n, 0])).ravel()
        sides, count = np.unique(there, return_counts=True)
        matched = np.isin(back, sides) & np.isin(there, sides[count == 1]) & np.isin(back, sides[count == 1])
        return np.flatnonzero(~matched.reshape(len(t), -1).all(axis=1))

    def refined(self, longest: float) -> tuple[Array, NDArray[np.int32]]:
        """Return vertices (n, d) and simplices (m, d) of the same surface, with short edges.

        Simplices are bisected at their longest edges, both neighbours of an edge at once.

        Parameters
        ----------
        longest
            Largest length of edges [m].

        Raises
        ------
        ContactError
            if there would be too many simplices.
        """
        points, t, d = self.points, self.simplices, self.d
        count = 5 * self._areas().sum() / longest ** (d - 1)
        if count > MOST:
            raise ContactError(
                f"RigidMesh: about {count:.1g} {self._kind}s with edges of {longest:.3g} m, as those of the body, cover it; "
                f"expected at most {MOST:g}. Cut off what the body does not touch, or take a RigidContact."
            )
        while True:
            ends = np.stack([t, np.roll(t, -1, axis=1)], axis=2)[:, : 2 * d - 3].astype(np.int64)
            keys, of = np.unique(ends.min(axis=2) * len(points) + ends.max(axis=2), return_inverse=True)
            edges, of = np.stack(np.divmod(keys, len(points)), axis=1), of.reshape(len(t), -1)
            lengths = np.linalg.norm(points[edges[:, 1]] - points[edges[:, 0]], axis=1)
            rank = np.argsort(np.argsort(lengths, kind="stable"))
            corner = rank[of].argmax(axis=1)  # where the longest edge of each begins
            edge = of[np.arange(len(t)), corner]
            split = (lengths > longest) & (np.bincount(edge, minlength=len(edges)) == np.bincount(of.ravel()))
            if not split.any():
                return points, t
            halved, middle = split[edge], (np.cumsum(split) - 1 + len(points)).astype(np.int32)
            first = np.take_along_axis(t, (corner[:, None] + np.arange(d)) % d, axis=1)[halved]
            second = first.copy()
            first[:, 1] = second[:, 0] = middle[edge[halved]]
            points, t = np.vstack([points, points[edges[split]].mean(axis=1)]), np.vstack([t[~halved], first, second])

    def behind(self, points: Array) -> NDArray[np.bool_]:
        """Return which points are on the rigid side of a closed surface.

        Parameters
        ----------
        points
            (n, d) coordinates [m].
        """
        free_side = 0.0 if self._size() > 0 else -1.0
        return np.abs(winding_numbers(points, self.points[self.simplices]) - free_side) > 0.5

    def _size(self) -> float:
        """Return d! times the volume inside, negative if the normals point inwards."""
        return float(np.linalg.det(self.points[self.simplices] - self.points[0]).sum())


def winding_numbers(points: Array, simplices: Array) -> Array:
    """Return how often (n,) a closed surface of triangles (m, 3, 3) or segments (m, 2, 2) winds around each point: 0 outside.

    Source: van Oosterom and Strackee (1983), the solid angle of a triangle.
    """
    numbers, flat = np.empty(len(points)), simplices.shape[2] == 2
    for i, point in enumerate(points):
        corners = np.moveaxis(simplices - point, 1, 0)
        size = np.linalg.det(simplices - point)
        if flat:
            numbers[i] = np.arctan2(size, (corners[0] * corners[1]).sum(axis=1)).sum() / (2 * np.pi)
            continue
        a, b, c = corners
        la, lb, lc = (np.linalg.norm(one, axis=1) for one in corners)
        dots = sum((one * other).sum(axis=1) * length for one, other, length in ((a, b, lc), (b, c, la), (c, a, lb)))
        numbers[i] = np.arctan2(size, la * lb * lc + dots).sum() / (2 * np.pi)
    return numbers
