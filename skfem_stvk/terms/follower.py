"""Follower pressure on a surface: its force and its load stiffness."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..edges.rows import Places
from ..edges.topology import LOCAL_EDGES, edge_topology
from ..errors import LoadError
from ..mesh import SimplexMesh
from .load import Time, Value
from .spread import Spread

#: Row and column where the axial vector's components stand in the matrix of a cross product; minus them in the transposed place.
AXIAL = {2: ((1, 0),), 3: ((2, 1), (0, 2), (1, 0))}


class BlockPlaces(NamedTuple):
    """Where the blocks of a load stiffness stand in the values of K.

    Attributes
    ----------
    block : (m, m, n) block that the pair of vertices `a`, `b` of each facet adds to.
    places, strides : (blocks,) its first value, and from there to its next row.
    """

    block: NDArray[np.int64]
    places: NDArray[np.int32]
    strides: NDArray[np.int32]


class FollowerPressure:
    """Pressure on flat facets that move with their vertices.

        f_a = - w_a A(x),      w_a = integral of N_a p over a facet of unit size
        A = 1/2 (x_1 - x_0) x (x_2 - x_0)                      triangles in space
        A = h (y_1 - y_0, x_0 - x_1)                           edges in the plane, of thickness h at rest

    In space the force is quadratic in the displacements, in the plane linear. Its stiffness `-df_a/dx_b = w_a dA/dx_b` is a cross product
    with half the edge opposite to `b`: not symmetric, unless the surface is closed.

    Parameters
    ----------
    surface : (m, n) vertices of the facets, counterclockwise when seen from the side of the pressure; with the body on their left in the
        plane.
    spread : the same, with thickness as their sizes.
    value : the pressure.
    """

    has_potential = False
    dead = False

    def __init__(self, mesh: SimplexMesh, surface: NDArray[np.int32], spread: Spread, value: Value) -> None:
        self._surface, self._spread, self._value = surface, spread, value
        self._rest = _spokes(mesh.p.T, surface)
        self.edges, self._sides = edge_topology(surface)

    @property
    def steady(self) -> bool:
        """Whether it is given by constants."""
        return self._value.constant is not None

    def potential(self, u: Array, t: Time) -> float:
        """It has none.

        Raises
        ------
        LoadError
        """
        raise LoadError("Follower pressure has no potential: its work depends on the path.")

    def add_force(self, u: Array, t: Time, out: Array) -> None:
        """Add the force [N] to `out` (nv, d)."""
        areas = _areas(self._rest + _spokes(u, self._surface))
        weights = self._weights(t)
        out[self._spread.vertices] -= np.stack([self._spread.add(weights * area) for area in areas], axis=1)

    def places(self, pattern: Places) -> BlockPlaces:
        """Where its blocks stand in the values of a matrix of this pattern."""
        m, ne = len(self._surface), self.edges.shape[1]
        block = np.empty((m, m, self._surface.shape[1]), dtype=np.int64)
        block[range(m), range(m)] = 2 * ne + self._spread.corners
        for side, (i, j) in zip(self._sides, LOCAL_EDGES[m - 1], strict=True):
            turned = self._surface[i] > self._surface[j]
            block[i, j], block[j, i] = side + ne * turned, side + ne * ~turned
        (a, b), own = self.edges, self._spread.vertices.astype(np.int32)
        rows, columns = np.concatenate([a, b, own]), np.concatenate([b, a, own])
        return BlockPlaces(block, pattern.places(rows, columns), pattern.strides[rows])

    def add_stiffness(self, u: Array, t: Time, places: BlockPlaces, data: Array) -> None:
        """Add `-df/du` [N/m] to CSR values."""
        weights = self._weights(t)
        slopes = _slopes(self._rest + _spokes(u, self._surface))
        for (row, column), slope in zip(AXIAL[u.shape[1]], slopes, strict=True):
            values = weights[:, None] * slope
            sums = np.bincount(places.block.ravel(), weights=values.ravel(), minlength=len(places.places))
            data[places.places + row * places.strides + column] += sums
            data[places.places + column * places.strides + row] -= sums

    def memory(self) -> dict[str, int]:
        """Bytes of what there is now, by part."""
        spread = self._spread
        arrays = self._surface, self._rest, self.edges, self._sides, spread.vertices, spread.x, spread.corners, spread.sizes
        return {"loads": sum(array.nbytes for array in arrays)}

    def _weights(self, t: Time) -> NDArray[np.float64]:
        """(m, n) integral of `N_a p` over each facet of unit size, times thickness."""
        return self._spread.shares(self._value.at(t)[None])[0]


def _spokes(x: Array, surface: NDArray[np.int32]) -> Array:
    """(d, m - 1, n) `x_a - x_0` of the facets' vertices, from `x` (nv, d)."""
    corners = x.T[:, surface]
    return corners[:, 1:] - corners[:, :1]


def _areas(spokes: Array) -> Array:
    """(d, n) area vectors [m^2], of edges per thickness [m], from spokes (d, m - 1, n)."""
    if len(spokes) == 2:
        (x,), (y,) = spokes
        return np.stack([y, -x])
    areas: Array = np.cross(spokes[:, 0], spokes[:, 1], axis=0) / 2
    return areas


def _slopes(spokes: Array) -> Array:
    """(axes, m, n) axial vectors of the derivatives `dA/dx_b` of the area vectors."""
    if len(spokes) == 2:
        return np.broadcast_to(np.array([1.0, -1.0])[None, :, None], (1, 2, spokes.shape[2]))
    p, q = spokes[:, 0], spokes[:, 1]
    return np.stack([q - p, -q, p], axis=1) / 2
