"""Forces without an energy: a stiffness rotated at the nodes, and stresses extrapolated below a stretch."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..mesh import ElementMesh
from .assembly import Assembly
from .bound_term import BoundElements
from .elements import Quadrature
from .pairs import ALL, NodeBlocks, Tensions


class WithoutEnergy(BoundElements):
    """Force on elements that is not the gradient of an energy; volumes are those of the elements of an assembly."""

    symmetric = balanced = has_energy = False

    def __init__(self, of: Assembly) -> None:
        self._of, self.nodes_paired = of, of.nodes_paired

    def volume_ratios(self, u: Array) -> NDArray[np.float64]:
        return self._of.volume_ratios(u)

    def smallest_volume_ratio(self, u: Array) -> float:
        return self._of.smallest_volume_ratio(u)

    def step_limit(self, u: Array, v: Array) -> float:
        return self._of.step_limit(u, v)


class VertexWarping(WithoutEnergy):
    """Force `F_a = R_a sum_b K_ab (R_a' x_b - X_b)`, with the rotation `R_a` nearest to the mean F around node a, and K at rest.

    The tangent is `R_a K_ab R_a' + dF_a/dw_a dw_a/dx_b`, with the rotation vector `w_a` of `R_a`. For `kept` other than `ALL` the
    second part is omitted; the tangent is still not symmetric.

    Parameters
    ----------
    mesh
        The mesh; its elements fill their space, of two or three dimensions.
    t
        (n, nt) nodes of the elements.
    of
        The assembly that supplies K at rest.
    """

    def __init__(self, mesh: ElementMesh, t: NDArray[np.int32], of: Assembly) -> None:
        super().__init__(of)
        self.nodes, d, p = np.unique(of.nodes_paired).astype(np.int32), mesh.d, mesh.p
        points = gradients_at_points(mesh, t, of.quadrature)
        sizes = sum((size for _, size in points), np.zeros(t.shape[1]))
        gradients = sum((g * size[:, None, None] for g, size in points), np.zeros((t.shape[1], len(t), d))) / sizes[:, None, None]
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
        indices = order[np.searchsorted(key[order], (first * m + second).ravel())]
        np.add.at(self._g, indices, shares.reshape(-1, d))
        X = p.T[self.nodes]
        self._edges = X[self._column] - X[self._row]

    def _now(self, u: Array) -> tuple[Array, Array, Array, Array, Array]:
        """Return edges (pairs, d), rotations and `S` (m, 3, 3), forces (m, d) and the rotated blocks (pairs, d, d)."""
        u, row, column = u[self.nodes], self._row, self._column
        x, d = self._edges + (u[column] - u[row]), u.shape[1]
        F = np.zeros((len(u), 3, 3)) + np.diag([0.0] * d + [1.0] * (3 - d))
        np.add.at(F[:, :d, :d], row, x[:, :, None] * self._g[:, None, :])
        U, s, V = _signed_svd(F)
        R, S = U @ V, np.swapaxes(V, 1, 2) @ (s[..., None] * V)
        T = R[row, :d, :d]
        K = T @ self._K @ np.swapaxes(T, 1, 2)
        pull = np.einsum("nij,nj->ni", K, x) - np.einsum("nij,njk,nk->ni", T, self._K, self._edges)
        force = np.zeros_like(u)
        np.add.at(force, row, pull)
        return x, R, S, force, K

    def energy_and_force(self, u: Array, force: Array | None = None) -> float:
        """Return 0; add the internal force [N] at `u` (nv, d) to `force` (nv, d)."""
        if force is not None:
            force[self.nodes] += self._now(u)[3]
        return 0.0

    def add_round_off(self, u: Array, out: Array) -> None:
        """Add the absolute values of all summands of the force at `u` (nv, d) to `out` (nv, d) [N], positions included."""
        x, _, _, _, K = self._now(u)
        ends = np.abs(u[self.nodes])[self._column] + np.abs(u[self.nodes])[self._row] + np.abs(x)
        np.add.at(out, self.nodes[self._row], 2 * np.einsum("nij,nj->ni", np.abs(K), ends))

    def add_blocks(self, u: Array, blocks: NodeBlocks, kept: Tensions = ALL) -> None:
        """Add the blocks of the derivative of the force [N/m] at `u` (nv, d)."""
        x, R, S, force, K = self._now(u)
        d, row = x.shape[1], self._row
        assert blocks.reverse is not None and blocks.own is not None
        if kept == ALL:
            dF_dw = np.zeros((len(force), 3, 3))  # dF_a/dw_a = -[F_a] + sum_b R_a K_ab R_a' [x_b - x_a]
            padded = np.zeros((len(K), 3, 3))
            padded[:, :d, :d] = K
            np.add.at(dF_dw, row, padded @ _cross(_in_space(x)))
            dF_dw -= _cross(_in_space(force))
            # w_a = R (tr S - S)^-1 R' (R g_ab x dx_b)
            both = np.trace(S, axis1=1, axis2=2)[:, None, None] * np.eye(3) - S  # its eigenvalues are s_i + s_j
            inverse = np.linalg.pinv(both, rcond=64 * np.finfo(float).eps, hermitian=True)  # 0 where they cancel
            inverse = R @ inverse @ np.swapaxes(R, 1, 2)
            g = np.einsum("nij,nj->ni", R[row], _in_space(self._g))
            K = K + ((dF_dw @ inverse)[row] @ _cross(g))[:, :d, :d]
        n = self.nodes_paired.shape[1]
        blocks.pairs += K[:n]
        blocks.reverse += K[n : 2 * n]
        blocks.own += K[2 * n :]

    def memory(self) -> dict[str, int]:
        """Return the bytes of its arrays, by part."""
        own = sum(x.nbytes for x in (self._K, self._g, self._row, self._column, self._edges))
        return self._of.memory() | {"rotated blocks": own}


class StressExtension(WithoutEnergy):
    """Principal stresses of St. Venant-Kirchhoff, extrapolated linearly with slope `lam + 2 mu` below a stretch `threshold`.

    p_i = dw/ds_i at c + (lam + 2 mu) d_i        c_i = max(s_i, threshold), d = s - c

    The derivative of `p_i` by another stretch below the threshold is zero, but the derivative of that stretch's stress by `s_i` is
    not. So there is no energy. The tangent, which is exact for any `kept`, is not symmetric.

    Parameters
    ----------
    mesh
        The mesh; its elements fill their space, of two or three dimensions.
    t
        (n, nt) nodes of the elements.
    lame
        Lame constants lambda and mu times section, (nt,) each.
    threshold
        Stretch below which the stress is extended.
    of
        An assembly on the same elements, which supplies pairs of nodes and volumes.
    """

    balanced = passes_inversion = True

    def __init__(self, mesh: ElementMesh, t: NDArray[np.int32], lame: tuple[Array, Array], threshold: float, of: Assembly) -> None:
        super().__init__(of)
        points = gradients_at_points(mesh, t, of.quadrature)
        self._t, self._a = t, threshold
        self._g, sizes = np.stack([g for g, _ in points]), np.stack([size for _, size in points])  # (q, nt, n, d), (q, nt)
        self._lam, self._mu = lame[0] * sizes, lame[1] * sizes
        X, n = mesh.p.T[t], mesh.nv
        self._arms = X - X[0]
        ends = np.array([(a, b) for a in range(len(t)) for b in range(len(t)) if a != b])
        first, second = t[ends.T].astype(np.int64)
        key = self.nodes_paired[0].astype(np.int64) * n + self.nodes_paired[1]
        low, high = np.minimum(first, second), np.maximum(first, second)
        self._ends, self._index, self._transposed = ends, np.searchsorted(key, low * n + high), first > second

    def _now(self, u: Array) -> tuple[Array, ...]:
        """Return `U`, `V`, `s`, `c`, `E`, whether stretches lie above the threshold, and `p`: (q, nt, d) at each point."""
        corners = u[self._t]
        H = np.einsum("anx,qnad->qnxd", corners - corners[0], self._g)
        U, s, Vt = _signed_svd(np.eye(u.shape[1]) + H)
        V = np.swapaxes(Vt, 2, 3)
        c = np.maximum(s, self._a)
        E = (c**2 - 1) / 2
        lam, mu = self._lam[..., None], self._mu[..., None]
        p = c * (lam * E.sum(axis=-1, keepdims=True) + 2 * mu * E) + (lam + 2 * mu) * (s - c)
        return U, V, s, c, E, s > self._a, p

    def energy_and_force(self, u: Array, force: Array | None = None) -> float:
        """Return 0; add the internal force [N] at `u` (nv, d) to `force` (nv, d)."""
        if force is not None:
            U, V, *_, p = self._now(u)
            pulled = np.einsum("qnxi,qni,qndi,qnad->anx", U, p, V, self._g, optimize=True)
            np.add.at(force, self._t, pulled)
        return 0.0

    def add_round_off(self, u: Array, out: Array) -> None:
        """Add the absolute values of all summands of the force at `u` (nv, d) to `out` (nv, d) [N].

        Stretches have errors of several eps even at rest. The force of these is that of errors of eps in the positions.
        """
        self.energy_and_force(u, force := np.zeros(u.shape))
        corners = u[self._t]
        reach = np.abs(corners) + np.abs(self._arms + (corners - corners[0]))
        np.add.at(out, self._t, 3 * np.einsum("abnxy,bny->anx", np.abs(self._blocks(u)), reach))
        out += np.abs(force)

    def add_blocks(self, u: Array, blocks: NodeBlocks, kept: Tensions = ALL) -> None:
        """Add the blocks of the derivative of the force [N/m] at `u` (nv, d)."""
        K = self._blocks(u)
        assert blocks.reverse is not None
        for (a, b), index, transposed in zip(self._ends, self._index, self._transposed, strict=True):
            np.add.at(blocks.pairs, index[~transposed], K[a, b][~transposed])
            np.add.at(blocks.reverse, index[transposed], K[a, b][transposed])

    def _blocks(self, u: Array) -> Array:
        """Return the derivatives of the forces on nodes of the elements (n, n, nt, d, d)."""
        U, V, s, c, E, free, p = self._now(u)
        d, lam, mu = s.shape[-1], self._lam[..., None], self._mu[..., None]
        slope, k = lam * E.sum(axis=-1, keepdims=True), lam + 2 * mu
        H = lam[..., None] * c[..., :, None] * (c * free)[..., None, :]
        own = np.where(free, slope + 2 * mu * E + k * c**2, k)
        T = np.zeros((*s.shape[:2], d, d, d, d))
        for i in range(d):
            for j in range(d):
                T[..., i, i, j, j] += own[..., i] if i == j else H[..., i, j]
                if i < j:
                    apart = s[..., i] - s[..., j]
                    share = np.where(free[..., j], 1.0, (c[..., i] - c[..., j]) / np.where(apart > 0, apart, 1.0))
                    inside = slope[..., 0] + mu[..., 0] * (c[..., i] ** 2 + c[..., i] * c[..., j] + c[..., j] ** 2 - 1)
                    flip = share * inside + (1 - share) * k[..., 0]
                    both, least = s[..., i] + s[..., j], 64 * np.finfo(float).eps * (1 + s[..., 0])
                    twist = np.where(both > least, p[..., i] + p[..., j], 0) / np.maximum(both, least)
                    for a, b in ((i, j), (j, i)):
                        T[..., a, b, a, b] += (flip + twist) / 2
                        T[..., a, b, b, a] += (flip - twist) / 2
        w = np.einsum("qnad,qndi->qnai", self._g, V)  # gradients in the axes of the stretches
        K: Array = np.einsum("qnxi,qnaj,qnijkl,qnbl,qnyk->abnxy", U, w, T, w, U, optimize=True)
        return K

    def memory(self) -> dict[str, int]:
        """Return the bytes of its arrays, by part."""
        own = sum(x.nbytes for x in (self._g, self._arms, self._lam, self._mu, self._index, self._transposed))
        return self._of.memory() | {"gradients at points": own}


def gradients_at_points(mesh: ElementMesh, t: NDArray[np.int32], quadrature: Quadrature) -> list[tuple[Array, Array]]:
    """Return gradients of the shape functions (nt, n, d), and sizes (nt,) with the weight, at each point. The elements fill their
    space.
    """
    found, rule, corners = [], quadrature.rule, mesh.p[:, t]
    for dN, weight in zip(mesh.element.derivatives(rule.points), rule.weights, strict=True):
        base_vectors = np.einsum("ai,dan->ndi", dN, corners - corners[:, :1])
        found.append((dN @ np.linalg.inv(base_vectors), weight * np.abs(np.linalg.det(base_vectors))))
    return found


def _signed_svd(F: Array) -> tuple[Array, Array, Array]:
    """Return `U`, `s` and `V'` of F (..., d, d); `U V'` is a rotation, and the smallest of `s` has the sign of det F."""
    U, s, V = np.linalg.svd(F)
    mirrored = np.sign(np.linalg.det(U @ V))
    U[..., -1] *= mirrored[..., None]
    s[..., -1] *= mirrored
    return U, s, V


def _blocks_at_rest(of: Assembly, d: int) -> Array:
    """Return the blocks (n, d, d) of K at rest of the assembly's pairs of nodes, in their order."""
    _, blocks = of.blocks(np.zeros((int(of.nodes_paired.max()) + 1, d)))
    every = np.asarray(blocks, dtype=np.float64)[: of.pairs.size].reshape(-1, 3, 3)[:, :d, :d]
    first, second = of.elements.own.vertices[of.elements.edges.edges].T
    every = np.where((first > second)[:, None, None], every.transpose(0, 2, 1), every)
    return np.asarray(every[of.elements.lexicographic])


def _in_space(x: Array) -> Array:
    """Return the vectors padded to three components."""
    return np.concatenate([x, np.zeros((len(x), 3 - x.shape[1]))], axis=1)


def _cross(v: Array) -> Array:
    """Return the matrices `[v]` (n, 3, 3) with `[v] x = v x x`."""
    out = np.zeros((len(v), 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[:, j, i], out[:, i, j] = v[:, k], -v[:, k]
    return out
