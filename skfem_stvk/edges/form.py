"""The edge form of a mesh: its edges, the pairs of edges that share a simplex (TSEPs), and one coefficient for each."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix, triu

from ..kernels import edges as kernel
from .topology import edge_topology

Array = NDArray[np.float64]


class Places(NamedTuple):
    """Where the values of an edge form's blocks stand in the CSR data of K.

    `upper` and `lower` (ne, d, d) for `K_ab` and `K_ba` of the edges `a < b`, `diagonal` (nv, d, d) for `K_aa` of the vertices.
    """

    upper: NDArray[np.int32]
    lower: NDArray[np.int32]
    diagonal: NDArray[np.int32]


class EdgeForm:
    """`W = 1/4 sum L_ij zeta_i zeta_j` on the edges of some simplices, with its first and second derivative.

    Parameters
    ----------
    p : (d, nv) rest coordinates of all vertices of the mesh [m].
    t : (k + 1, nt) vertices of the simplices.
    coefficients : (nt, m, m) `L` of each simplex (`edges.coefficients`).

    Attributes
    ----------
    edges : (2, ne) vertices `a < b` of the edges.
    t2e : (m, nt) edges of the simplices.
    P : (ne, d) rest edges `X_a - X_b` [m].
    L : (ne, ne) symmetric positive semi-definite; off its diagonal stand the TSEPs, each twice.
    """

    def __init__(self, p: Array, t: NDArray[np.int32], coefficients: Array) -> None:
        self.nv = p.shape[1]
        self.edges, self.t2e = edge_topology(t)
        self.P: Array = (p[:, self.edges[0]] - p[:, self.edges[1]]).T.copy()
        self._upper = _sum_of_pairs(self.t2e, coefficients, self.edges.shape[1])
        self.L: csr_matrix = csr_matrix(self._upper + triu(self._upper, 1).T)

    @cached_property
    def pairs(self) -> NDArray[np.int32]:
        """(2, n) edges `i < j` of the TSEPs: all pairs of edges that share a simplex, each once."""
        first, second = self._entries
        return np.stack([first, second])[:, first < second]

    @cached_property
    def adjacent(self) -> NDArray[np.bool_]:
        """(n,) for each TSEP whether its edges meet in a vertex ("angular"); the others are opposite ("volumetric")."""
        (a, b), (c, d) = self.edges[:, self.pairs[0]], self.edges[:, self.pairs[1]]
        return (a == c) | (a == d) | (b == c) | (b == d)

    def energy(self, u: Array) -> float:
        """Strain energy [J] at displacements `u` (nv, d) [m]."""
        zeta = kernel.squared_elongations(self.P, kernel.edge_differences(self.edges, u))
        return kernel.energy(zeta, self.L @ zeta)

    def add_force(self, u: Array, out: Array) -> None:
        """Add the internal force `dW/du` [N] to `out` (nv, d)."""
        tension, p = self.tension(u)
        kernel.add_force(self._incidence, tension, p, out)

    def add_tangent(self, u: Array, places: Places, data: Array) -> None:
        """Add the tangent stiffness `d2W/du2` [N/m] to the values `data` of a CSR matrix, at the `places` of its blocks."""
        tension, p = self.tension(u)
        blocks = kernel.stiffness_blocks(*self._entries, self._upper.data, *self._pairs_to_edges, tension, p)
        data[places.upper] += blocks
        data[places.lower] += np.swapaxes(blocks, 1, 2)
        data[places.diagonal] += kernel.diagonal_blocks(*self._stars, blocks)

    def tension(self, u: Array) -> tuple[Array, Array]:
        """Edge tensions `t = L zeta` (ne,) [N/m] and current edges `p` (ne, d) [m]."""
        U = kernel.edge_differences(self.edges, u)
        tension: Array = self.L @ kernel.squared_elongations(self.P, U)
        return tension, self.P + U

    @cached_property
    def _entries(self) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Rows and columns of the upper half of L, diagonal included, in the order of its values."""
        rows = np.repeat(np.arange(self._upper.shape[0], dtype=np.int32), np.diff(self._upper.indptr))
        return rows, self._upper.indices

    @cached_property
    def _stars(self) -> tuple[csr_matrix, csr_matrix]:
        """(nv, ne) ones where an edge begins, and where it ends."""
        ne = self.edges.shape[1]
        begins, ends = (
            csr_matrix(coo_matrix((np.ones(ne), (vertices, np.arange(ne))), shape=(self.nv, ne))) for vertices in self.edges
        )
        return begins, ends

    @cached_property
    def _incidence(self) -> csr_matrix:
        begins, ends = self._stars
        return csr_matrix(begins - ends)

    @cached_property
    def _pairs_to_edges(self) -> tuple[csr_matrix, csr_matrix]:
        """(ne, n) signs with which the block of each entry of L goes to the edges: as it is, and transposed.

        The block `p_i (x) p_j` stands in K at (x, y) with sign `s_x s_y` for `x` in `i` and `y` in `j`; blocks at (x, x) follow
        from the row sums.
        """
        first, second = self._entries
        rows, columns, signs, flips = [], [], [], []
        for end, other, factor in ((0, 0, 1.0), (0, 1, -1.0), (1, 0, -1.0), (1, 1, 1.0)):
            x, y = self.edges[end, first], self.edges[other, second]
            # an edge's own block is symmetric: at (b, a) it is the one at (a, b) once more
            here = np.flatnonzero((x != y) & ((first != second) | (end < other)))
            x, y = x[here], y[here]
            rows.append(self._edge_ids(np.minimum(x, y), np.maximum(x, y)))
            columns.append(here)
            signs.append(np.full(len(here), factor))
            flips.append(x > y)
        row, column, sign, flip = (np.concatenate(parts) for parts in (rows, columns, signs, flips))
        shape = (self.edges.shape[1], len(first))
        plain, transposed = (csr_matrix(coo_matrix((sign[at], (row[at], column[at])), shape=shape)) for at in (~flip, flip))
        return plain, transposed

    def _edge_ids(self, a: NDArray[np.int32], b: NDArray[np.int32]) -> NDArray[np.int64]:
        keys = self.edges[0].astype(np.int64) * self.nv + self.edges[1]
        return np.searchsorted(keys, a.astype(np.int64) * self.nv + b)


def _sum_of_pairs(t2e: NDArray[np.int32], coefficients: Array, ne: int) -> csr_matrix:
    """The upper half of the mesh's L, diagonal included: the sum over simplices, so that L is symmetric to the last digit."""
    m, n = np.triu_indices(len(t2e))
    i, j = np.minimum(t2e[m], t2e[n]), np.maximum(t2e[m], t2e[n])
    values = coefficients[:, m, n].T
    upper = csr_matrix(coo_matrix((values.ravel(), (i.ravel(), j.ravel())), shape=(ne, ne)))
    upper.sort_indices()
    return upper
