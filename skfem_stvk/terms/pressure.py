"""Pressure on the deformed surface, which turns and grows with it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..edges import NodeBlocks
from ..edges.topology import LOCAL_EDGES, edge_topology
from ..errors import LoadError, name_ids
from ..mesh import ElementMesh
from ..mesh.facets import find_facets, turned_alike
from ..mesh.places import Where, describe, facets_at, in_order
from .body import Body
from .load import Time, Value
from .protocols import Load
from .spread import Spread

#: Row and column where the axial vector's components stand in the matrix of a cross product; minus them in the transposed place.
AXIAL = {2: ((1, 0),), 3: ((2, 1), (0, 2), (1, 0))}


@dataclass(frozen=True, eq=False)
class Pressure(Load):
    """Follower pressure: `f_a = - integral of N_a p n da` over the deformed surface, `n` its outward normal. It has no potential.

    On tetrahedra it acts on boundary facets; on triangles in the plane on boundary edges, times thickness. Triangles in space are
    the surface themselves: it pushes against their normal by the right-hand rule round their vertices; neighbours that are turned
    the other way count as turned like the first triangle of their connected piece.

    Parameters
    ----------
    where : as in `Traction`; for triangles in space the name of a subdomain, element ids or a mask, or None for all.
    pressure : `p` per deformed area [N/m^2], positive pushes inwards: a number, or (n,) values at the vertices, in the order of
        vertex ids as given, otherwise ascending; these ramp with the load factor. Or a function of t or of (x, t), taken as it is,
        `x` reference coordinates. Interpolated linearly between vertices.

    Raises
    ------
    RegionError
        when it is bound, if there is no facet or element.
    LoadError
        when it is bound: if `pressure` is not finite or no number; for segments, which have no surface; if facets are not on the
        boundary, so that both sides are inside; if triangles in space have no two sides, as on a Moebius strip.

    >>> import numpy as np, skfem
    >>> from skfem_stvk import StVK, System
    >>> cube = System(skfem.MeshTet(), [StVK(young=1.0, poisson=0.3), Pressure(lambda x: x[0] == 1, 2e6)])
    >>> stretched = np.array([0, 0.5, 0]) * cube.mesh.p.T
    >>> cube.external_force(stretched.ravel()).reshape(-1, 3).sum(axis=0)
    array([-3000000.,        0.,        0.])
    """

    where: Where | None
    pressure: Any

    def bind(self, body: Body) -> FollowerPressure:
        mesh = body.mesh
        if mesh.k == 1:
            raise LoadError(f"Pressure: the mesh has {mesh.kind}, which have no surface. Use Traction or NodalLoad.")
        if mesh.k < mesh.d:
            what = "Pressure" if self.where is None else f"Pressure on {describe(self.where)}"
            surface, vertices = _membrane(mesh, self.where, what), None
        else:
            what = f"Pressure on {describe(self.where)}"
            surface = _outwards(mesh, self.where, what)
            vertices = in_order(mesh, self.where, surface)
        thickness = body.facet_sections(surface) if mesh.d == 2 else np.ones(surface.shape[1])
        spread = Spread(mesh, surface, thickness, vertices)
        return FollowerPressure(mesh, surface, spread, Value(self.pressure, (), spread.x, what, name="pressure"))


class FollowerPressure:
    """Pressure on flat facets that move with their vertices.

        f_a = - w_a A(x),      w_a = integral of N_a p over a facet of unit size
        A = 1/2 (x_1 - x_0) x (x_2 - x_0)                      triangles in space
        A = h (y_1 - y_0, x_0 - x_1)                           edges in the plane, of thickness h at rest

    In space the force is quadratic in the displacements, in the plane linear. Its stiffness `-df_a/dx_b = w_a dA/dx_b` is a cross
    product with half the edge opposite to `b`: not symmetric, unless the surface is closed.

    Vertices of the facets `surface` (m, n) are counterclockwise when seen from the side of the pressure, in the plane with the body
    on their left; the `spread` has the same, with thickness as their sizes.
    """

    has_potential = dead = symmetric = balanced = False

    def __init__(self, mesh: ElementMesh, surface: NDArray[np.int32], spread: Spread, value: Value) -> None:
        self._surface, self._spread, self._value = surface, spread, value
        self._rest = _spokes(mesh.p.T, surface)
        self.nodes_paired, sides = edge_topology(surface)
        self.nodes = spread.vertices
        m, ne = len(surface), self.nodes_paired.shape[1]
        self._block = np.empty((m, m, surface.shape[1]), dtype=np.int64)
        self._block[range(m), range(m)] = 2 * ne + spread.corners
        for side, (i, j) in zip(sides, LOCAL_EDGES[m - 1], strict=True):
            turned = surface[i] > surface[j]
            self._block[i, j], self._block[j, i] = side + ne * turned, side + ne * ~turned

    @property
    def steady(self) -> bool:
        """Whether it is given by constants."""
        return self._value.constant is not None

    def potential(self, u: Array, t: Time) -> float:
        """It has none."""
        raise LoadError("Follower pressure has no potential: its work depends on the path.")

    def add_force(self, u: Array, t: Time, out: Array) -> None:
        """Add the force [N] to `out` (nv, d)."""
        areas, weights = _areas(self._rest + _spokes(u, self._surface)), self._weights(t)
        out[self._spread.vertices] -= np.stack([self._spread.add(weights * area) for area in areas], axis=1)

    def add_blocks(self, u: Array, t: Time, blocks: NodeBlocks) -> None:
        """Add the blocks of `-df/du` [N/m] at `u` (nv, d)."""
        assert blocks.reverse is not None and blocks.own is not None
        weights, every = self._weights(t), (blocks.pairs, blocks.reverse, blocks.own)
        slopes = _slopes(self._rest + _spokes(u, self._surface))
        counts = [len(part) for part in every]
        for (row, column), slope in zip(AXIAL[u.shape[1]], slopes, strict=True):
            values = weights[:, None] * slope
            sums = np.bincount(self._block.ravel(), weights=values.ravel(), minlength=sum(counts))
            for part, own in zip(every, np.split(sums, np.cumsum(counts[:-1])), strict=True):
                part[:, row, column] += own
                part[:, column, row] -= own

    def memory(self) -> dict[str, int]:
        """Bytes of its arrays, by part."""
        spread = self._spread
        arrays = self._surface, self._rest, self.nodes_paired, self._block, spread.vertices, spread.x, spread.corners, spread.sizes
        return {"loads": sum(array.nbytes for array in arrays)}

    def _weights(self, t: Time) -> NDArray[np.float64]:
        """(m, n) integral of `N_a p` over each facet of unit size, times thickness."""
        return self._spread.shares(self._value.at(t)[None])[0]


def _outwards(mesh: ElementMesh, where: Any, what: str) -> NDArray[np.int32]:
    """(k, n) the boundary facets there, turned outwards."""
    found = find_facets(facets_at(mesh, where, what), mesh.surface, mesh.nv)
    bad = np.flatnonzero(found < 0)
    if len(bad):
        raise LoadError(
            f"{what}: {name_ids(bad, 'facet')} of {len(found)} are not on the boundary, so it is ambiguous which side it pushes "
            "on. Name facets of the outer surface only; dead forces on inner facets are a Traction."
        )
    return mesh.surface[:, found]


def _membrane(mesh: ElementMesh, where: Any, what: str) -> NDArray[np.int32]:
    """(3, n) triangles in space, all turned alike."""
    if callable(where):
        raise LoadError(
            f"{what}: triangles in space are the surface themselves; expected the name of a subdomain, element ids or a mask, or "
            "None."
        )
    ids = mesh.elements(where)
    t = mesh.t[:, ids]
    turned, two_sided = turned_alike(t, mesh.nv)
    if not two_sided.all():
        raise LoadError(
            f"{what}: {name_ids(ids[~two_sided], 'element')} are a surface without two sides, like a Moebius strip, so pressure "
            "has no direction there. Leave some of them out."
        )
    t[:2, turned] = t[1::-1, turned]
    return t


def _spokes(x: Array, surface: NDArray[np.int32]) -> Array:
    """(d, m - 1, n) `x_a - x_0` of the facets' vertices, from `x` (nv, d)."""
    corners = x.T[:, surface]
    return corners[:, 1:] - corners[:, :1]


def _areas(spokes: Array) -> Array:
    """(d, n) area vectors [m^2], of edges per thickness [m], from spokes (d, m - 1, n)."""
    if len(spokes) == 2:
        (x,), (y,) = spokes
        return np.stack([y, -x])
    return np.asarray(np.cross(spokes[:, 0], spokes[:, 1], axis=0) / 2)


def _slopes(spokes: Array) -> Array:
    """(axes, m, n) axial vectors of the derivatives `dA/dx_b` of the area vectors."""
    if len(spokes) == 2:
        return np.broadcast_to(np.array([1.0, -1.0])[None, :, None], (1, 2, spokes.shape[2]))
    p, q = spokes[:, 0], spokes[:, 1]
    return np.stack([q - p, -q, p], axis=1) / 2
