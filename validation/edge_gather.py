"""K edge by edge: each edge sums the blocks of its tetrahedra, so that threads write to separate blocks.

`python -m validation kernels` compares this candidate with the package's kernels. For each tetrahedron it first computes, at the
vertices `a`, `y_a = sqrt(V mu) F g_a`, then the tensions `S_ab` and `B = sum_a x_a y_a'`, and then

    K_ab = 2 r y_a y_b' + y_b y_a' + g_ab B + S_ab I
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from skfem_stvk.edges.topology import LOCAL_EDGES, edge_topology
from skfem_stvk.mesh.geometry import Geometry

FASTMATH = {"reassoc", "contract", "nsz", "arcp"}


class EdgeGather:
    """Isotropic tetrahedra with vertices `t` (4, nt) and coordinates `p` (3, nv)."""

    def __init__(self, p: NDArray[np.float64], t: NDArray[np.int32], lam: float, mu: float) -> None:
        t = np.sort(t, axis=0)
        self.edges, t2e = edge_topology(t)
        geometry = Geometry(p, t)
        scale = np.sqrt(geometry.volume * mu)[:, None, None]
        order = np.argsort(t2e.ravel(), kind="stable")
        self._begin = np.searchsorted(t2e.ravel()[order], np.arange(self.edges.shape[1] + 1)).astype(np.uint32)
        nt = t.shape[1]
        self._of = (order % nt).astype(np.uint32)  # tetrahedron and local edge of each term of an edge's sum
        self._local = (order // nt).astype(np.uint32)
        self._rest = p.T[t.T].copy(), (scale * geometry.gram).copy(), lam / (2 * mu), t.T.astype(np.uint32)
        self._state = np.empty((nt, 12)), np.empty((nt, 6)), np.empty((nt, 9))
        self.blocks = np.empty((self.edges.shape[1], 3, 3))

    def tangent(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the blocks of the edges at displacements `u` (nv, 3), (ne, 3, 3)."""
        _states(*self._rest, u, *self._state)
        _sums(self._begin, self._of, self._local, np.array(LOCAL_EDGES[3]), self._rest[1], self._rest[2], *self._state, self.blocks)
        return self.blocks


@numba.njit(fastmath=FASTMATH, error_model="numpy")
def _states(X: Any, g: Any, r: Any, t: Any, u: Any, ys: Any, Ss: Any, Bs: Any) -> None:
    x, M, A, y = np.empty((4, 3)), np.empty((4, 4)), np.empty((4, 4)), np.empty((4, 3))
    for e in range(len(t)):
        for a in range(4):
            for i in range(3):
                x[a, i] = X[e, a, i] + u[t[e, a], i]
        trace = 0.0
        for a in range(4):  # M_ab = p_a . p_b - P_a . P_b with base vectors from vertex 0
            for b in range(4):
                M[a, b] = 0.0
                for i in range(3):
                    P, U = X[e, b, i] - X[e, 0, i], u[t[e, a], i] - u[t[e, 0], i]
                    M[a, b] += (x[a, i] - x[0, i]) * (u[t[e, b], i] - u[t[e, 0], i]) + U * P
                trace += g[e, a, b] * M[a, b]
        for a in range(4):
            for b in range(4):
                A[a, b] = 0.0
                for c in range(1, 4):
                    A[a, b] += g[e, a, c] * M[c, b]
            for i in range(3):
                y[a, i] = 0.0
                for c in range(1, 4):
                    y[a, i] += g[e, a, c] * (x[c, i] - x[0, i])
                ys[e, 3 * a + i] = y[a, i]
        for n, (a, b) in enumerate(((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))):
            S = r * trace * g[e, a, b]
            for c in range(1, 4):
                S += A[a, c] * g[e, c, b]
            Ss[e, n] = S
        for i in range(3):
            for j in range(3):
                B = 0.0
                for a in range(1, 4):
                    B += (x[a, i] - x[0, i]) * y[a, j]
                Bs[e, 3 * i + j] = B


@numba.njit(fastmath=FASTMATH, error_model="numpy")
def _sums(begin: Any, of: Any, local: Any, ends: Any, g: Any, r: Any, ys: Any, Ss: Any, Bs: Any, blocks: Any) -> None:
    block = np.empty((3, 3))
    for edge in range(len(blocks)):
        block[:] = 0
        for k in range(begin[edge], begin[edge + 1]):
            e, n = of[k], local[k]
            a, b = ends[n]
            for i in range(3):
                for j in range(3):
                    block[i, j] += (
                        2 * r * ys[e, 3 * a + i] * ys[e, 3 * b + j]
                        + ys[e, 3 * b + i] * ys[e, 3 * a + j]
                        + g[e, a, b] * Bs[e, 3 * i + j]
                    )
                block[i, i] += Ss[e, n]
        blocks[edge] = block
