"""Conjugate gradients on edge blocks, compiled as a whole: no Python in the loop, and no allocation.

    (A v)_a = (S_a + G_a) v_a + sum_b A_ab (v_b - v_a)        of an edge form, with a shift, diagonal `S_a`, and ground blocks `G_a`
    (A v)_a = A_aa v_a + sum_b A_ab v_b               of an assembled matrix                            A_ba = A_ab'

With `A = D + L + L'`, D the diagonal blocks and L the blocks below the diagonal, the preconditioner is

    M = (E + L) E^-1 (E + L')      E = D / omega       SSOR, 0 < omega < 2, up to a constant factor, which has no effect
    M = D                          omega = 0           which means E = D and L = 0 in all that follows

SSOR needs no product with A (Eisenstat 1981). With r the residual and t the search direction of x, the loop has

    s = E (E + L)^-1 r      p = (E + L') t      u = E (E + L)^-1 A t = h + E w      h = E t      w = (E + L)^-1 (p - (2 - omega) h)

Therefore an iteration is a backward sweep, for t, and a forward sweep, for u, each over all blocks. The scalar products are `t'A t
= p'(t + w)` and `r'M^-1 r = s'E^-1 s`.

Ground blocks are few, for nodes in contact: `grounded` (m,) are their block rows, `ground` (9 m,) the blocks.

Arrays: `edges` (ne, 2) are block rows, and `blocks` (9 ne,) their blocks, row by row. For SSOR the edges are sorted, with a < b in
each. `diagonal` is S (3 n,) or `A_aa` (9 n,); its length distinguishes the two. `inverse` (9 n,) are the inverses of the blocks of
E. Vectors have three components per block row.

The components `constrained` are not unknowns. Rows and columns of `inverse` are zero there, and x, s, p, t and u remain zero.
This is equivalent to gathering the unknowns (the filter of Baraff and Witkin).

The rows of `work` (6, 3 n) are x, s, p, t, h and u; h is also a scratch array. `state` holds `|r|` and `r'M^-1 r` when `|r|` was
last computed, the current `r'M^-1 r`, and beta.
"""

from __future__ import annotations

import numpy as np
from numpy import uint64

from .compiled import Ids, Reals, inlined, kernel

#: Results of `iterate`.
CONVERGED, UNFINISHED, NEGATIVE, NOT_FINITE = range(4)
#: Indices in `state` and in `work`.
NORM, RHO_AT_NORM, RHO, BETA = range(4)
X, S, P, T, H, U = range(6)
#: `|r|` is computed when it is estimated to have fallen to this fraction of its last value.
REDUCTION = 0.1


@inlined
def _times(blocks, k, x0, x1, x2):
    """Return a block times a vector."""
    return (
        blocks[k] * x0 + blocks[k + uint64(1)] * x1 + blocks[k + uint64(2)] * x2,
        blocks[k + uint64(3)] * x0 + blocks[k + uint64(4)] * x1 + blocks[k + uint64(5)] * x2,
        blocks[k + uint64(6)] * x0 + blocks[k + uint64(7)] * x1 + blocks[k + uint64(8)] * x2,
    )


@inlined
def _transposed_times(blocks, k, x0, x1, x2):
    """Return the transpose of a block times a vector."""
    return (
        blocks[k] * x0 + blocks[k + uint64(3)] * x1 + blocks[k + uint64(6)] * x2,
        blocks[k + uint64(1)] * x0 + blocks[k + uint64(4)] * x1 + blocks[k + uint64(7)] * x2,
        blocks[k + uint64(2)] * x0 + blocks[k + uint64(5)] * x1 + blocks[k + uint64(8)] * x2,
    )


@inlined
def _add(out, a, x0, x1, x2):
    out[a] += x0
    out[a + uint64(1)] += x1
    out[a + uint64(2)] += x2


@inlined
def _add_differences(edges, blocks, v, out):
    """Compute `out_a += sum_b A_ab (v_b - v_a)`."""
    for e in range(len(edges)):
        i = uint64(e)
        a, b = uint64(3) * uint64(edges[i, uint64(0)]), uint64(3) * uint64(edges[i, uint64(1)])
        x, y, z = v[b] - v[a], v[b + uint64(1)] - v[a + uint64(1)], v[b + uint64(2)] - v[a + uint64(2)]
        s0, s1, s2 = _times(blocks, uint64(9) * i, x, y, z)
        t0, t1, t2 = _transposed_times(blocks, uint64(9) * i, x, y, z)
        _add(out, a, s0, s1, s2)
        _add(out, b, -t0, -t1, -t2)


@inlined
def _add_values(edges, blocks, v, out):
    """Compute `out_a += sum_b A_ab v_b`."""
    for e in range(len(edges)):
        i = uint64(e)
        a, b = uint64(3) * uint64(edges[i, uint64(0)]), uint64(3) * uint64(edges[i, uint64(1)])
        s0, s1, s2 = _times(blocks, uint64(9) * i, v[b], v[b + uint64(1)], v[b + uint64(2)])
        t0, t1, t2 = _transposed_times(blocks, uint64(9) * i, v[a], v[a + uint64(1)], v[a + uint64(2)])
        _add(out, a, s0, s1, s2)
        _add(out, b, t0, t1, t2)


@inlined
def _multiply_diagonal(blocks, v, out):
    """Multiply by a block diagonal matrix."""
    for i in range(len(v) // 3):
        a = uint64(3 * i)
        out[a], out[a + uint64(1)], out[a + uint64(2)] = _times(blocks, uint64(9 * i), v[a], v[a + uint64(1)], v[a + uint64(2)])


@inlined
def _multiply(edges, blocks, diagonal, grounded, ground, constrained, v, out):
    """Write `A v`, with zeros at constrained components."""
    if len(diagonal) == len(v):
        for i in range(len(v)):
            out[uint64(i)] = diagonal[uint64(i)] * v[uint64(i)]
        _add_differences(edges, blocks, v, out)
    else:
        _multiply_diagonal(diagonal, v, out)
        _add_values(edges, blocks, v, out)
    for i in range(len(grounded)):
        a = uint64(3) * uint64(grounded[uint64(i)])
        s0, s1, s2 = _times(ground, uint64(9 * i), v[a], v[a + uint64(1)], v[a + uint64(2)])
        _add(out, a, s0, s1, s2)
    _zero_constrained(constrained, out)


@inlined
def _zero_constrained(constrained, v):
    for i in range(len(constrained)):
        v[uint64(constrained[uint64(i)])] = 0.0


@inlined
def _backward(edges, blocks, inverse, omega, p, t, h, u):
    """Compute `t = (E + L')^-1 p`, `h = E t` and `u = p + (omega - 1) h`.

    Rows are processed from last to first, and in each row the nearest neighbour last. The result of the preceding row is then
    needed as late as possible.
    """
    k = len(edges) - 1
    for i in range(len(p) // 3 - 1, -1, -1):
        a, x, y, z = uint64(3 * i), 0.0, 0.0, 0.0
        while k >= 0 and edges[uint64(k), uint64(0)] == i:
            b = uint64(3) * uint64(edges[uint64(k), uint64(1)])
            s0, s1, s2 = _times(blocks, uint64(9 * k), t[b], t[b + uint64(1)], t[b + uint64(2)])
            x, y, z, k = x + s0, y + s1, z + s2, k - 1
        x, y, z = p[a] - x, p[a + uint64(1)] - y, p[a + uint64(2)] - z
        t[a], t[a + uint64(1)], t[a + uint64(2)] = _times(inverse, uint64(9 * i), x, y, z)
        h[a], h[a + uint64(1)], h[a + uint64(2)] = x, y, z
        c = omega - 1
        u[a], u[a + uint64(1)], u[a + uint64(2)] = p[a] + c * x, p[a + uint64(1)] + c * y, p[a + uint64(2)] + c * z


@inlined
def _forward(edges, blocks, inverse, p, t, h, u):
    """Compute `w = (E + L)^-1 (u - h)`, write `u - L w` to u, and return `p'(t + w)`."""
    k, total = 0, 0.0
    for i in range(len(p) // 3):
        a = uint64(3 * i)
        x, y, z = _times(
            inverse, uint64(9 * i), u[a] - h[a], u[a + uint64(1)] - h[a + uint64(1)], u[a + uint64(2)] - h[a + uint64(2)]
        )
        total += p[a] * (t[a] + x) + p[a + uint64(1)] * (t[a + uint64(1)] + y) + p[a + uint64(2)] * (t[a + uint64(2)] + z)
        while k < len(edges) and edges[uint64(k), uint64(0)] == i:
            s0, s1, s2 = _transposed_times(blocks, uint64(9 * k), x, y, z)
            _add(u, uint64(3) * uint64(edges[uint64(k), uint64(1)]), -s0, -s1, -s2)
            k += 1
    return total


@inlined
def _update_search_direction(beta, edges, blocks, diagonal, grounded, ground, inverse, constrained, omega, s, p, t, h, u):
    """Update `p = s + beta p`, compute the search direction `t` and the change `u` of s along it, and return `t'A t`."""
    for i in range(len(p)):
        p[uint64(i)] = s[uint64(i)] + beta * p[uint64(i)]
    if omega > 0:
        _backward(edges, blocks, inverse, omega, p, t, h, u)
        total = _forward(edges, blocks, inverse, p, t, h, u)
        _zero_constrained(constrained, u)
    else:
        _multiply_diagonal(inverse, p, t)
        _multiply(edges, blocks, diagonal, grounded, ground, constrained, t, u)
        total = 0.0
        for i in range(len(p)):
            total += t[uint64(i)] * u[uint64(i)]
    return total


@inlined
def _step(alpha, inverse, x, s, t, u):
    """Update `x += alpha t` and `s -= alpha u`, and return `s'E^-1 s`."""
    rho = 0.0
    for i in range(len(x) // 3):
        a, b, c = uint64(3 * i), uint64(3 * i + 1), uint64(3 * i + 2)
        x[a] += alpha * t[a]
        x[b] += alpha * t[b]
        x[c] += alpha * t[c]
        s0, s1, s2 = s[a] - alpha * u[a], s[b] - alpha * u[b], s[c] - alpha * u[c]
        z0, z1, z2 = _times(inverse, uint64(9 * i), s0, s1, s2)
        rho += z0 * s0 + z1 * s1 + z2 * s2
        s[a], s[b], s[c] = s0, s1, s2
    return rho


@inlined
def _add_lower(factor, edges, blocks, inverse, constrained, s, out):
    """Compute `out += factor L E^-1 s`, row by row, so that s and out may be the same array."""
    k = 0
    for i in range(len(s) // 3):
        a = uint64(3 * i)
        x, y, z = _times(inverse, uint64(9 * i), s[a], s[a + uint64(1)], s[a + uint64(2)])
        while k < len(edges) and edges[uint64(k), uint64(0)] == i:
            s0, s1, s2 = _transposed_times(blocks, uint64(9 * k), x, y, z)
            _add(out, uint64(3) * uint64(edges[uint64(k), uint64(1)]), factor * s0, factor * s1, factor * s2)
            k += 1
    _zero_constrained(constrained, out)


@inlined
def _norm(edges, blocks, inverse, constrained, omega, s, r):
    """Return `|r|`, with `r = (E + L) E^-1 s`."""
    for i in range(len(s)):
        r[uint64(i)] = s[uint64(i)]
    if omega > 0:
        _add_lower(1.0, edges, blocks, inverse, constrained, s, r)
    square = 0.0
    for i in range(len(r)):
        square += r[uint64(i)] * r[uint64(i)]
    return np.sqrt(square)


@kernel
def residual(
    edges: Ids,
    blocks: Reals,
    diagonal: Reals,
    grounded: Ids,
    ground: Reals,
    constrained: Ids,
    indices: Ids,
    b: Reals,
    state: Reals,
    work: Reals,
) -> None:
    """Write `r = b - A x` to s, and `|r|` to `state`. The iteration starts again. Entry i of b belongs to component `indices[i]`.

    If x is zero, no product is computed.
    """
    x, s, p, t, u = work[X], work[S], work[P], work[T], work[U]
    size = square = 0.0
    for i in range(len(x)):
        size += abs(x[uint64(i)])
        s[uint64(i)] = p[uint64(i)] = t[uint64(i)] = u[uint64(i)] = 0.0
    if size != 0:
        _multiply(edges, blocks, diagonal, grounded, ground, constrained, x, u)
    for i in range(len(indices)):
        s[uint64(indices[uint64(i)])] = b[uint64(i)]
    for i in range(len(s)):
        s[uint64(i)] -= u[uint64(i)]
        square += s[uint64(i)] * s[uint64(i)]
        u[uint64(i)] = 0.0
    state[NORM], state[RHO_AT_NORM], state[RHO], state[BETA] = np.sqrt(square), 0.0, 0.0, 0.0


@kernel
def precondition(edges: Ids, blocks: Reals, inverse: Reals, constrained: Ids, omega: float, work: Reals) -> None:
    """Compute `t = M^-1 r` for an r stored in s."""
    s, t = work[S], work[T]
    if omega > 0:
        _add_lower(-1.0, edges, blocks, inverse, constrained, s, s)
        _backward(edges, blocks, inverse, omega, s, t, work[H], work[U])
    else:
        _multiply_diagonal(inverse, s, t)


@kernel
def iterate(
    edges: Ids,
    blocks: Reals,
    diagonal: Reals,
    grounded: Ids,
    ground: Reals,
    inverse: Reals,
    constrained: Ids,
    omega: float,
    tolerance: float,
    max_iterations: int,
    state: Reals,
    work: Reals,
) -> tuple[int, int]:
    """Iterate at most `max_iterations` times, until `|r| <= tolerance` or the iteration fails.

    Returns how it ended and the number of iterations. With SSOR, `|r|` costs half a product. It is computed when `r'M^-1 r`
    indicates that it is small enough, or reduced to `REDUCTION`.
    """
    x, s, p, t, h, u = work[X], work[S], work[P], work[T], work[H], work[U]
    norm, rho_at_norm, rho, beta = state[NORM], state[RHO_AT_NORM], state[RHO], state[BETA]
    done, ended = 0, UNFINISHED
    if rho_at_norm == 0 and norm > tolerance:  # s is still r
        if omega > 0:
            _add_lower(-1.0, edges, blocks, inverse, constrained, s, s)
        rho_at_norm = rho = _step(0.0, inverse, x, s, t, u)
    while norm > tolerance and done < max_iterations:
        if not rho > 0:
            ended = NEGATIVE if np.isfinite(rho) else NOT_FINITE
            break
        curvature = _update_search_direction(
            beta, edges, blocks, diagonal, grounded, ground, inverse, constrained, omega, s, p, t, h, u
        )
        if not curvature > 0:
            ended = NEGATIVE if np.isfinite(curvature) else NOT_FINITE
            break
        after = _step(rho / curvature, inverse, x, s, t, u)
        beta, rho = after / rho, after
        done += 1
        if not rho > rho_at_norm * max(tolerance / norm, REDUCTION) ** 2:
            norm, rho_at_norm = _norm(edges, blocks, inverse, constrained, omega, s, h), rho
            if not np.isfinite(norm):
                ended = NOT_FINITE
                break
    state[NORM], state[RHO_AT_NORM], state[RHO], state[BETA] = norm, rho_at_norm, rho, beta
    return CONVERGED if ended == UNFINISHED and norm <= tolerance else ended, done


@kernel
def shifted_diagonal(
    edges: Ids,
    blocks: Reals,
    grounded: Ids,
    ground: Reals,
    constrained: Ids,
    indices: Ids,
    shift: Reals,
    diagonal: Reals,
    out: Reals,
) -> float:
    """Set `diagonal` (3 n,) to `shift` at the unknowns' `indices`, and `out` (9 n,) to `A_aa = S_a + G_a - sum_b A_ab`.

    Rows and columns of `out` at constrained components are zero. An empty `shift` means no shift. Returns a sum that is not finite
    if any entry is not finite.
    """
    for i in range(len(out)):
        out[uint64(i)] = 0.0
    for e in range(len(edges)):
        i = uint64(e)
        a, b, k = uint64(9) * uint64(edges[i, uint64(0)]), uint64(9) * uint64(edges[i, uint64(1)]), uint64(9) * i
        for r in range(3):
            for c in range(3):
                out[a + uint64(3 * r + c)] -= blocks[k + uint64(3 * r + c)]
                out[b + uint64(3 * r + c)] -= blocks[k + uint64(3 * c + r)]
    for i in range(len(grounded)):
        for k in range(9):
            out[uint64(9) * uint64(grounded[uint64(i)]) + uint64(k)] += ground[uint64(9 * i + k)]
    for i in range(len(shift)):
        at = uint64(indices[uint64(i)])
        diagonal[at] = shift[uint64(i)]
        out[uint64(9) * (at // uint64(3)) + uint64(4) * (at % uint64(3))] += shift[uint64(i)]
    for i in range(len(constrained)):
        at = uint64(constrained[uint64(i)])
        row, c = uint64(9) * (at // uint64(3)), at % uint64(3)
        for r in range(3):
            out[row + uint64(3 * r) + c] = 0.0
            out[row + uint64(3) * c + uint64(r)] = 0.0
    total = 0.0
    for i in range(len(out)):
        total += out[uint64(i)]
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
    """Write a symmetric CSR matrix as `blocks` above the diagonal and `diagonal` blocks (9 n,).

    `rows`, `columns` are the structure above the diagonal. Unknown `w` is `component[w]` of block row `block[w]`. The unknowns of
    block row `i` are `first[i]` and the following ones.
    """
    for i in range(len(blocks)):
        blocks[uint64(i)] = 0.0
    for i in range(len(diagonal)):
        diagonal[uint64(i)] = 0.0
    for i in range(len(rows) - 1):
        u = first[uint64(i)]
        while u < len(block) and block[uint64(u)] == i:
            k, row = rows[uint64(i)], 9 * i + 3 * component[uint64(u)]
            for e in range(indptr[uint64(u)], indptr[uint64(u + 1)]):
                w, value = uint64(indices[uint64(e)]), values[uint64(e)]
                j = block[w]
                if j == i:
                    diagonal[uint64(row + component[w])] = value
                elif j > i:
                    while columns[uint64(k)] != j:
                        k += 1 if k + 1 < rows[uint64(i + 1)] else rows[uint64(i)] - k
                    blocks[uint64(9 * k + 3 * component[uint64(u)] + component[w])] = value
            u += 1
