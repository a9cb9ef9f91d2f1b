"""Rest state of the edge form: edges, pairs of edges that share a tetrahedron (TSEPs), and index lists for the sums of K."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix

from skfem_stvk.edges.topology import LOCAL_EDGES

from .body import LOCAL_FACES, Body

Reals = NDArray[np.float64]
Indices = NDArray[np.int32]
EDGES = LOCAL_EDGES[3]


class Rest(NamedTuple):
    """Constants of the rest state, and scratch arrays for quantities on edges.

    `start`, `other`, `pair_L`: TSEPs `i < j` by rows `i`. `h_start`, `h_edge`, `h_L`: terms of the vectors `h`, first one vector
    per edge, then two per face. `pair_edges` (n, 2), `targets` (n, 4), `flips` (n, 4), `double_L`: TSEPs whose edges meet, then
    TSEPs of opposite edges. `targets` are the blocks that receive each product, and `flips` marks transposed products.
    """

    ends: Indices
    P: Reals
    square: Reals
    L: Reals
    start: Indices
    other: Indices
    pair_L: Reals
    face_edges: Indices
    h_start: Indices
    h_edge: Indices
    h_L: Reals
    pair_edges: Indices
    targets: Indices
    flips: NDArray[np.bool_]
    double_L: Reals
    minus_double_own: Reals
    meeting: Indices
    p: Reals
    zeta: Reals
    tension: Reals


def prepare(body: Body, prune: bool = False) -> Rest:
    """Return constants and index lists. `prune` removes the TSEPs with `L = 0` up to rounding."""
    ne, P = body.edges.shape[1], (body.p[:, body.edges[0]] - body.p[:, body.edges[1]]).T.copy()
    floor = 1e-14 * body.coefficients.max() if prune else -1.0
    L, upper = _upper(body, floor)
    h = _changes_of_tension(body, floor)
    pair_edges, targets, flips, double_L, meeting = _pairs(body, floor)
    return Rest(
        ends=body.edges.T.copy(),
        P=P,
        square=(P**2).sum(axis=1),
        L=L,
        start=upper.indptr,
        other=upper.indices,
        pair_L=upper.data,
        face_edges=_face_edges(body),
        h_start=h.indptr,
        h_edge=h.indices,
        h_L=h.data,
        pair_edges=pair_edges,
        targets=targets,
        flips=flips,
        double_L=double_L,
        minus_double_own=-2 * L,
        meeting=np.array([meeting], dtype=np.int32),
        p=np.zeros((ne, 3)),
        zeta=np.zeros(ne),
        tension=np.zeros(ne),
    )


def _upper(body: Body, floor: float) -> tuple[Reals, csr_matrix]:
    """Return the diagonal coefficients of the edges (ne,), and the coefficients of the TSEPs in the upper triangle."""
    m, n = np.triu_indices(6, 1)
    i, j = np.sort([body.t2e[m], body.t2e[n]], axis=0)
    ne = body.edges.shape[1]
    diagonal = np.diagonal(body.coefficients, 0, 1, 2).T
    own = np.asarray(np.bincount(body.t2e.ravel(), diagonal.ravel(), ne), dtype=np.float64)
    return own, _assembled(i, j, body.coefficients[:, m, n].T, (ne, ne), floor)


def _assembled(rows: Any, columns: Any, values: Any, shape: tuple[int, int], floor: float) -> csr_matrix:
    """Return the sums over tetrahedra without entries of absolute value at most `floor`."""
    A = csr_matrix(coo_matrix((values.ravel(), (rows.ravel(), columns.ravel())), shape=shape))
    A.sort_indices()
    small = abs(A.data) <= floor
    if small.any():
        A.data[small] = 0
        A.eliminate_zeros()
    return A


def _face_edges(body: Body) -> Indices:
    """Return the edges `ab`, `ac`, `bc` of the faces `a < b < c`, (nf, 3)."""
    out = np.empty((body.faces.shape[1], 3), dtype=np.int32)
    for face, corners in enumerate(LOCAL_FACES):
        for column, (a, b) in enumerate(((0, 1), (0, 2), (1, 2))):
            out[body.t2f[face], column] = body.t2e[EDGES.index((corners[a], corners[b]))]
    return out


def _changes_of_tension(body: Body, floor: float) -> csr_matrix:
    """Return the terms `+-2 L_ij` of the vectors `h`, with the signs that they have in K, (ne + 2 nf, ne)."""
    ne = body.edges.shape[1]
    rows, columns, values = [], [], []
    for x in range(4):
        for j, (y, z) in enumerate(EDGES):
            if x == y:
                slot, sign = body.t2e[j], -1.0
            elif x < z and x != y:
                face = body.t2f[LOCAL_FACES.index(tuple(sorted((x, y, z))))]
                slot, sign = (ne + 2 * face, 1.0) if x < y else (ne + 2 * face + 1, -1.0)
            else:
                continue
            for i, edge in enumerate(EDGES):
                if x in edge:
                    rows.append(slot)
                    columns.append(body.t2e[i])
                    values.append((2 * sign if x == edge[0] else -2 * sign) * body.coefficients[:, i, j])
    shape = (ne + 2 * body.faces.shape[1], ne)
    return _assembled(np.stack(rows), np.stack(columns), np.stack(values), shape, floor)


def _pairs(body: Body, floor: float) -> tuple[Indices, Indices, NDArray[np.bool_], Reals, int]:
    """Return the TSEPs for `tangent_by_pairs`, first those whose edges meet, and the number of these."""
    meet: list[tuple[Any, ...]] = []
    opposite: list[tuple[Any, ...]] = []
    for i in range(6):
        for j in range(i + 1, 6):
            (a, b), (c, d) = EDGES[i], EDGES[j]
            L = 2 * body.coefficients[:, i, j]
            common = {a, b} & {c, d}
            if common:
                (o,) = common
                x, y = (b if a == o else a), (d if c == o else c)
                L = L * ((1 if x > o else -1) * (1 if y > o else -1))
                meet.append((i, j, L, [(o, y), (x, o), (x, y), (x, y)]))
            else:
                opposite.append((i, j, L, [(a, d), (b, c), (a, c), (b, d)]))
    parts = [_unique_pairs(body, group, floor) for group in (meet, opposite)]
    edges, targets, flips, values = (np.concatenate(part) for part in zip(*parts, strict=True))
    return edges, targets, flips, values, len(parts[0][0])


def _unique_pairs(body: Body, group: list[tuple[Any, ...]], floor: float) -> tuple[Any, ...]:
    """Return each TSEP once.

    The input is local TSEPs `(i, j, 2 L, ends)`, where `ends` are the local vertices of the target blocks.

    A product is added to the block `(x, y)`, transposed if `x > y`. The sum over tetrahedra is the same for each block.
    """
    first = np.concatenate([body.t2e[i] for i, _, _, _ in group])
    second = np.concatenate([body.t2e[j] for _, j, _, _ in group])
    targets = np.concatenate([np.stack([body.t2e[EDGES.index((min(e), max(e)))] for e in ends], axis=1) for _, _, _, ends in group])
    flips = np.concatenate([np.tile([x > y for x, y in ends], (body.nt, 1)) for _, _, _, ends in group])
    swap = first > second
    first, second = np.where(swap, second, first), np.where(swap, first, second)
    flips[swap] = ~flips[swap]
    keys, at, inverse = np.unique(first.astype(np.int64) * body.edges.shape[1] + second, return_index=True, return_inverse=True)
    L = np.bincount(inverse.ravel(), np.concatenate([L for _, _, L, _ in group]), len(keys))
    retained = np.flatnonzero(abs(L) > floor)
    at, L = at[retained], L[retained]
    return np.stack([first[at], second[at]], axis=1).astype(np.int32), targets[at].astype(np.int32), flips[at], L
