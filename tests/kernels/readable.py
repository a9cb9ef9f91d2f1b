"""Twins of the kernels in plain NumPy: the same signatures, slow and readable.

Only tests call the twins, and compare the kernels with them. Kernels of laws and elements have none: they are compared with
formulas of the continuum, with scikit-fem and with differences of the energy.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from skfem_stvk.kernels.compiled import Ids, Reals
from skfem_stvk.kernels.simplex_topology import OWN


def lexicographic_order(rows: Ids, n: int) -> Ids:
    """Return the order of the columns of `rows` (m, items), first row first, (items,); the order of equal columns is unchanged."""
    return np.lexsort(rows[::-1]).astype(np.int32)


def edges_of_simplices(t: Ids, local: Ids, n: int) -> tuple[Ids, Ids]:
    """Return edges (2, ne), `a < b` in lexicographic order, and the edges of the simplices, (m, nt)."""
    ends = np.sort(t[local.T], axis=0).reshape(2, -1)  # all edges of the first local pair, then of the second, ...
    edges, number = np.unique(ends, axis=1, return_inverse=True)
    return edges.astype(np.int32), number.reshape(len(local), -1).astype(np.int32)


def numbers_by_first_use(blocks: Ids, count: int) -> tuple[Ids, Ids]:
    """Return new numbers of the ids in `blocks` (n, m) by their first use, (count,), and numbers of ids used so far, (n + 1,).

    Entry i of the second array is the number of ids that the blocks 0 ... i - 1 use.
    """
    ids, first = np.unique(blocks.ravel(), return_index=True)
    number = np.full(count, -1)
    number[ids[np.argsort(first)]] = np.arange(len(ids))
    marks = np.searchsorted(np.sort(first), blocks.shape[1] * np.arange(len(blocks) + 1))
    return number.astype(np.int32), marks.astype(np.int64)


def stars(edges: Ids, n: int) -> tuple[Ids, Ids, Ids]:
    """Return `begin`, `others` and `entries`: rows of a matrix with `e` at `(a, b)`, `-1 - e` at `(b, a)` and OWN at `(a, a)`."""
    (a, b), e, own = edges, np.arange(edges.shape[1]), np.arange(n)
    row, others = np.concatenate([a, b, own]), np.concatenate([b, a, own])
    entries = np.concatenate([e, -1 - e, np.full(n, OWN)])
    order = np.lexsort([others, row])
    begin = np.searchsorted(row[order], np.arange(n + 1))
    return begin.astype(np.int64), others[order].astype(np.int32), entries[order].astype(np.int32)


def expand(begin: Ids, columns: Ids, d: int) -> tuple[Ids, Ids]:
    """Return `indptr` and `indices` of scipy's CSR format; each row of blocks becomes `d` rows with `d` columns per block."""
    blocks = np.split(d * columns[:, None] + np.arange(d), begin[1:-1])
    rows = [block.ravel() for block in blocks for _ in range(d)]
    indptr = np.concatenate([[0], np.cumsum([len(row) for row in rows])])
    return indptr.astype(np.int32), np.concatenate(rows).astype(np.int32)


def block_indices(begin: Ids, columns: Ids, d: int, a: Ids, b: Ids) -> Ids:
    """Return the index in the CSR values of the first value of each block `(a, b)`, (n,), or -1 for a missing block."""
    row = np.repeat(np.arange(len(begin) - 1), np.diff(begin))
    first = d * d * begin[row] + d * (np.arange(len(columns)) - begin[row])
    known = dict(zip(zip(row.tolist(), columns.tolist(), strict=True), first.tolist(), strict=True))
    return np.array([known.get(pair, -1) for pair in zip(a.tolist(), b.tolist(), strict=True)], dtype=np.int64)


def pieces_of_simplices(t: Ids, n: int) -> Ids:
    m, nt = t.shape
    facets = np.concatenate([np.sort(np.delete(t, i, axis=0), axis=0) for i in range(m)], axis=1)
    ids = np.unique(facets, axis=1, return_inverse=True)[1].reshape(m, nt) + nt
    links = csr_matrix((np.ones(m * nt), (np.tile(np.arange(nt), m), ids.ravel())), shape=(ids.max() + 1,) * 2)
    return connected_components(links, directed=False)[1][:nt]


def _dense(rows: Ids, columns: Ids, blocks: Reals, width: int) -> NDArray[np.float64]:
    """Return all entries of a matrix of blocks, (3 n, 3 width)."""
    matrix = np.zeros((len(rows) - 1, width, 3, 3))
    matrix[np.repeat(np.arange(len(rows) - 1), np.diff(rows)), columns] = blocks.reshape(-1, 3, 3)
    return matrix.transpose(0, 2, 1, 3).reshape(3 * len(matrix), 3 * width)


def _rows_of_part(begin: int, end: int, rows: Ids, columns: Ids, blocks: Reals, keep: str) -> NDArray[np.float64]:
    """Return rows of the part, (3 (end - begin), 3 n), with the blocks that `keep` names, and zeros elsewhere.

    `keep` is "all", or "before" or "after" for the blocks before or after the diagonal within the part.
    """
    n = len(rows) - 1
    i, j = np.indices((n, n))
    selected = {"all": i == i, "before": (begin <= j) & (j < i), "after": (i < j) & (j < end)}[keep]
    return (_dense(rows, columns, blocks, n) * np.kron(selected, np.ones((3, 3))))[3 * begin : 3 * end]


def _diagonal_of(begin: int, end: int, inverse: Reals) -> NDArray[np.float64]:
    """Return the diagonal blocks of the part, (3 (end - begin),) * 2, from their inverses."""
    matrix = np.zeros((3 * (end - begin),) * 2)
    for k, block in enumerate(inverse.reshape(-1, 3, 3)[begin:end]):
        matrix[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = np.linalg.inv(block)
    return matrix


def fill_blocks(
    begin: int,
    end: int,
    rows: Ids,
    columns: Ids,
    diagonal: Ids,
    first: Ids,
    block: Ids,
    component: Ids,
    indptr: Ids,
    indices: Ids,
    values: Reals,
    scale: float,
    blocks: Reals,
    single: Reals,
) -> None:
    """Write the blocks entry by entry; components without an unknown have `1 / scale` on the diagonal."""
    n, place = len(rows) - 1, 3 * block + component
    K = np.zeros((3 * n, 3 * n))
    K[place[np.repeat(np.arange(len(block)), np.diff(indptr))], place[indices]] = values
    bare = np.setdiff1d(np.arange(3 * n), place)
    K[bare, bare] = 1 / scale
    for i in range(begin, end):
        for k in range(rows[i], rows[i + 1]):
            blocks[9 * k : 9 * k + 9] = K[3 * i : 3 * i + 3, 3 * columns[k] : 3 * columns[k] + 3].ravel()
            single[9 * k : 9 * k + 9] = scale * blocks[9 * k : 9 * k + 9]


def product(begin: int, end: int, rows: Ids, columns: Ids, blocks: Reals, x: Reals, add: bool, out: Reals) -> None:
    """Compute `A x`."""
    part = slice(3 * begin, 3 * end)
    out[part] = _dense(rows, columns, blocks, len(x) // 3)[part] @ x + (out[part] if add else 0)


def sweep_forward(
    begin: int, end: int, rows: Ids, columns: Ids, diagonal: Ids, blocks: Reals, inverse: Reals, b: Reals, x: Reals
) -> None:
    """Solve `(L + D) x = b` within the part."""
    part = slice(3 * begin, 3 * end)
    lower = _rows_of_part(begin, end, rows, columns, blocks, "before")[:, part]
    x[part] = np.linalg.solve(lower + _diagonal_of(begin, end, inverse), b[part])


def residual_after_forward(
    begin: int, end: int, rows: Ids, columns: Ids, diagonal: Ids, blocks: Reals, extra: Reals, x: Reals, out: Reals
) -> None:
    """Compute `(L + D) x - A x`, where D has `extra` on its diagonal."""
    part = slice(3 * begin, 3 * end)
    own = np.repeat(extra, 3)[part] * x[part]
    for i in range(begin, end):
        own[3 * (i - begin) : 3 * (i - begin) + 3] += blocks.reshape(-1, 3, 3)[diagonal[i]] @ x[3 * i : 3 * i + 3]
    lower, all_of_it = (_rows_of_part(begin, end, rows, columns, blocks, which) for which in ("before", "all"))
    out[part] = own + (lower - all_of_it) @ x


def sweep_backward(
    begin: int, end: int, rows: Ids, columns: Ids, blocks: Reals, inverse: Reals, b: Reals, before: Reals, x: Reals
) -> None:
    """Solve `(U + D) (x_new - x) = b - A x` within the part; outside of the part, A x uses `before`."""
    part = slice(3 * begin, 3 * end)
    upper = _rows_of_part(begin, end, rows, columns, blocks, "after")[:, part]
    state = before.copy()
    state[part] = x[part]
    residual = b[part] - _rows_of_part(begin, end, rows, columns, blocks, "all") @ state
    x[part] += np.linalg.solve(upper + _diagonal_of(begin, end, inverse), residual)


def outside_norms(begin: int, end: int, rows: Ids, columns: Ids, blocks: Reals, extra: Reals) -> None:
    """Write half the sum of the Frobenius norms of the blocks outside of the part."""
    norms = np.linalg.norm(blocks.reshape(-1, 9), axis=1) * ((columns < begin) | (columns >= end))
    for i in range(begin, end):
        extra[i] = norms[rows[i] : rows[i + 1]].sum() / 2


def invert_diagonal(begin: int, end: int, diagonal: Ids, blocks: Reals, extra: Reals, out: Reals) -> int:
    """Write `L^-T |P|^-1 L^-1` of `D = L P L'`, and return the number of negative pivots.

    Pivots that are almost zero are replaced by the size of the block.
    """
    negative = 0
    for i in range(begin, end):
        L, S = np.eye(3), blocks.reshape(-1, 3, 3)[diagonal[i]].astype(np.float64) + extra[i] * np.eye(3)
        total = np.abs(np.diag(S)).sum() or 1.0
        pivots = []
        for k in range(3):
            pivots.append(S[k, k] if abs(S[k, k]) > 1e-12 * total else total)
            below = np.eye(3)
            below[k + 1 :, k] = S[k + 1 :, k] / pivots[k]
            inverse = np.linalg.inv(below)
            S, L = inverse @ S @ inverse.T, L @ below
        inverse = np.linalg.inv(L)
        out[9 * i : 9 * i + 9] = (inverse.T / np.abs(pivots) @ inverse).ravel()
        negative += sum(pivot < 0 for pivot in pivots)
    return negative


def multiply_blocks(
    begin: int,
    end: int,
    rows: Ids,
    columns: Ids,
    blocks: Reals,
    other_rows: Ids,
    other_columns: Ids,
    other: Reals,
    out_rows: Ids,
    out_columns: Ids,
    width: int,
    out: Reals,
) -> None:
    """Compute the blocks of `A B` that the structure of the result contains."""
    matrix = _dense(rows, columns, blocks, len(other_rows) - 1) @ _dense(other_rows, other_columns, other, width)
    for i in range(begin, end):
        for k in range(out_rows[i], out_rows[i + 1]):
            out[9 * k : 9 * k + 9] = matrix[3 * i : 3 * i + 3, 3 * out_columns[k] : 3 * out_columns[k] + 3].ravel()


def smooth_prolongator(
    begin: int,
    end: int,
    rows: Ids,
    own: Ids,
    count: int,
    inverse: Reals,
    omega: float,
    products: Reals,
    tentative: Reals,
    out: Reals,
) -> None:
    """Compute `T - omega D^-1 (A T)`."""
    for i in range(begin, end):
        row = slice(rows[i], rows[i + 1])
        out.reshape(-1, 3, 3)[row] = -omega * inverse.reshape(-1, 3, 3)[i] @ products.reshape(-1, 3, 3)[row]
        out.reshape(-1, 3, 3)[own[i] : own[i] + count] += tentative.reshape(-1, count, 3, 3)[i]


def transpose_blocks(begin: int, end: int, indices: Ids, blocks: Reals, out: Reals) -> None:
    """Write the transpose of each block from its index."""
    out.reshape(-1, 3, 3)[begin:end] = blocks.reshape(-1, 3, 3)[indices[begin:end]].transpose(0, 2, 1)


def orthonormalise(begin: int, end: int, starts: Ids, members: Ids, count: int, modes: Reals, coarse: Reals) -> None:
    """Compute `Q R` of each aggregate by projection, `R = Q' B`."""
    of_row, of_aggregate = modes.reshape(-1, count, 3, 3), coarse.reshape(-1, count, count, 3, 3)
    for a in range(begin, end):
        ids = members[starts[a] : starts[a + 1]]
        B = of_row[ids].transpose(0, 2, 1, 3).reshape(3 * len(ids), 3 * count)
        Q = np.zeros_like(B)
        for c in range(3 * count):
            v = B[:, c] - Q @ (Q.T @ B[:, c])
            v -= Q @ (Q.T @ v)
            if v @ v > 1e-16 * (B[:, c] @ B[:, c]):
                Q[:, c] = v / np.linalg.norm(v)
        of_row[ids] = Q.reshape(len(ids), 3, count, 3).transpose(0, 2, 1, 3)
        of_aggregate[a] = np.triu(Q.T @ B).reshape(count, 3, count, 3).transpose(0, 2, 1, 3)


def invert_dense(a: Reals) -> bool:
    """Return whether the matrix is positive definite; if so, replace it by its inverse."""
    if np.linalg.eigvalsh(a).min() <= 0:
        return False
    a[:] = np.linalg.inv(a)
    return True


def dot(begin: int, end: int, x: Reals, y: Reals) -> float:
    """Return the contribution of the part to `x'y`."""
    return float((x[begin:end] * y[begin:end]).sum())


def step(begin: int, end: int, alpha: float, p: Reals, q: Reals, x: Reals, r: Reals) -> float:
    """Update `x += alpha p` and `r -= alpha q`, and return `r'r`."""
    part = slice(begin, end)
    x[part] += alpha * p[part]
    r[part] -= alpha * q[part]
    return float((r[part] ** 2).sum())


def update_search_direction(begin: int, end: int, beta: float, z: Reals, p: Reals) -> None:
    """Compute `p = z + beta p`."""
    p[begin:end] = z[begin:end] + beta * p[begin:end]


def multiply_diagonal(begin: int, end: int, blocks: Reals, x: Reals, out: Reals) -> None:
    """Multiply by the diagonal blocks, block by block."""
    out.reshape(-1, 3)[begin:end] = np.einsum("nij,nj->ni", blocks.reshape(-1, 3, 3)[begin:end], x.reshape(-1, 3)[begin:end])


def matrix_of_edges(edges: Ids, blocks: Reals, diagonal: Reals, grounded: Ids, ground: Reals, n: int) -> Reals:
    """Return the dense matrix (3 n, 3 n) with `A_ab`, `A_ba = A_ab'`, and `A_aa`, either user-supplied or `s_a - sum_b A_ab`, with
    the ground blocks added.
    """
    A = np.zeros((n, n, 3, 3))
    shifted = len(diagonal) == 3 * n
    A[range(n), range(n)] = diagonal.reshape(n, 3, 1) * np.eye(3) if shifted else diagonal.reshape(n, 3, 3)
    for (a, b), block in zip(edges, blocks.reshape(-1, 3, 3), strict=True):
        A[a, b] += block
        A[b, a] += block.T
        A[a, a] -= shifted * block
        A[b, b] -= shifted * block.T
    for a, block in zip(grounded, ground.reshape(-1, 3, 3), strict=True):
        A[a, a] += block
    return A.swapaxes(1, 2).reshape(3 * n, 3 * n)


# Kernels of motion.
