"""W, F and K of edges on bare arrays, readable.

    zeta_i = (P_i + p_i) . U_i        W = 1/4 sum L_ij zeta_i zeta_j        t_i = sum_j L_ij zeta_j
    F = sum_i t_i p_i on a, -t_i p_i on b        K = sum_i t_i (edge Laplacian_i) (x) I + 2 J' L J

`P` rest edge, `U` difference of the displacements of its ends `a` and `b`, `p = P + U` current edge. `|p|^2 - |P|^2` is never
formed: it loses all digits at small strain.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

Array = NDArray[np.float64]


def edge_differences(ends: NDArray[np.int32], u: Array) -> Array:
    """(ne, d) `U = u_a - u_b` for `ends` (2, ne) and `u` (nv, d)."""
    return u[ends[0]] - u[ends[1]]


def squared_elongations(P: Array, U: Array) -> Array:
    """(ne,) `zeta = (P + p) . U` [m^2]."""
    return np.einsum("ij,ij->i", P + (P + U), U)


def energy(zeta: Array, tension: Array) -> float:
    """`W = 1/4 zeta' L zeta` [J], with `tension = L zeta`."""
    return float(zeta @ tension) / 4


def add_force(incidence: csr_matrix, tension: Array, p: Array, out: Array) -> None:
    """Add `F = B' (t p)` [N] to `out` (nv, d); row `a` of `incidence` (nv, ne) holds +1 where an edge begins, -1 where it ends."""
    out += incidence @ (tension[:, None] * p)


def stiffness_blocks(
    first: NDArray[np.int32],
    second: NDArray[np.int32],
    L: Array,
    plain: csr_matrix,
    transposed: csr_matrix,
    tension: Array,
    p: Array,
) -> Array:
    """(ne, d, d) blocks `K_ab` of the tangent stiffness [N/m], one for each edge `a < b`; `K_ba` is the transpose.

    `first <= second` (n,) are the edges of each pair with coefficient `L` (n,). `plain` and `transposed` (ne, n) say with which
    sign a pair's block `2 L_ij p_i (x) p_j` goes to which edge, as it is or transposed.
    """
    d = p.shape[1]
    pairs = ((2 * L)[:, None] * p[first])[:, :, None] * p[second][:, None, :]
    blocks: Array = (plain @ pairs.reshape(-1, d * d)).reshape(-1, d, d)
    blocks += np.swapaxes((transposed @ pairs.reshape(-1, d * d)).reshape(-1, d, d), 1, 2)
    blocks[:, range(d), range(d)] -= tension[:, None]
    return blocks


def diagonal_blocks(begins: csr_matrix, ends: csr_matrix, blocks: Array) -> Array:
    """(nv, d, d) blocks `K_aa = -sum_b K_ab`: a translation costs nothing. `begins`, `ends` (nv, ne) hold ones."""
    d = blocks.shape[1]
    rows = begins @ blocks.reshape(-1, d * d) + ends @ np.swapaxes(blocks, 1, 2).reshape(-1, d * d)
    return -rows.reshape(-1, d, d)
