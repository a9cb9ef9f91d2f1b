"""Stiffness that is turned at the nodes: a force without an energy."""

from __future__ import annotations

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..arguments import Array
from .assembly import LawAssembly
from .pairs import ALL, NodeBlocks, Tensions


class VertexWarping:
    """`F_a = R_a sum_b K_ab (R_a' x_b - X_b)`, `R_a` the rotation nearest to the mean of F around node a, K that at rest.

    With the tangent `R_a K_ab R_a' + dF_a/dw_a dw_a/dx_b` of the turn `w_a` of `R_a`; without the second part for other `kept`
    than `ALL`, which is not symmetric all the same.

    Parameters
    ----------
    p : rest coordinates (d, nv) [m], in two or three dimensions.
    t : (n, nt) nodes of the elements.
    gradients : (nt, n, d) of the shape functions, mean over each element; `sizes` (nt,) of the elements.
    of : the assembly of which K is taken at rest.
    """

    symmetric = balanced = has_energy = False

    def __init__(self, p: Array, t: NDArray[np.int32], gradients: Array, sizes: Array, of: LawAssembly, dtype: DTypeLike) -> None:
        self.nodes_paired, self.nodes = of.nodes_paired, np.unique(of.nodes_paired).astype(np.int32)
        self._of, self._dtype, d = of, dtype, len(p)
        a, b = self.nodes_paired
        own = np.arange(len(self.nodes))
        a, b = np.searchsorted(self.nodes, a), np.searchsorted(self.nodes, b)
        self._row, self._column = np.concatenate([a, b, own]), np.concatenate([b, a, own])
        m = len(self.nodes)
        key = self._row * m + self._column
        order = np.argsort(key)
        K = _blocks_at_rest(of, d)
        self._K = np.concatenate([K, K.transpose(0, 2, 1), np.zeros((m, d, d))])
        np.subtract.at(self._K, len(K) * 2 + self._row[: 2 * len(K)], self._K[: 2 * len(K)])
        # the mean of F around a node: sum_b x_b g_ab'
        nodes = np.searchsorted(self.nodes, t)
        n = len(t)
        first, second = np.repeat(nodes, n, axis=0), np.tile(nodes, (n, 1))
        weight = np.bincount(nodes.ravel(), np.tile(sizes, n), m)
        shares = np.tile(gradients.transpose(1, 0, 2), (n, 1, 1)) * sizes[:, None] / weight[first][..., None]
        self._g = np.zeros((len(key), d))
        places = order[np.searchsorted(key[order], (first * m + second).ravel())]
        np.add.at(self._g, places, shares.reshape(-1, d))
        self._X = p.T[self.nodes]

    def _now(self, u: Array) -> tuple[Array, Array, Array, Array, Array]:
        """Positions (m, d), rotations and `S` (m, 3, 3), forces (m, d) and the blocks turned (pairs, d, d)."""
        x, d, row, column = self._X + u[self.nodes], self._X.shape[1], self._row, self._column
        F = np.zeros((len(x), 3, 3)) + np.diag([0.0] * d + [1.0] * (3 - d))
        np.add.at(F[:, :d, :d], row, (x[column] - x[row])[:, :, None] * self._g[:, None, :])
        U, s, V = np.linalg.svd(F)
        mirrored = np.sign(np.linalg.det(U @ V))
        U[:, :, 2] *= mirrored[:, None]
        s[:, 2] *= mirrored
        R, S = U @ V, np.swapaxes(V, 1, 2) @ (s[..., None] * V)
        T = R[row, :d, :d]
        K = T @ self._K @ np.swapaxes(T, 1, 2)
        pull = np.einsum("nij,nj->ni", K, x[column] - x[row])
        pull -= np.einsum("nij,njk,nk->ni", T, self._K, self._X[column] - self._X[row])
        force = np.zeros_like(x)
        np.add.at(force, row, pull)
        return x, R, S, force, K

    def energy_and_force(self, u: Array, force: Array | None = None) -> float:
        """0; adds the internal force [N] at `u` (nv, d) to `force` (nv, d)."""
        if force is not None:
            force[self.nodes] += self._now(u)[3]
        return 0.0

    def add_blocks(self, u: Array, blocks: NodeBlocks, kept: Tensions = ALL) -> None:
        """Add the blocks of the derivative of the force [N/m] at `u` (nv, d)."""
        x, R, S, force, K = self._now(u)
        d, row, column = x.shape[1], self._row, self._column
        assert blocks.reverse is not None and blocks.own is not None
        if kept == ALL:
            turned = np.zeros((len(x), 3, 3))  # dF_a/dw_a = -[F_a] + sum_b R_a K_ab R_a' [x_b - x_a]
            wide = np.zeros((len(K), 3, 3))
            wide[:, :d, :d] = K
            np.add.at(turned, row, wide @ _cross(_in_space(x[column] - x[row])))
            turned -= _cross(_in_space(force))
            # w_a = R (tr S - S)^-1 R' (R g_ab x dx_b)
            inverse = np.linalg.inv(np.trace(S, axis1=1, axis2=2)[:, None, None] * np.eye(3) - S)
            turn = R @ inverse @ np.swapaxes(R, 1, 2)
            g = np.einsum("nij,nj->ni", R[row], _in_space(self._g))
            K = K + ((turned @ turn)[row] @ _cross(g))[:, :d, :d]
        n = self.nodes_paired.shape[1]
        blocks.pairs += K[:n]
        blocks.reverse += K[n : 2 * n]
        blocks.own += K[2 * n :]

    def volume_ratios(self, u: Array) -> NDArray[np.float64]:
        """As those of the elements."""
        return self._of.volume_ratios(u)

    def smallest_volume_ratio(self, u: Array) -> float:
        """As that of the elements."""
        return self._of.smallest_volume_ratio(u)

    def step_limit(self, u: Array, v: Array) -> float:
        """As that of the elements."""
        return self._of.step_limit(u, v)

    def memory(self) -> dict[str, int]:
        """Bytes of its arrays, by part."""
        own = sum(x.nbytes for x in (self._K, self._g, self._row, self._column, self._X))
        return self._of.memory() | {"turned at the nodes": own}


def _blocks_at_rest(of: LawAssembly, d: int) -> Array:
    """(n, d, d) blocks of K at rest of its pairs of nodes, in their order."""
    _, blocks = of.blocks(np.zeros((int(of.nodes_paired.max()) + 1, d)))
    pairs, own = of.pairs, of.elements.own.vertices
    ends = own[pairs.edges] if pairs.edges is not None else np.empty((0, 2))
    every = np.asarray(blocks, dtype=np.float64)[: pairs.size].reshape(-1, 3, 3)[:, :d, :d]
    swapped = ends[:, 0] > ends[:, 1]
    every = np.where(swapped[:, None, None], every.transpose(0, 2, 1), every)
    low, high = np.sort(ends, axis=1).T
    mine, n = np.lexsort((high, low)), int(own.max()) + 1
    place = np.searchsorted((low * n + high)[mine], of.nodes_paired[0].astype(np.int64) * n + of.nodes_paired[1])
    return np.asarray(every[mine][place])


def _in_space(x: Array) -> Array:
    """Vectors with three components."""
    return np.concatenate([x, np.zeros((len(x), 3 - x.shape[1]))], axis=1)


def _cross(v: Array) -> Array:
    """(n, 3, 3) matrices `[v]`, `[v] x = v x x`."""
    out = np.zeros((len(v), 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[:, j, i], out[:, i, j] = v[:, k], -v[:, k]
    return out
