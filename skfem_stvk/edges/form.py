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
    """`W = 1/4 sum L_ij zeta_i zeta_j` on the edges of some simplices: what the assembly computes, to be looked at.

    Nothing is made before it is asked for.

    Parameters
    ----------
    p : (d, nv) rest coordinates of all vertices of the mesh [m].
    t : (k + 1, nt) vertices of the simplices.
    stiffness : of each simplex.
    """

    def __init__(self, p: Array, t: NDArray[np.int32], stiffness: Stiffness) -> None:
        self.p, self.t, self.stiffness = p, t, stiffness

    @cached_property
    def edges(self) -> NDArray[np.int32]:
        """(2, ne) vertices `a < b` of the edges, in lexicographic order: scikit-fem's."""
        return edge_topology(self.t)[0]

    @cached_property
    def t2e(self) -> NDArray[np.int32]:
        """(m, nt) edges of the simplices."""
        return edge_topology(self.t)[1]

    @cached_property
    def P(self) -> Array:
        """(ne, d) rest edges `X_a - X_b` [m]."""
        return self.differences(self.p.T)

    @cached_property
    def L(self) -> csr_matrix:
        """(ne, ne) coefficients [J/m^4], symmetric and positive semi-definite; off the diagonal stand the TSEPs, each twice."""
        m, n = np.triu_indices(len(self.t2e))
        i, j = np.minimum(self.t2e[m], self.t2e[n]), np.maximum(self.t2e[m], self.t2e[n])
        values = self.stiffness.coefficients(self.p, self.t)[:, m, n].T
        upper = csr_matrix(coo_matrix((values.ravel(), (i.ravel(), j.ravel())), shape=(self.edges.shape[1],) * 2))
        L = csr_matrix(upper + triu(upper, 1).T)  # symmetric to the last digit
        L.sort_indices()
        return L

    @cached_property
    def pairs(self) -> NDArray[np.int32]:
        """(2, n) edges `i < j` of the TSEPs: all pairs of edges that share a simplex, each once."""
        m, n = np.triu_indices(len(self.t2e), 1)
        i, j = np.minimum(self.t2e[m], self.t2e[n]).astype(np.int64), np.maximum(self.t2e[m], self.t2e[n])
        first, second = np.divmod(np.unique(i * self.edges.shape[1] + j), self.edges.shape[1])
        return np.stack([first, second]).astype(np.int32)

    @cached_property
    def adjacent(self) -> NDArray[np.bool_]:
        """(n,) for each TSEP whether its edges meet in a vertex ("angular"); the others are opposite ("volumetric")."""
        return meet(self.edges, self.pairs)

    def differences(self, x: Array) -> Array:
        """(ne, d) `x_a - x_b` along the edges, of a field `x` (nv, d)."""
        return x[self.edges[0]] - x[self.edges[1]]

    def squared_elongations(self, u: Array) -> Array:
        """(ne,) `zeta = (P + p) . U` [m^2] at displacements `u` (nv, d): `|p|^2 - |P|^2` without its cancellation."""
        U = self.differences(u)
        return np.asarray(((self.P + (self.P + U)) * U).sum(axis=1))

    def tensions(self, u: Array) -> Array:
        """(ne,) `t = L zeta` [N/m]."""
        return np.asarray(self.L @ self.squared_elongations(u))


def meet(edges: NDArray[Any], pairs: NDArray[Any]) -> NDArray[np.bool_]:
    """(n,) whether the `edges` (2, ne) of each of the `pairs` (2, n) meet in a vertex."""
    (a, b), (c, d) = edges[:, pairs[0]], edges[:, pairs[1]]
    return np.asarray((a == c) | (a == d) | (b == c) | (b == d))
