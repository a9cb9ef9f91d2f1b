"""Force as an expanded cubic polynomial of the displacements (Picinbono, Delingette, Ayache 2003), derived independently.

With `s_kl = U_k . U_l` for the pairs `q = kl` of vertices of a tetrahedron, including equal ones,

    W = 1/2 sum U_j B_jk U_k + sum (c_jq . U_j) s_q + 1/2 sum A_qr s_q s_r
    F_p = sum_k B_pk U_k + sum_q c_pq s_q + sum_q n_q ds_q/dU_p,        n_q = sum_j c_jq . U_j + sum_r A_qr s_r

`B` are matrices on vertices and edges, `c` vectors on vertices, edges and faces, `A` numbers on vertices, edges, faces and
tetrahedra. Each is summed over the elements once. The paper's order of summation was not found. The code uses the cheapest order
found, in which the products `s` and their conjugates `n` are formed once, not in each term. The paper uses explicit time steps and
gives no tangent stiffness.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix

from .body import Body
from .vectors import add, dot, matrix, product, shifted, times, transposed, vector

Reals = NDArray[np.float64]
Indices = NDArray[np.int32]

#: Pairs of local vertices: equal ones, then edges in the order of `t2e`.
PAIRS = ((0, 0), (1, 1), (2, 2), (3, 3), (0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))


class Rest(NamedTuple):
    """Constants, with scratch arrays `s` and `n` for products and conjugates. Pairs `q` are the vertices, then the edges."""

    ends: Indices
    B_vertex: Reals
    B_edge: Reals
    c_vertex: Indices
    c_pair: Indices
    c: Reals
    A_own: Reals
    A_first: Indices
    A_second: Indices
    A: Reals
    s: Reals
    n: Reals


def force(rest: Rest, u: Any, out: Any) -> None:
    """Add F [N] at displacements `u` (nv, 3) to `out`."""
    nv, s, n = len(rest.B_vertex), rest.s, rest.n
    for a in range(nv):
        s[a] = dot(vector(u, a), vector(u, a))
    for i in range(len(rest.ends)):
        s[nv + i] = dot(vector(u, rest.ends[i, 0]), vector(u, rest.ends[i, 1]))
    for q in range(len(s)):
        n[q] = rest.A_own[q] * s[q]
    for k in range(len(rest.A)):
        q, r = rest.A_first[k], rest.A_second[k]
        n[q] += rest.A[k] * s[r]
        n[r] += rest.A[k] * s[q]
    for k in range(len(rest.c)):
        j, q, c = rest.c_vertex[k], rest.c_pair[k], vector(rest.c, k)
        n[q] += dot(c, vector(u, j))
        add(out, j, times(s[q], c))
    add_products(rest, u, out)


def linear_force(rest: Rest, u: Any, out: Any) -> None:
    """Add the linear part `B_pk U_k` to `out`. This is `K(0) u`, the whole force of linear elements."""
    for a in range(len(rest.B_vertex)):
        add(out, a, product(matrix(rest.B_vertex, a), vector(u, a)))
    for i in range(len(rest.ends)):
        a, b, M = rest.ends[i, 0], rest.ends[i, 1], matrix(rest.B_edge, i)
        add(out, a, product(M, vector(u, b)))
        add(out, b, product(transposed(M), vector(u, a)))


def add_products(rest: Any, u: Any, out: Any) -> None:
    """Add `(B_pk + n_pk I) U_k`: 22 operations per vertex, 39 per edge."""
    nv, n = len(rest.B_vertex), rest.n
    for a in range(nv):
        add(out, a, product(shifted(matrix(rest.B_vertex, a), n[a] + n[a]), vector(u, a)))
    for i in range(len(rest.ends)):
        a, b = rest.ends[i, 0], rest.ends[i, 1]
        M = shifted(matrix(rest.B_edge, i), n[nv + i])
        add(out, a, product(M, vector(u, b)))
        add(out, b, product(transposed(M), vector(u, a)))


def prepare(body: Body) -> Rest:
    """Return the assembled coefficients of the polynomial.

    An element has, in powers of U:

        B_jk = V [lam g_j (x) g_k + mu (g_k (x) g_j + G_jk I)]
        c_jkl = V/2 [lam g_j G_kl + mu (g_k G_jl + g_l G_jk)]
        A_jk,lm = V/4 [lam G_jk G_lm + mu (G_jl G_km + G_jm G_kl)]
    """
    V, g, G = body.geometry.volume, body.geometry.gradients, body.geometry.gram
    lam, mu = V * body.lam, V * body.mu
    dyad = np.einsum("njx,nky->njkxy", g, g)
    B = np.einsum("n,njkxy->njkxy", lam, dyad) + np.einsum("n,nkjxy->njkxy", mu, dyad)
    B += (mu[:, None, None] * G)[..., None, None] * np.eye(3)
    gG = np.einsum("njx,nkl->njklx", g, G)
    c = np.einsum("n,njklx->njklx", lam / 2, gG) + np.einsum(
        "n,njklx->njklx", mu / 2, gG.swapaxes(1, 2) + gG.transpose(0, 2, 3, 1, 4)
    )
    GG = np.einsum("njk,nlm->njklm", G, G)
    A = np.einsum("n,njklm->njklm", lam / 4, GG) + np.einsum(
        "n,njklm->njklm", mu / 4, GG.swapaxes(2, 3) + GG.transpose(0, 1, 4, 3, 2)
    )
    return _assembled(body, B, c, A)


def _assembled(body: Body, B: Reals, c: Reals, A: Reals) -> Rest:
    nv, ne = body.nv, body.edges.shape[1]
    k, l = np.array(PAIRS).T
    twice = np.where(k == l, 1.0, 2.0)
    pairs = np.concatenate([body.t, nv + body.t2e])  # (10, nt)
    blocks = np.zeros((nv + ne, 3, 3))
    np.add.at(blocks, pairs.T, B[:, k, l])
    j, q = (grid.ravel() for grid in np.indices((4, 10)))
    keys, inverse = np.unique(body.t[j].astype(np.int64) * (nv + ne) + pairs[q], return_inverse=True)
    vectors = np.zeros((len(keys), 3))
    np.add.at(vectors, inverse.reshape(len(j), -1).T, (c[:, :, k, l] * twice[:, None])[:, j, q])
    first, second = np.triu_indices(10)
    numbers = A[:, k[first], l[first], k[second], l[second]] * twice[first] * twice[second]
    own = first == second
    A_own = np.asarray(np.bincount(pairs[first[own]].ravel(), numbers[:, own].T.ravel(), nv + ne), dtype=np.float64)
    rows, columns = np.sort([pairs[first[~own]], pairs[second[~own]]], axis=0)
    upper = coo_matrix((numbers[:, ~own].T.ravel(), (rows.ravel(), columns.ravel())), shape=(nv + ne, nv + ne)).tocsr().tocoo()
    return Rest(
        ends=body.edges.T.copy(),
        B_vertex=blocks[:nv],
        B_edge=blocks[nv:],
        c_vertex=(keys // (nv + ne)).astype(np.int32),
        c_pair=(keys % (nv + ne)).astype(np.int32),
        c=vectors,
        A_own=A_own,
        A_first=upper.row,
        A_second=upper.col,
        A=upper.data,
        s=np.zeros(nv + ne),
        n=np.zeros(nv + ne),
    )
