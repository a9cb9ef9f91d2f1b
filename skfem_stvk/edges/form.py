"""The edge form of a mesh: its edges, the pairs of edges that share a simplex (TSEPs), and one coefficient for each."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix, triu

from ..arguments import Array
from .stiffness import Stiffness
from .topology import edge_topology


class EdgeForm:
    """Energy `W = 1/4 sum L_ij zeta_i zeta_j` on the edges of some simplices, in the form in which the assembly computes it.

    The attributes are made at first use.

    Parameters
    ----------
    p
        (d, nv) rest coordinates of all vertices of the mesh [m].
    t
        (k + 1, nt) vertices of the simplices.
    stiffness
        Stiffness of each simplex.
    """

    def __init__(self, p: Array, t: NDArray[np.int32], stiffness: Stiffness) -> None:
        self.p, self.t, self.stiffness = p, t, stiffness

    @cached_property
    def edges(self) -> NDArray[np.int32]:
        """Vertices `a < b` (2, ne) of the edges, in lexicographic order as in scikit-fem."""
        return edge_topology(self.t)[0]

    @cached_property
    def t2e(self) -> NDArray[np.int32]:
        """Edges (m, nt) of the simplices."""
        return edge_topology(self.t)[1]

    @cached_property
    def P(self) -> Array:
        """Rest edges `X_a - X_b` (ne, d) [m]."""
        return self.differences(self.p.T)

    @cached_property
    def L(self) -> csr_matrix:
        """Coefficients (ne, ne) [J/m^4], symmetric and positive semi-definite. Off the diagonal are the TSEPs, each twice."""
        m, n = np.triu_indices(len(self.t2e))
        i, j = np.minimum(self.t2e[m], self.t2e[n]), np.maximum(self.t2e[m], self.t2e[n])
        values = self.stiffness.coefficients(self.p, self.t)[:, m, n].T
        upper = csr_matrix(coo_matrix((values.ravel(), (i.ravel(), j.ravel())), shape=(self.edges.shape[1],) * 2))
        L = csr_matrix(upper + triu(upper, 1).T)  # symmetric to the last bit
        L.sort_indices()
        return L

    @cached_property
    def pairs(self) -> NDArray[np.int32]:
        """Edges `i < j` (2, n) of the TSEPs: all pairs of edges that share a simplex, each once."""
        m, n = np.triu_indices(len(self.t2e), 1)
        i, j = np.minimum(self.t2e[m], self.t2e[n]).astype(np.int64), np.maximum(self.t2e[m], self.t2e[n])
        first, second = np.divmod(np.unique(i * self.edges.shape[1] + j), self.edges.shape[1])
        return np.stack([first, second]).astype(np.int32)

    @cached_property
    def adjacent(self) -> NDArray[np.bool_]:
        """Whether (n,) the edges of each TSEP meet in a vertex ("angular"); the others are opposite ("volumetric")."""
        return meet(self.edges, self.pairs)

    def differences(self, x: Array) -> Array:
        """Return the differences `x_a - x_b` (ne, d) along the edges, for a field `x` (nv, d)."""
        return x[self.edges[0]] - x[self.edges[1]]

    def squared_elongations(self, u: Array) -> Array:
        """Return `zeta = (P + p) . U` (ne,) [m^2] at displacements `u` (nv, d): `|p|^2 - |P|^2` without its cancellation."""
        U = self.differences(u)
        return np.asarray(((self.P + (self.P + U)) * U).sum(axis=1))

    def tensions(self, u: Array) -> Array:
        """Return the tensions `t = L zeta` (ne,) [N/m]."""
        return np.asarray(self.L @ self.squared_elongations(u))


def meet(edges: NDArray[Any], pairs: NDArray[Any]) -> NDArray[np.bool_]:
    """Return whether (n,) the `edges` (2, ne) of each of the `pairs` (2, n) meet in a vertex."""
    (a, b), (c, d) = edges[:, pairs[0]], edges[:, pairs[1]]
    return np.asarray((a == c) | (a == d) | (b == c) | (b == d))
