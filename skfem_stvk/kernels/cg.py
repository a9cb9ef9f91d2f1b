"""Conjugate gradients on the blocks of edges, all compiled: no Python in the loop, nothing allocated, each block read once an iteration.

    (A v)_a = s_a v_a + sum_b A_ab (v_b - v_a)        of an edge form, with a shift `s`, diagonal
    (A v)_a = A_aa v_a + sum_b A_ab v_b               of an assembled matrix                            A_ba = A_ab'

Arrays: `edges` (ne, 2) block rows, their `blocks` (9 ne,), row by row; `diagonal` is `s` (3 n,) or `A_aa` (9 n,), and its length says
which; `inverse` (9 n,) of the `A_aa`. Vectors have three components a block row; those `held` are no unknowns and stay zero in all of them, which
is the same as to gather those that are not (Baraff and Witkin's filter). `work` (4, 3 n) is x, r, p and q; in q stands `z = D^-1 r`
between iterations. `state` is `|r|`, `z'r`, beta.
"""

from __future__ import annotations

import numpy as np

from .compiled import Ids, Reals, inlined, kernel

I = np.uint64

#: How `iterate` ends.
SMALL, MORE, NEGATIVE, NOT_FINITE = range(4)
#: Places in `state` and in `work`.
NORM, RHO, BETA = range(3)
X, R, P, Q = range(4)


@inlined
def _times(blocks, k, x0, x1, x2):
    """A block times a vector."""
    return (
        blocks[k] * x0 + blocks[k + I(1)] * x1 + blocks[k + I(2)] * x2,
        blocks[k + I(3)] * x0 + blocks[k + I(4)] * x1 + blocks[k + I(5)] * x2,
        blocks[k + I(6)] * x0 + blocks[k + I(7)] * x1 + blocks[k + I(8)] * x2,
    )


@inlined
def _transposed_times(blocks, k, x0, x1, x2):
    """The transpose of a block times a vector."""
    return (
        blocks[k] * x0 + blocks[k + I(3)] * x1 + blocks[k + I(6)] * x2,
        blocks[k + I(1)] * x0 + blocks[k + I(4)] * x1 + blocks[k + I(7)] * x2,
        blocks[k + I(2)] * x0 + blocks[k + I(5)] * x1 + blocks[k + I(8)] * x2,
    )


@inlined
def _add(out, a, x0, x1, x2):
    out[a] += x0
    out[a + I(1)] += x1
    out[a + I(2)] += x2


@inlined
def _add_differences(edges, blocks, v, out):
    """`out_a += sum_b A_ab (v_b - v_a)`."""
    for e in range(len(edges)):
        i = I(e)
        a, b = I(3) * I(edges[i, I(0)]), I(3) * I(edges[i, I(1)])
        x, y, z = v[b] - v[a], v[b + I(1)] - v[a + I(1)], v[b + I(2)] - v[a + I(2)]
        s0, s1, s2 = _times(blocks, I(9) * i, x, y, z)
        t0, t1, t2 = _transposed_times(blocks, I(9) * i, x, y, z)
        _add(out, a, s0, s1, s2)
        _add(out, b, -t0, -t1, -t2)


@inlined
def _add_values(edges, blocks, v, out):
    """`out_a += sum_b A_ab v_b`."""
    for e in range(len(edges)):
        i = I(e)
        a, b = I(3) * I(edges[i, I(0)]), I(3) * I(edges[i, I(1)])
        s0, s1, s2 = _times(blocks, I(9) * i, v[b], v[b + I(1)], v[b + I(2)])
        t0, t1, t2 = _transposed_times(blocks, I(9) * i, v[a], v[a + I(1)], v[a + I(2)])
        _add(out, a, s0, s1, s2)
        _add(out, b, t0, t1, t2)


@inlined
def _turn(beta, edges, blocks, diagonal, held, p, q):
    """`p = z + beta p` with z from q, `A p` in its place, nothing at held components; `p'A p`."""
    if len(diagonal) == len(p):
        for i in range(len(p)):
            p[I(i)] = q[I(i)] + beta * p[I(i)]
            q[I(i)] = diagonal[I(i)] * p[I(i)]
        _add_differences(edges, blocks, p, q)
    else:
        for i in range(len(p) // 3):
            a, b, c = I(3 * i), I(3 * i + 1), I(3 * i + 2)
            p[a], p[b], p[c] = q[a] + beta * p[a], q[b] + beta * p[b], q[c] + beta * p[c]
            q[a], q[b], q[c] = _times(diagonal, I(9 * i), p[a], p[b], p[c])
        _add_values(edges, blocks, p, q)
    for i in range(len(held)):
        q[I(held[I(i)])] = 0.0
    total = 0.0
    for i in range(len(p)):
        total += p[I(i)] * q[I(i)]
    return total


@inlined
def _step(alpha, inverse, x, r, p, q):
    """`x += alpha p`, `r -= alpha q`, `z = D^-1 r` in the place of q; `r'r`, `z'r` and `z'q`."""
    square = rho = change = 0.0
    for i in range(len(x) // 3):
        a, b, c = I(3 * i), I(3 * i + 1), I(3 * i + 2)
        x[a] += alpha * p[a]
        x[b] += alpha * p[b]
        x[c] += alpha * p[c]
        r0, r1, r2 = r[a] - alpha * q[a], r[b] - alpha * q[b], r[c] - alpha * q[c]
        z0, z1, z2 = _times(inverse, I(9 * i), r0, r1, r2)
        square += r0 * r0 + r1 * r1 + r2 * r2
        rho += z0 * r0 + z1 * r1 + z2 * r2
        change += z0 * q[a] + z1 * q[b] + z2 * q[c]
        r[a], r[b], r[c] = r0, r1, r2
        q[a], q[b], q[c] = z0, z1, z2
    return square, rho, change


@kernel
def residual(
    edges: Ids, blocks: Reals, diagonal: Reals, inverse: Reals, held: Ids, places: Ids, b: Reals, state: Reals, work: Reals
) -> None:
    """`r = b - A x`, and with it the state of the first iteration; `places` (n,) has the entries of b in the vectors.

    Where x is zero, there is no product.
    """
    x, r, p, q = work[X], work[R], work[P], work[Q]
    size = 0.0
    for i in range(len(x)):
        size += abs(x[I(i)])
        p[I(i)] = 0.0
        q[I(i)] = x[I(i)]
    for i in range(len(places)):
        r[I(places[I(i)])] = b[I(i)]
    if size != 0:
        _turn(0.0, edges, blocks, diagonal, held, p, q)
    square, rho, _ = _step(0.0 if size == 0 else 1.0, inverse, p, r, p, q)
    for i in range(len(p)):
        p[I(i)] = 0.0
    state[NORM], state[RHO], state[BETA] = np.sqrt(square), rho, 0.0


@kernel
def iterate(
    edges: Ids,
    blocks: Reals,
    diagonal: Reals,
    inverse: Reals,
    held: Ids,
    enough: float,
    most: int,
    state: Reals,
    work: Reals,
) -> tuple[int, int]:
    """At most so many iterations, until `|r| <= enough` or something else happens: how it ended, and how many there were.

    `beta = z'(r - r_before) / (z'r)_before` (Polak, Ribiere), where `r - r_before = -alpha q`.
    """
    x, r, p, q = work[X], work[R], work[P], work[Q]
    norm, rho, beta = state[NORM], state[RHO], state[BETA]
    done, ended = 0, MORE
    while norm > enough and done < most:
        if not rho > 0:
            ended = NEGATIVE if np.isfinite(rho) else NOT_FINITE
            break
        curvature = _turn(beta, edges, blocks, diagonal, held, p, q)
        if not curvature > 0:
            ended = NEGATIVE if np.isfinite(curvature) else NOT_FINITE
            break
        alpha = rho / curvature
        square, after, change = _step(alpha, inverse, x, r, p, q)
        beta, rho, norm = max(-alpha * change / rho, 0.0), after, np.sqrt(square)
        done += 1
        if not np.isfinite(square):
            ended = NOT_FINITE
            break
    state[NORM], state[RHO], state[BETA] = norm, rho, beta
    return SMALL if ended == MORE and norm <= enough else ended, done


@kernel
def shifted_diagonal(edges: Ids, blocks: Reals, held: Ids, places: Ids, shift: Reals, diagonal: Reals, out: Reals) -> float:
    """`shift` (n,) of the unknowns at their `places` in `diagonal` (3 n,); `A_aa = s_a - sum_b A_ab` to `out` (9 n,), zero in held rows and columns.

    An empty `shift` is none. Returns a sum that is not finite if any entry is not.
    """
    for i in range(len(out)):
        out[I(i)] = 0.0
    for e in range(len(edges)):
        i = I(e)
        a, b, k = I(9) * I(edges[i, I(0)]), I(9) * I(edges[i, I(1)]), I(9) * i
        for r in range(3):
            for c in range(3):
                out[a + I(3 * r + c)] -= blocks[k + I(3 * r + c)]
                out[b + I(3 * r + c)] -= blocks[k + I(3 * c + r)]
    for i in range(len(shift)):
        place = I(places[I(i)])
        diagonal[place] = shift[I(i)]
        out[I(9) * (place // I(3)) + I(4) * (place % I(3))] += shift[I(i)]
    for i in range(len(held)):
        place = I(held[I(i)])
        row, c = I(9) * (place // I(3)), place % I(3)
        for r in range(3):
            out[row + I(3 * r) + c] = 0.0
            out[row + I(3) * c + I(r)] = 0.0
    total = 0.0
    for i in range(len(out)):
        total += out[I(i)]
    return total


@kernel
def fill_edges(
    rows: Ids,
    columns: Ids,
    first: Ids,
    block: Ids,
    component: Ids,
    indptr: Ids,
    indices: Ids,
    values: Reals,
    blocks: Reals,
    diagonal: Reals,
) -> None:
    """A symmetric CSR matrix as `blocks` above the diagonal and `diagonal` blocks (9 n,).

    `rows`, `columns` are the structure above the diagonal. Unknown `w` is `component[w]` of block row `block[w]`; those of block row
    `i` are `first[i]` and the next ones.
    """
    for i in range(len(blocks)):
        blocks[I(i)] = 0.0
    for i in range(len(diagonal)):
        diagonal[I(i)] = 0.0
    for i in range(len(rows) - 1):
        u = first[I(i)]
        while u < len(block) and block[I(u)] == i:
            k, row = rows[I(i)], 9 * i + 3 * component[I(u)]
            for e in range(indptr[I(u)], indptr[I(u + 1)]):
                w, value = I(indices[I(e)]), values[I(e)]
                j = block[w]
                if j == i:
                    diagonal[I(row + component[w])] = value
                elif j > i:
                    while columns[I(k)] != j:
                        k += 1 if k + 1 < rows[I(i + 1)] else rows[I(i)] - k
                    blocks[I(9 * k + 3 * component[I(u)] + component[w])] = value
            u += 1
