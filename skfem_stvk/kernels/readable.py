"""The kernels once more, slow and to be read: twins of the same signatures in plain NumPy.

Tests hold the kernels against them; nothing else calls them. They take another way where there is one: all edges instead of spokes, the
whole tensor D instead of the numbers that are stored, sums over lists of places instead of loops. What is said of the arrays in
`simplices` and `blocks` holds here.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .compiled import Ids, Reals
from .simplices import LANES
from .topology import OWN

#: Edges of a tetrahedron as pairs of its vertices: the order of `edge_slots`.
EDGES = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))

#: Pairs of spokes: the order in which components are stored.
PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def out_of_lanes(a: NDArray, width: int, part: slice) -> NDArray:
    """(n, width) what stands in this part of the blocks of lanes, one row a simplex."""
    blocks = a.reshape(-1, width, LANES)[part]
    return np.moveaxis(blocks, 2, 1).reshape(-1, width)


def stiffness(D: Reals, part: slice) -> Reals:
    """(n, 3, 3, 3, 3) the tensor `D_ijkl` of each simplex.

    isotropic    D_ijkl = r g_ij g_kl + 1/2 (g_ik g_jl + g_il g_jk)
    """
    pairs = range(len(PAIRS))
    if D.ndim == 1:
        stored = out_of_lanes(D, 7, part)
        g, r = np.empty((len(stored), 3, 3), D.dtype), stored[:, 6]
        for c, (i, j) in enumerate(PAIRS):
            g[:, i, j] = g[:, j, i] = stored[:, c]
        shear = np.einsum("nik,njl->nijkl", g, g) + np.einsum("nil,njk->nijkl", g, g)
        return np.einsum("n,nij,nkl->nijkl", r, g, g) + shear / 2
    stored = out_of_lanes(D, 21, part)
    tensor = np.empty((len(stored), 3, 3, 3, 3), D.dtype)
    for value, (c, d) in zip(stored.T, ((c, d) for c in pairs for d in pairs if c <= d), strict=True):
        (i, j), (k, l) = PAIRS[c], PAIRS[d]
        for a, b in ((i, j), (j, i)):
            for e, f in ((k, l), (l, k)):
                tensor[:, a, b, e, f] = tensor[:, e, f, a, b] = value
    return tensor


def edges_and_tensions(part: slice, t: Ids, D: Reals, X: Reals, u: Reals) -> tuple[Reals, Reals, Reals, Reals]:
    """Of each simplex: `x` (n, 4, 3) its vertices, seen from vertex 0; squared elongations and tensions (n, 6) of its edges; `S`.

    zeta_ab = (P_ab + p_ab) . U_ab        M_ii = zeta_0i        M_ij = 1/2 (zeta_0i + zeta_0j - zeta_ij)
    t_ij    = -S_ij                       t_0i = sum_j S_ij     S_ij = sum_kl D_ijkl M_kl
    """
    a, b = np.array(EDGES).T
    P, U = (x.reshape(-1, 3)[out_of_lanes(t, 4, part)] for x in (X, u))
    P, U = (P - P[:, :1]).astype(D.dtype), (U - U[:, :1]).astype(D.dtype)
    P_ab, U_ab = P[:, a] - P[:, b], U[:, a] - U[:, b]
    zeta = ((P_ab + P_ab + U_ab) * U_ab).sum(axis=2)
    square = np.zeros((len(zeta), 4, 4), D.dtype)  # zeta_ab, zeta_aa = 0
    square[:, a, b] = square[:, b, a] = zeta
    M = (square[:, 1:, :1] + square[:, :1, 1:] - square[:, 1:, 1:]) / 2
    S = np.einsum("nijkl,nkl->nij", stiffness(D, part), M)
    tensions = np.stack([S[:, b - 1].sum(axis=1) if a == 0 else -S[:, a - 1, b - 1] for a, b in EDGES], axis=1)
    return P + U, zeta, tensions, S


def energy_and_force(begin: int, end: int, t: Ids, slots: Ids, D: Reals, X: Reals, u: Reals, f: Reals) -> float:
    """`W = 1/4 sum t_ab zeta_ab`; an edge pulls its ends with `t_ab p_ab`."""
    part = slice(begin, end)
    x, zeta, tensions, _ = edges_and_tensions(part, t, D, X, u)
    to, slots = f.reshape(-1, 3), out_of_lanes(slots, 4, part)
    for e, (a, b) in enumerate(EDGES if len(f) else ()):
        pull = tensions[:, e, None] * (x[:, a] - x[:, b])
        np.add.at(to, slots[:, a], pull)
        np.subtract.at(to, slots[:, b], pull)
    return float((tensions * zeta).sum() / 4)


def linearize(
    begin: int, end: int, t: Ids, slots: Ids, edge_slots: Ids, marks: Ids, D: Reals, X: Reals, u: Reals, f: Reals, blocks: Reals
) -> float:
    """`K_ij = 2 sum_kl D_ikjl p_k p_l' + S_ij I` of the spokes, `K_0j = -sum_i K_ij`, and of them the blocks of the edges."""
    part = slice(begin, end)
    p, _, _, S = edges_and_tensions(part, t, D, X, u)
    p = p[:, 1:]
    K = np.empty((len(p), 4, 4, 3, 3), D.dtype)
    spokes = 2 * np.einsum("nikjl,nkx,nly->nijxy", stiffness(D, part), p, p)
    K[:, 1:, 1:] = spokes + np.einsum("nij,xy->nijxy", S, np.eye(3))
    K[:, 0, 1:] = -K[:, 1:, 1:].sum(axis=1)
    blocks[9 * marks[begin] : 9 * marks[end]] = 0
    edges = edge_slots.shape[1] // LANES
    slots_of_edges = out_of_lanes(edge_slots, edges, part)
    for e, (a, b) in enumerate(EDGES[:edges]):
        np.add.at(blocks.reshape(-1, 3, 3), slots_of_edges[:, e], K[:, a, b])
    return energy_and_force(begin, end, t, slots, D, X, u, f)


def gather(x: Reals, order: Ids, out: Reals) -> None:
    """`x` (n, d) of the mesh in the kernels' order, with three components."""
    out.reshape(-1, 3)[: len(order), : x.shape[1]] = x[order]


def fold(values: Reals, size: int, targets: Ids, width: int) -> None:
    """Add the slots behind the first `size` to their targets."""
    slots = values.reshape(-1, width)
    np.add.at(slots[:size], targets, slots[size : size + len(targets)])


def add_scattered(x: Reals, order: Ids, out: Reals) -> None:
    """Add `x` in the kernels' order to `out` (n, d) of the mesh."""
    np.add.at(out, order, x.reshape(-1, 3)[: len(order), : out.shape[1]])


def fill_rows(
    begin: int,
    end: int,
    rows: Ids,
    entries: Ids,
    places: Ids,
    strides: Ids,
    blocks: Reals,
    axes: tuple[int, ...],
    add: bool,
    data: Reals,
) -> float:
    """`K_ab` of the edges, `K_ba = K_ab'`, `K_aa = -sum_b K_ab`, each value to its place; the trace."""
    trace, edges = 0.0, blocks.reshape(-1, 3, 3)
    for vertex in range(begin, end):
        star = slice(rows[vertex], rows[vertex + 1])
        where = dict(zip(entries[star].tolist(), places[star].tolist(), strict=True))
        here = where.pop(OWN)
        K = {place: edges[entry] if entry >= 0 else edges[-1 - entry].T for entry, place in where.items()}
        K[here] = own = -sum(K.values(), np.zeros((3, 3)))
        for place, block in K.items():
            for r in axes:
                to = slice(place + r * strides[vertex], place + r * strides[vertex] + len(axes))
                data[to] = block[r, : len(axes)] + (data[to] if add else 0)
        trace += np.trace(own)
    return trace


def multiply(begin: int, end: int, edges: Ids, slots: Ids, blocks: Reals, v: Reals, out: Reals) -> None:
    """`(K v)_a = sum_b K_ab (v_b - v_a)`, and at the other end `K_ab' (v_a - v_b)`."""
    (a, b), slots = edges[begin:end].T, slots[begin:end]
    K, x, to = blocks.reshape(-1, 3, 3)[begin:end], v.reshape(-1, 3), out.reshape(-1, 3)
    np.add.at(to, slots[:, 0], np.einsum("exy,ey->ex", K, x[b] - x[a]))
    np.add.at(to, slots[:, 1], np.einsum("eyx,ey->ex", K, x[a] - x[b]))


def lexicographic_order(rows: Ids, n: int) -> Ids:
    """(items,) order of the columns of `rows` (m, items), first row first; equal columns stay as they are."""
    return np.lexsort(rows[::-1]).astype(np.int32)


def edges_of_simplices(t: Ids, local: Ids, n: int) -> tuple[Ids, Ids]:
    """Edges (2, ne), `a < b` in lexicographic order, and (m, nt) edges of the simplices."""
    ends = np.sort(t[local.T], axis=0).reshape(2, -1)  # all edges of the first local pair, then of the second, ...
    edges, number = np.unique(ends, axis=1, return_inverse=True)
    return edges.astype(np.int32), number.reshape(len(local), -1).astype(np.int32)


def numbers_by_first_use(blocks: Ids, count: int) -> tuple[Ids, Ids]:
    """(count,) new numbers of the ids in `blocks` (n, m), in the order of their first use, and (n + 1,) how many blocks 0 ... i - 1 use."""
    ids, first = np.unique(blocks.ravel(), return_index=True)
    number = np.full(count, -1)
    number[ids[np.argsort(first)]] = np.arange(len(ids))
    marks = np.searchsorted(np.sort(first), blocks.shape[1] * np.arange(len(blocks) + 1))
    return number.astype(np.int32), marks.astype(np.int64)


def stars(edges: Ids, n: int) -> tuple[Ids, Ids, Ids]:
    """`begin`, `others` and `entries`: the rows of a matrix with `e` at `(a, b)`, `-1 - e` at `(b, a)` and OWN at `(a, a)`."""
    (a, b), e, own = edges, np.arange(edges.shape[1]), np.arange(n)
    row, others = np.concatenate([a, b, own]), np.concatenate([b, a, own])
    entries = np.concatenate([e, -1 - e, np.full(n, OWN)])
    order = np.lexsort([others, row])
    begin = np.searchsorted(row[order], np.arange(n + 1))
    return begin.astype(np.int64), others[order].astype(np.int32), entries[order].astype(np.int32)


def expand(begin: Ids, columns: Ids, d: int) -> tuple[Ids, Ids]:
    """`indptr` and `indices` of scipy's CSR format: a row of a vertex has `d` columns for each of its blocks, `d` times."""
    blocks = np.split(d * columns[:, None] + np.arange(d), begin[1:-1])
    rows = [block.ravel() for block in blocks for _ in range(d)]
    indptr = np.concatenate([[0], np.cumsum([len(row) for row in rows])])
    return indptr.astype(np.int32), np.concatenate(rows).astype(np.int32)


def first_places(begin: Ids, columns: Ids, d: int, a: Ids, b: Ids) -> Ids:
    """(n,) place in the CSR values of the first value of each block `(a, b)`, -1 for a block that is not there."""
    row = np.repeat(np.arange(len(begin) - 1), np.diff(begin))
    first = d * d * begin[row] + d * (np.arange(len(columns)) - begin[row])
    known = dict(zip(zip(row.tolist(), columns.tolist(), strict=True), first.tolist(), strict=True))
    return np.array([known.get(pair, -1) for pair in zip(a.tolist(), b.tolist(), strict=True)], dtype=np.int64)


def measures(p: Reals, t: Ids) -> Reals:
    """(3, nt) `k!` times the volume, the longest edge, and the `(k - 1)!`-fold measure of the largest facet: a point's is 1."""
    n = range(len(t))
    edges = [_measure(p, t[[a, b]]) for a in n for b in n if a < b]
    facets = [_measure(p, np.delete(t, a, axis=0)) for a in n]
    return np.stack([_measure(p, t), np.max(edges, axis=0), np.max(facets, axis=0)])


def scaled_gram(p: Reals, t: Ids, mu: Reals) -> Reals:
    """(6, nt) `sqrt(V mu) G_ij`: the Gram matrix of the gradients is the inverse of that of the spokes."""
    k = len(t) - 1
    volume = _measure(p, t) / (1, 1, 2, 6)[k]
    G = np.zeros((t.shape[1], 3, 3))
    G[:, :k, :k] = np.linalg.inv(_metric(p, t))
    i, j = np.array(PAIRS).T
    return np.sqrt(volume * mu) * G[:, i, j].T


def _metric(p: Reals, t: Ids) -> Reals:
    """(nt, k, k) `P_i . P_j` of the spokes `P_i = X_i - X_0`."""
    P = p[:, t[1:]] - p[:, t[:1]]
    return np.einsum("din,djn->nij", P, P)


def _measure(p: Reals, t: Ids) -> Reals:
    """(nt,) `k!` times the volume."""
    return np.sqrt(np.linalg.det(_metric(p, t)))
