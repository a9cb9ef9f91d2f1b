"""Sparse matrices of 3 x 3 blocks: products, Gauss-Seidel sweeps, and the operations of algebraic multigrid.

Arrays: block row `i` of a matrix has the blocks `rows[i]` ... `rows[i + 1]`, with ascending block `columns`. `blocks` is (9 nnz,),
row by row. `diagonal[i]` is the index of the diagonal block. Vectors have three components per block row. A kernel processes block
rows `begin` to `end`. Gauss-Seidel uses the previous values of the rows of other parts.
"""

from __future__ import annotations

import numpy as np
from numpy import uint64

from .compiled import Ids, Reals, inlined, kernel


@kernel
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
    """Write the values of a CSR matrix to `blocks`, and `scale` times the values to `single`.

    Unknown `w` is `component[w]` of block row `block[w]`. The unknowns of block row `i` are `first[i]` and the following ones.
    Components without an unknown get the diagonal `1/scale`.
    """
    block_at = np.empty(len(rows), np.int64)
    for i in range(begin, end):
        for k in range(rows[uint64(i)], rows[uint64(i + 1)]):
            block_at[uint64(columns[uint64(k)])] = 9 * k
        for k in range(9 * rows[uint64(i)], 9 * rows[uint64(i + 1)]):
            blocks[uint64(k)] = 0
            single[uint64(k)] = 0
        for c in range(3):
            blocks[uint64(9 * diagonal[uint64(i)] + 4 * c)] = 1 / scale
            single[uint64(9 * diagonal[uint64(i)] + 4 * c)] = 1
        u = first[uint64(i)]
        while u < len(block) and block[uint64(u)] == i:
            for e in range(indptr[uint64(u)], indptr[uint64(u + 1)]):
                w = uint64(indices[uint64(e)])
                to = uint64(block_at[uint64(block[w])] + 3 * component[uint64(u)] + component[w])
                blocks[to] = values[uint64(e)]
                single[to] = scale * values[uint64(e)]
            u += 1


@inlined
def _row(begin, end, columns, blocks, x):
    """Return the sum of `A_ij x_j` over the block indices `begin` to `end`."""
    s0 = s1 = s2 = blocks.dtype.type(0)
    for i in range(begin, end):
        k, c = uint64(9) * uint64(i), uint64(3) * uint64(columns[uint64(i)])
        x0, x1, x2 = x[c], x[c + uint64(1)], x[c + uint64(2)]
        s0 += blocks[k] * x0 + blocks[k + uint64(1)] * x1 + blocks[k + uint64(2)] * x2
        s1 += blocks[k + uint64(3)] * x0 + blocks[k + uint64(4)] * x1 + blocks[k + uint64(5)] * x2
        s2 += blocks[k + uint64(6)] * x0 + blocks[k + uint64(7)] * x1 + blocks[k + uint64(8)] * x2
    return s0, s1, s2


@inlined
def _times(blocks, k, x0, x1, x2):
    """Return a block times a vector."""
    return (
        blocks[k] * x0 + blocks[k + uint64(1)] * x1 + blocks[k + uint64(2)] * x2,
        blocks[k + uint64(3)] * x0 + blocks[k + uint64(4)] * x1 + blocks[k + uint64(5)] * x2,
        blocks[k + uint64(6)] * x0 + blocks[k + uint64(7)] * x1 + blocks[k + uint64(8)] * x2,
    )


@kernel
def product(begin: int, end: int, rows: Ids, columns: Ids, blocks: Reals, x: Reals, add: bool, out: Reals) -> None:
    """Write `A x` to `out`, or add it."""
    for i in range(begin, end):
        s0, s1, s2 = _row(rows[uint64(i)], rows[uint64(i + 1)], columns, blocks, x)
        to = uint64(3) * uint64(i)
        if add:
            out[to] += s0
            out[to + uint64(1)] += s1
            out[to + uint64(2)] += s2
        else:
            out[to] = s0
            out[to + uint64(1)] = s1
            out[to + uint64(2)] = s2


@kernel
def sweep_forward(
    begin: int, end: int, rows: Ids, columns: Ids, diagonal: Ids, blocks: Reals, inverse: Reals, b: Reals, x: Reals
) -> None:
    """Apply Gauss-Seidel from `x = 0`, rows ascending: `x_i = D_i^-1 (b_i - sum_{begin <= j < i} A_ij x_j)`.

    `inverse` has the blocks `D_i^-1`.
    """
    for i in range(begin, end):
        inner = rows[uint64(i)]
        while columns[uint64(inner)] < begin:
            inner += 1
        s0, s1, s2 = _row(inner, diagonal[uint64(i)], columns, blocks, x)
        at = uint64(3) * uint64(i)
        x0, x1, x2 = _times(inverse, uint64(9) * uint64(i), b[at] - s0, b[at + uint64(1)] - s1, b[at + uint64(2)] - s2)
        x[at], x[at + uint64(1)], x[at + uint64(2)] = x0, x1, x2


@kernel
def residual_after_forward(
    begin: int, end: int, rows: Ids, columns: Ids, diagonal: Ids, blocks: Reals, extra: Reals, x: Reals, out: Reals
) -> None:
    """Write `b - A x` after `sweep_forward`, that is, the terms it omits: `extra_i x_i - sum_{j < begin or j > i} A_ij x_j`."""
    for i in range(begin, end):
        inner = rows[uint64(i)]
        while columns[uint64(inner)] < begin:
            inner += 1
        s0, s1, s2 = _row(rows[uint64(i)], inner, columns, blocks, x)
        t0, t1, t2 = _row(diagonal[uint64(i)] + 1, rows[uint64(i + 1)], columns, blocks, x)
        at, e = uint64(3) * uint64(i), extra[uint64(i)]
        out[at] = e * x[at] - s0 - t0
        out[at + uint64(1)] = e * x[at + uint64(1)] - s1 - t1
        out[at + uint64(2)] = e * x[at + uint64(2)] - s2 - t2


@kernel
def sweep_backward(
    begin: int, end: int, rows: Ids, columns: Ids, blocks: Reals, inverse: Reals, b: Reals, before: Reals, x: Reals
) -> None:
    """Apply Gauss-Seidel, rows descending: `x_i += D_i^-1 (b_i - sum_j A_ij x_j)`, with `before_j` outside of the part."""
    for i in range(end - 1, begin - 1, -1):
        inner, outer = rows[uint64(i)], rows[uint64(i + 1)]
        while columns[uint64(inner)] < begin:
            inner += 1
        while columns[uint64(outer - 1)] >= end:
            outer -= 1
        r0, r1, r2 = _row(rows[uint64(i)], inner, columns, blocks, before)
        s0, s1, s2 = _row(inner, outer, columns, blocks, x)
        t0, t1, t2 = _row(outer, rows[uint64(i + 1)], columns, blocks, before)
        at = uint64(3) * uint64(i)
        y0, y1, y2 = _times(
            inverse, uint64(9) * uint64(i), b[at] - r0 - s0 - t0, b[at + uint64(1)] - r1 - s1 - t1, b[at + uint64(2)] - r2 - s2 - t2
        )
        x[at] += y0
        x[at + uint64(1)] += y1
        x[at + uint64(2)] += y2


@kernel
def outside_norms(begin: int, end: int, rows: Ids, columns: Ids, blocks: Reals, extra: Reals) -> None:
    """Write half the sum of the norms of the blocks of each row outside of the part to `extra`.

    Added to the diagonal, this makes Gauss-Seidel in parts converge.
    """
    for i in range(begin, end):
        total = 0.0
        for j in range(rows[uint64(i)], rows[uint64(i + 1)]):
            if columns[uint64(j)] < begin or columns[uint64(j)] >= end:
                square = 0.0
                for k in range(9 * j, 9 * j + 9):
                    square += blocks[uint64(k)] ** 2
                total += np.sqrt(square)
        extra[uint64(i)] = total / 2


@kernel
def invert_diagonal(begin: int, end: int, diagonal: Ids, blocks: Reals, extra: Reals, out: Reals) -> int:
    """Write `(D_i + extra_i 1)^-1` of the symmetric diagonal blocks, by `D = L P L'` with `|P|` in place of P.

    The result is always positive definite. Pivots that are zero up to round-off are replaced by the size of the block. Returns the
    number of negative pivots.
    """
    negative = 0
    for i in range(begin, end):
        k, e = uint64(9) * uint64(diagonal[uint64(i)]), extra[uint64(i)]
        a, b, c = float(blocks[k]) + e, float(blocks[k + uint64(1)]), float(blocks[k + uint64(2)])
        d, f, g = float(blocks[k + uint64(4)]) + e, float(blocks[k + uint64(5)]), float(blocks[k + uint64(8)]) + e
        total = abs(a) + abs(d) + abs(g)
        total = total if total > 0 else 1.0
        least = 1e-12 * total
        a = a if abs(a) > least else total
        l, m = b / a, c / a
        d, f = d - l * b, f - l * c
        d = d if abs(d) > least else total
        n = f / d
        g = g - m * c - n * f
        g = g if abs(g) > least else total
        negative += (a < 0) + (d < 0) + (g < 0)
        p, q, s = 1 / abs(a), 1 / abs(d), 1 / abs(g)
        o = l * n - m
        k = uint64(9) * uint64(i)
        out[k] = p + l * l * q + o * o * s
        out[k + uint64(1)] = out[k + uint64(3)] = -l * q - o * n * s
        out[k + uint64(2)] = out[k + uint64(6)] = o * s
        out[k + uint64(4)] = q + n * n * s
        out[k + uint64(5)] = out[k + uint64(7)] = -n * s
        out[k + uint64(8)] = s
    return negative


@kernel
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
    """Write the product of two matrices, in a structure that contains all its blocks; `width` is its number of block columns."""
    block_at = np.empty(width, np.int64)
    for i in range(begin, end):
        for k in range(out_rows[uint64(i)], out_rows[uint64(i + 1)]):
            block_at[uint64(out_columns[uint64(k)])] = 9 * k
        for k in range(9 * out_rows[uint64(i)], 9 * out_rows[uint64(i + 1)]):
            out[uint64(k)] = 0
        for j in range(rows[uint64(i)], rows[uint64(i + 1)]):
            at, via = uint64(9) * uint64(j), uint64(columns[uint64(j)])
            a0, a1, a2 = blocks[at], blocks[at + uint64(1)], blocks[at + uint64(2)]
            a3, a4, a5 = blocks[at + uint64(3)], blocks[at + uint64(4)], blocks[at + uint64(5)]
            a6, a7, a8 = blocks[at + uint64(6)], blocks[at + uint64(7)], blocks[at + uint64(8)]
            for k in range(other_rows[via], other_rows[via + uint64(1)]):
                to, b = uint64(block_at[uint64(other_columns[uint64(k)])]), uint64(9) * uint64(k)
                for c in range(3):
                    b0, b1, b2 = other[b + uint64(c)], other[b + uint64(3 + c)], other[b + uint64(6 + c)]
                    out[to + uint64(c)] += a0 * b0 + a1 * b1 + a2 * b2
                    out[to + uint64(3 + c)] += a3 * b0 + a4 * b1 + a5 * b2
                    out[to + uint64(6 + c)] += a6 * b0 + a7 * b1 + a8 * b2


@kernel
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
    """Write `T - omega D^-1 (A T)` in the structure of `A T`; row `i` of T has `count` blocks from index `own[i]` on."""
    for i in range(begin, end):
        at = uint64(9) * uint64(i)
        for k in range(rows[uint64(i)], rows[uint64(i + 1)]):
            to = uint64(9) * uint64(k)
            for c in range(3):
                y0, y1, y2 = _times(
                    inverse, at, products[to + uint64(c)], products[to + uint64(3 + c)], products[to + uint64(6 + c)]
                )
                out[to + uint64(c)] = -omega * y0
                out[to + uint64(3 + c)] = -omega * y1
                out[to + uint64(6 + c)] = -omega * y2
        for k in range(9 * count):
            out[uint64(9 * own[uint64(i)] + k)] += tentative[uint64(9 * count * i + k)]


@kernel
def transpose_blocks(begin: int, end: int, indices: Ids, blocks: Reals, out: Reals) -> None:
    """Write the transpose of block `indices[k]` to block `k` of `out`."""
    for k in range(begin, end):
        to, at = uint64(9) * uint64(k), uint64(9) * uint64(indices[uint64(k)])
        for r in range(3):
            for c in range(3):
                out[to + uint64(3 * r + c)] = blocks[at + uint64(3 * c + r)]


@kernel
def orthonormalise(begin: int, end: int, starts: Ids, members: Ids, count: int, modes: Reals, coarse: Reals) -> None:
    """Factorise modes `B = Q R` by aggregate: Q overwrites `modes`, R is written to `coarse`. A dependent mode becomes zero.

    Aggregate `a` consists of the block rows `members[starts[a]]` ... `members[starts[a + 1] - 1]`. `modes` has `count` blocks per
    row, `coarse` `count^2` per aggregate.
    """
    for a in range(begin, end):
        for k in range(9 * count * count * a, 9 * count * count * (a + 1)):
            coarse[k] = 0
        for c in range(3 * count):
            at_c = 9 * (c // 3) + c % 3
            size = 0.0
            for j in range(starts[a], starts[a + 1]):
                for r in range(3):
                    size += modes[9 * count * members[j] + at_c + 3 * r] ** 2
            for _ in range(2):
                for e in range(c):
                    at_e, dot = 9 * (e // 3) + e % 3, 0.0
                    for j in range(starts[a], starts[a + 1]):
                        m = 9 * count * members[j]
                        for r in range(0, 9, 3):
                            dot += modes[m + at_c + r] * modes[m + at_e + r]
                    for j in range(starts[a], starts[a + 1]):
                        m = 9 * count * members[j]
                        for r in range(0, 9, 3):
                            modes[m + at_c + r] -= dot * modes[m + at_e + r]
                    coarse[9 * count * (count * a + e // 3) + 9 * (c // 3) + 3 * (e % 3) + c % 3] += dot
            left = 0.0
            for j in range(starts[a], starts[a + 1]):
                for r in range(3):
                    left += modes[9 * count * members[j] + at_c + 3 * r] ** 2
            norm = np.sqrt(left) if left > 1e-16 * size else 0.0
            for j in range(starts[a], starts[a + 1]):
                for r in range(3):
                    m = 9 * count * members[j] + at_c + 3 * r
                    modes[m] = modes[m] / norm if norm > 0 else 0.0
            coarse[9 * count * (count * a + c // 3) + 9 * (c // 3) + 3 * (c % 3) + c % 3] = norm


@kernel
def invert_dense(a: Reals) -> bool:
    """Invert a symmetric matrix (n, n) in place, by Gauss-Jordan elimination, and return whether it is positive definite.

    If it is not, the content of `a` is meaningless.
    """
    n, least = len(a), 0.0
    for k in range(n):
        least = max(least, 1e-14 * a[k, k])
    for k in range(n):
        pivot = a[k, k]
        if not pivot > least:
            return False
        a[k, k] = 1.0
        for j in range(n):
            a[k, j] /= pivot
        for i in range(n):
            if i != k:
                factor = a[i, k]
                a[i, k] = 0.0
                for j in range(n):
                    a[i, j] -= factor * a[k, j]
    return True


@kernel
def dot(begin: int, end: int, x: Reals, y: Reals) -> float:
    """Return the contribution of the part to `x'y`."""
    total = 0.0
    for i in range(begin, end):
        total += x[uint64(i)] * y[uint64(i)]
    return total


@kernel
def step(begin: int, end: int, alpha: float, p: Reals, q: Reals, x: Reals, r: Reals) -> float:
    """Update `x += alpha p` and `r -= alpha q`, and return the contribution of the part to `r'r`."""
    total = 0.0
    for i in range(begin, end):
        x[uint64(i)] += alpha * p[uint64(i)]
        r[uint64(i)] -= alpha * q[uint64(i)]
        total += r[uint64(i)] * r[uint64(i)]
    return total


@kernel
def update_search_direction(begin: int, end: int, beta: float, z: Reals, p: Reals) -> None:
    """Update the search direction, `p = z + beta p`."""
    for i in range(begin, end):
        p[uint64(i)] = z[uint64(i)] + beta * p[uint64(i)]


@kernel
def multiply_diagonal(begin: int, end: int, blocks: Reals, x: Reals, out: Reals) -> None:
    """Write the product of a block diagonal matrix and x."""
    for i in range(begin, end):
        at = uint64(3) * uint64(i)
        y0, y1, y2 = _times(blocks, uint64(9) * uint64(i), x[at], x[at + uint64(1)], x[at + uint64(2)])
        out[at], out[at + uint64(1)], out[at + uint64(2)] = y0, y1, y2
