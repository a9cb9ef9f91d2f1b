"""An elastic foundation on a mesh: a constant stiffness of the vertices of its facets."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray
from scipy.sparse import csr_matrix

from ..arguments import Array
from ..edges import ALL, Linearized, Rows, Tensions
from ..edges.rows import Places
from ..edges.topology import edge_topology
from ..kernels.topology import OWN, stars
from .spread import Spread


class Bedding:
    """A foundation on a mesh: `K = k (x) M` with the mass matrix `M` of its facets, constant.

    Attributes
    ----------
    edges : (2, ne) edges of the facets.
    grounded : degrees of freedom that it ties to the ground.
    """

    def __init__(self, spread: Spread, facets: NDArray[np.int32], stiffness: NDArray[np.float64], dtype: DTypeLike) -> None:
        self._vertices, self._k = spread.vertices, stiffness
        self.edges, self._entries, self._M = _mass_matrix(spread, facets, dtype)
        d = len(stiffness)
        self.grounded = (d * self._vertices[:, None] + np.flatnonzero(stiffness)).ravel()

    def energy(self, u: Array, force: Array | None = None) -> float:
        """Energy [J] at `u` (nv, d); adds the force on the springs [N] to `force` (nv, d)."""
        own = u[self._vertices]
        pull = self._pull(own)
        if force is not None:
            force[self._vertices] += pull
        return float(np.vdot(own, pull)) / 2

    def rows(self, pattern: Places) -> Rows:
        """Where its blocks stand in the values of a matrix of this pattern."""
        vertices = self._vertices.astype(np.int32)
        places = pattern.places(np.repeat(vertices, np.diff(self._M.indptr)), vertices[self._M.indices])
        return Rows(self._M.indptr.astype(np.int64), self._entries, places, pattern.strides[vertices])

    def tangent(self, u: Array, rows: Rows, data: Array, add: bool, force: Array | None = None, kept: Tensions = ALL) -> Linearized:
        """Write the stiffness [N/m] to the CSR values `data`, or add it to them; adds the force to `force` (nv, d)."""
        strides, d = np.repeat(rows.strides, np.diff(rows.begin)), len(self._k)
        for row in range(d):
            for column in range(d):
                place = rows.places + row * strides + column
                if not add:
                    data[place] = 0
                if row == column:
                    data[place] += self._k[row] * self._M.data
        return Linearized(self.energy(u, force), float(self._k.sum() * self._M.data.sum()))

    def edge_blocks(
        self, u: Array, force: Array | None = None, out: Array | None = None, kept: Tensions = ALL
    ) -> tuple[float, Array]:
        """The energy [J], and the factor of `K`, 1 at all `u`."""
        blocks = np.empty(1, dtype=self._M.dtype) if out is None else out
        blocks[:] = 1
        return self.energy(u, force), blocks

    def add_product(self, blocks: Array, v: Array, out: Array) -> None:
        """Add `K v` to `out` (nv, d)."""
        out[self._vertices] += blocks * self._pull(v[self._vertices])

    def add_diagonal(self, blocks: Array, out: Array) -> None:
        """Add the diagonal blocks to `out` (nv, d, d)."""
        for c, k in enumerate(self._k):
            out[self._vertices, c, c] += blocks * k * self._M.diagonal()

    def add_norms(self, blocks: Array, x: Array, out: Array) -> None:
        """Add `sum_b |K_ab| x_b` over the other vertices `b` to `out` (nv,), for `x` (nv,)."""
        own = x[self._vertices]
        out[self._vertices] += blocks * np.linalg.norm(self._k) * (self._M @ own - self._M.diagonal() * own)

    def along(self, u: Array, v: Array) -> NDArray[np.float64]:
        """(5,) coefficients of the energy along `u + s v`: the last two are zero."""
        U, V = u[self._vertices].astype(np.float64), v[self._vertices].astype(np.float64)
        pull = self._pull(V)
        return np.array([np.vdot(U, self._pull(U)) / 2, np.vdot(U, pull), np.vdot(V, pull) / 2, 0.0, 0.0])

    def mean_force(self, u0: Array, u1: Array, weights: tuple[float, float], theta: float, force: Array) -> float:
        """Add `(w0 + w1) K ((1 - theta) u0 + theta u1)` to `force` (nv, d); its springs lose nothing by weights that are not alike: always 0."""
        own, after = u0[self._vertices], u1[self._vertices]
        force[self._vertices] += sum(weights) * self._pull((1 - theta) * own + theta * after)
        return 0.0

    def add_round_off(self, u: Array, out: Array) -> None:
        """Add `K |u|`, all that adds up to the force [N], to `out` (nv, d); all entries of K are positive."""
        out[self._vertices] += self._pull(np.abs(u[self._vertices]))

    def memory(self) -> dict[str, int]:
        """Bytes of what there is now, by part."""
        M = self._M
        arrays = M.data, M.indices, M.indptr, self._entries, self._vertices, self.grounded, self.edges
        return {"foundations": sum(array.nbytes for array in arrays)}

    def _pull(self, own: Array) -> Array:
        """(n, d) `K u` from the displacements of its own vertices."""
        pull: Array = self._M @ own * self._k.astype(self._M.dtype)
        return pull


def _mass_matrix(
    spread: Spread, facets: NDArray[np.int32], dtype: DTypeLike
) -> tuple[NDArray[np.int32], NDArray[np.int32], csr_matrix]:
    """Edges of the facets (m, n), and `M_ab = sum of (1 + delta_ab) area/(m (m + 1))` with the stars of its rows."""
    m, n = len(facets), len(spread.vertices)
    share = spread.sizes / (m * (m + 1))
    own = 2 * spread.add(np.broadcast_to(share, spread.corners.shape))
    between: NDArray[Any] = np.empty(0)
    if m == 1:
        local = np.empty((2, 0), dtype=np.int32)
    else:
        local, sides = edge_topology(spread.corners.astype(np.int32))
        between = np.bincount(sides.ravel(), weights=np.tile(share, len(sides)), minlength=local.shape[1])
    begin, others, entries = stars(local, n)
    values = np.append(between, 0.0)[np.where(entries >= 0, entries, np.where(entries == OWN, len(between), -1 - entries))]
    values[entries == OWN] = own
    M = csr_matrix((values.astype(dtype), others, begin), shape=(n, n))
    return spread.vertices[local].astype(np.int32), entries, M
