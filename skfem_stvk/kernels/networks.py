"""W, F and the blocks of node pairs of K from edges and pairs of edges: finite elements as in eq. 14 of the overview, and springs.

Each edge has an elongation `z` and its slope `g = dz/dp`, where `p = P + U` is the deformed edge. Each edge and some pairs of edges
have a constant `A_ij`:

    W = 1/2 sum_i A_ii z_i^2 + sum_{pairs i < j} A_ij z_i z_j        s_i = sum_j A_ij z_j        F = s_i g_i on a, -s_i g_i on b
    K_ab = -(A_ii g_i g_i' + s_i H_i) of an edge itself        sigma A_ij g_i g_j' for each end of i and of j; sigma = 1 for both
                                                               first or both second, else -1

    squared      z = |p|^2 - |P|^2 = (2 P + U) . U        g = 2 p                H = 2 I                        A = L/2: quartic
    by length    z = l - L = (2 P + U) . U / (l + L)      g = n = p/l            H = (I - n n')/l               A = k: Hookean

No `z` suffers from the cancellation of a difference of lengths. Rows of K sum to zero, so that `K_aa` follows from the others.

Edges are grouped in blocks. The last block is filled with edges from vertex 0 to itself, which have no stiffness. Arrays: `edges`
(ne, 2) vertices `a`, `b`; `slots` (ne, 2) of their forces. `rest` (3 ne,) are the `P = X_a - X_b`, taken in double precision: for
each block first x, then y, then z. `u` is (3 nv,) in double precision; `pairs` (n, 2) are edges; `own` (ne,) and `between` (n,) are
the `A_ii` and `A_ij`. Threads process consecutive blocks of edges, or of pairs, and no two threads share a slot.
"""

from __future__ import annotations

import numpy as np
from numpy import uint64

from .compiled import Ids, Reals, inlined, kernel
from .lanes import TRANSPOSED, add, dot, times

#: Number of unused blocks after those of K, for contributions to the diagonal.
SPARE = 8
#: Number of edges in a block. With 16, as for elements, vector loads wait for the preceding scalar stores.
EDGES = 64


@inlined
def _vector(a, at):
    """Return three components with a stride of EDGES."""
    return a[at], a[at + uint64(EDGES)], a[at + uint64(2 * EDGES)]


@inlined
def _put(a, out, at):
    out[at], out[at + uint64(EDGES)], out[at + uint64(2 * EDGES)] = a


@inlined
def _find(by_length, block, edges, rest, u, U, z, g, inverse_length):
    """Write `z` and `g` of a block of edges, and the `1/l` of springs by length; `g` has a stride of EDGES.

    A spring of length zero has no direction, and its `g` is zero.
    """
    first = uint64(block * EDGES)
    for lane in range(EDGES):
        i, to = first + uint64(lane), uint64(lane)
        a, b = uint64(3) * uint64(edges[i, uint64(0)]), uint64(3) * uint64(edges[i, uint64(1)])
        U[to], U[to + uint64(EDGES)], U[to + uint64(2 * EDGES)] = (
            u[a] - u[b],
            u[a + uint64(1)] - u[b + uint64(1)],
            u[a + uint64(2)] - u[b + uint64(2)],
        )
    for lane in range(EDGES):
        i, at = uint64(lane), uint64(3) * first + uint64(lane)
        P, V = _vector(rest, at), _vector(U, i)
        p = add(P, V)
        squared = dot(add(P, p), V)
        if by_length:
            length = np.sqrt(dot(p, p))
            inverse = 1 / length if length > 0 else 0.0
            sum_of_both = length + np.sqrt(dot(P, P))
            z[i] = squared / sum_of_both if sum_of_both > 0 else 0.0
            _put(times(inverse, p), g, i)
            inverse_length[i] = inverse
        else:
            z[i] = squared
            _put(add(p, p), g, i)


@inlined
def _add_vector(f, at, x, y, z):
    f[at] += x
    f[at + uint64(1)] += y
    f[at + uint64(2)] += z


@kernel
def elongate(
    begin: int, end: int, by_length: bool, edges: Ids, rest: Reals, u: Reals, z: Reals, g: Reals, inverse_length: Reals
) -> None:
    """Write `z` (ne,) and `g` (3 ne,) of the edges in the blocks `begin` to `end`, and the `1/l` (ne,) of springs by length."""
    U, G = np.empty(3 * EDGES), np.empty(3 * EDGES)
    for block in range(begin, end):
        at = block * EDGES
        _find(by_length, block, edges, rest, u, U, z[at : at + EDGES], G, inverse_length[at : at + EDGES])
        for lane in range(EDGES):
            to = uint64(3 * (at + lane))
            g[to], g[to + uint64(1)], g[to + uint64(2)] = _vector(G, uint64(lane))


@kernel
def springs(begin: int, end: int, by_length: bool, edges: Ids, slots: Ids, rest: Reals, own: Reals, u: Reals, f: Reals) -> float:
    """Return the energy of the edges in the blocks `begin` to `end` without pairs, and add their forces to the slots `f`.

    If `f` is empty, only the energy is computed. This is one pass instead of `elongate` and `pull`. Edges are sorted by their first
    vertices. The forces on a first vertex are summed before they are stored, because adding to a value that was just stored waits
    for the store.
    """
    U, z, g, inverse_length = np.empty(3 * EDGES), np.empty(EDGES), np.empty(3 * EDGES), np.empty(EDGES)
    forces = np.empty(3 * EDGES, f.dtype)
    W, zero = 0.0, f.dtype.type(0)
    x, y, w, last = zero, zero, zero, uint64(0)
    for block in range(begin, end):
        _find(by_length, block, edges, rest, u, U, z, g, inverse_length)
        first = uint64(block * EDGES)
        for lane in range(EDGES):
            i = uint64(lane)
            s = own[first + i] * z[i]
            W += s * z[i]
            _put(times(s, _vector(g, i)), forces, i)
        if len(f) > 0:
            for lane in range(EDGES):
                i = first + uint64(lane)
                a, b = uint64(3) * uint64(slots[i, uint64(0)]), uint64(3) * uint64(slots[i, uint64(1)])
                if a != last:
                    _add_vector(f, last, x, y, w)
                    x, y, w, last = zero, zero, zero, a
                p, q, r = _vector(forces, uint64(lane))
                x, y, w = x + p, y + q, w + r
                _add_vector(f, b, -p, -q, -r)
    if len(f) > 0:
        _add_vector(f, last, x, y, w)
    return W / 2


@kernel
def couple(begin: int, end: int, pairs: Ids, slots: Ids, between: Reals, z: Reals, s: Reals) -> None:
    """Add `A_ij z_j` to the slot of `s_i`, and `A_ij z_i` to the slot of `s_j`, for the pairs `begin` to `end`.

    Pairs are sorted by their first edges. The sum for a first edge is stored once, as in `springs`.
    """
    last, total = uint64(0), s.dtype.type(0)
    for n in range(begin, end):
        i, A = uint64(n), between[uint64(n)]
        first = uint64(slots[i, uint64(0)])
        if first != last:
            s[last] += total
            last, total = first, s.dtype.type(0)
        total += A * z[uint64(pairs[i, uint64(1)])]
        s[uint64(slots[i, uint64(1)])] += A * z[uint64(pairs[i, uint64(0)])]
    s[last] += total


@kernel
def pull(begin: int, end: int, slots: Ids, z: Reals, s: Reals, g: Reals, f: Reals) -> float:
    """Return the energy `1/2 s . z` of the edges in the blocks `begin` to `end`, and add their forces to the slots `f`.

    If `f` is empty, only the energy is computed.
    """
    W, zero = 0.0, f.dtype.type(0)
    x, y, w, last = zero, zero, zero, uint64(0)
    for e in range(begin * EDGES, end * EDGES):
        i = uint64(e)
        W += float(s[i] * z[i])
        if len(f) > 0:
            at, a, b = uint64(3) * i, uint64(3) * uint64(slots[i, uint64(0)]), uint64(3) * uint64(slots[i, uint64(1)])
            if a != last:
                _add_vector(f, last, x, y, w)
                x, y, w, last = zero, zero, zero, a
            p, q, r = s[i] * g[at], s[i] * g[at + uint64(1)], s[i] * g[at + uint64(2)]
            x, y, w = x + p, y + q, w + r
            _add_vector(f, b, -p, -q, -r)
    if len(f) > 0:
        _add_vector(f, last, x, y, w)
    return W / 2


@kernel
def put_blocks(
    begin: int,
    end: int,
    by_length: bool,
    own: Reals,
    s: Reals,
    g: Reals,
    inverse_length: Reals,
    positive: float,
    negative: float,
    blocks: Reals,
) -> None:
    """Write the `K_ab` of the edges `begin` to `end` themselves.

    `s` is multiplied by `positive` or `negative`, depending on its sign.
    """
    for e in range(begin, end):
        i = uint64(e)
        at, to = uint64(3) * i, uint64(9) * i
        x, y, z = g[at], g[at + uint64(1)], g[at + uint64(2)]
        bend = s[i] * s.dtype.type(positive if s[i] > 0 else negative)
        if by_length:
            bend *= inverse_length[i]
            A = own[i] - bend
        else:
            bend += bend
            A = own[i]
        blocks[to] = -(A * x * x + bend)
        blocks[to + uint64(1)] = blocks[to + uint64(3)] = -A * x * y
        blocks[to + uint64(2)] = blocks[to + uint64(6)] = -A * x * z
        blocks[to + uint64(4)] = -(A * y * y + bend)
        blocks[to + uint64(5)] = blocks[to + uint64(7)] = -A * y * z
        blocks[to + uint64(8)] = -(A * z * z + bend)


@inlined
def _add(slot, g, h, blocks):
    """Add `g h'` to a block, or `h g'` if it is stored transposed."""
    at = uint64(9) * uint64(slot & ~TRANSPOSED)
    if slot & TRANSPOSED:
        g, h = h, g
    for r in range(3):
        for c in range(3):
            blocks[at + uint64(3 * r + c)] += g[r] * h[c]


@kernel
def couple_blocks(begin: int, end: int, pairs: Ids, to: Ids, between: Reals, g: Reals, blocks: Reals) -> None:
    """Add `sigma A_ij g_i g_j'` of the pairs `begin` to `end` to the blocks `to` (n, 4).

    The four blocks are those of the first and first vertices, first and second, second and first, second and second. If edges meet,
    one of these is on the diagonal. It is added to one of `SPARE` unused blocks. With a single unused block, each addition would
    wait for the previous store.
    """
    for n in range(begin, end):
        k, A = uint64(n), between[uint64(n)]
        i, j = uint64(3) * uint64(pairs[k, uint64(0)]), uint64(3) * uint64(pairs[k, uint64(1)])
        h = (g[j], g[j + uint64(1)], g[j + uint64(2)])
        q = (A * g[i], A * g[i + uint64(1)], A * g[i + uint64(2)])
        m = (-q[0], -q[1], -q[2])
        _add(to[k, uint64(0)], q, h, blocks)
        _add(to[k, uint64(1)], m, h, blocks)
        _add(to[k, uint64(2)], m, h, blocks)
        _add(to[k, uint64(3)], q, h, blocks)


@kernel
def find_blocks(begin: int, end: int, edges: Ids, starts: Ids, pairs: Ids, out: Ids) -> int:
    """Write the blocks (n, 4) of the ends of the pairs `begin` to `end`, in the order of `couple_blocks`.

    Blocks are those of `edges` (ne, 2) in lexicographic order. The blocks of a first vertex `a` are `starts[a]` to `starts[a + 1]`.
    Transposed blocks have the bit `TRANSPOSED`. The numbers ne ... ne + SPARE - 1 mean the diagonal. The number ne + SPARE means
    that no edge joins the ends. Returns how many blocks have no edge.
    """
    missing, total = 0, len(edges)
    for n in range(begin, end):
        k = uint64(n)
        for first in range(2):
            for second in range(2):
                r, s = edges[uint64(pairs[k, uint64(0)]), uint64(first)], edges[uint64(pairs[k, uint64(1)]), uint64(second)]
                a, b = min(r, s), max(r, s)
                low, high = starts[uint64(a)], starts[uint64(a + 1)]
                while low < high:
                    middle = (low + high) // 2
                    if edges[uint64(middle), uint64(1)] < b:
                        low = middle + 1
                    else:
                        high = middle
                found = low < starts[uint64(a + 1)] and edges[uint64(low), uint64(1)] == b
                at = np.uint32(low) if found else np.uint32(total + SPARE)
                if r == s:
                    at = np.uint32(total + n % SPARE)
                elif not found:
                    missing += 1
                out[k, uint64(2 * first + second)] = at | TRANSPOSED if r > s else at
    return missing
