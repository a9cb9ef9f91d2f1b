"""What the kernels on simplices share: vectors in blocks of lanes, what is gathered for a block and where its results are added.

Simplices stand in blocks of LANES, the last axis of every array, so that the arithmetic runs on vector registers; one dimension and
offsets known at compile time are what lets LLVM see that.

Arrays: `t` vertices (blocks 4 LANES), `slots` where forces go, `edge_slots` (blocks, edges LANES) where edge blocks go; `X`,
`u`, `v` (3 nv,) in double, `f` (3 slots,), `blocks` (9 slots,). Spokes `P`, `U`, `V` and forces of a block are (9 LANES,).
"""

from __future__ import annotations

import numpy as np

from .compiled import inlined, kernel

#: Simplices in a block. 16 measures best: 8 are unrolled before they are vectorised (2 x slower), 32 spill from the registers'
#: cache.
LANES = 16

#: Unsigned indices: numba tests signed ones for wrap-around.
I = np.uint64


@inlined
def vector(a, at):
    """Three components that stand a block of lanes apart."""
    return a[at], a[at + I(LANES)], a[at + I(2 * LANES)]


@inlined
def vectors(a, lane):
    """The three vectors of a simplex, such as its spokes."""
    return vector(a, lane), vector(a, lane + I(3 * LANES)), vector(a, lane + I(6 * LANES))


@inlined
def add(a, b):
    """`a + b` of two vectors."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@inlined
def times(s, a):
    """`s a` of a vector."""
    return s * a[0], s * a[1], s * a[2]


@inlined
def dot(a, b):
    """`a . b` of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def cross(a, b):
    """`a x b` of two vectors."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def put(a, out, at):
    """Write numbers a block of lanes apart."""
    for i in range(len(a)):
        out[at + I(i * LANES)] = a[i]


@kernel
def gather_spokes(t, block, X, u, P, U):
    """Spokes of a block at rest and their displacements, differences taken in double: stored apart, for the compiler may turn
    `(X_b - X_a) + (u_b - u_a)` round.
    """
    first = I(block * 4 * LANES)
    for lane in range(LANES):
        at = first + I(lane)
        a, b = I(3) * I(t[at]), I(3) * I(t[at + I(LANES)])
        c, d = I(3) * I(t[at + I(2 * LANES)]), I(3) * I(t[at + I(3 * LANES)])
        for i in range(3):
            x, y, to = X[a + I(i)], u[a + I(i)], I(i * LANES + lane)
            P[to], U[to] = X[b + I(i)] - x, u[b + I(i)] - y
            P[to + I(3 * LANES)], U[to + I(3 * LANES)] = X[c + I(i)] - x, u[c + I(i)] - y
            P[to + I(6 * LANES)], U[to + I(6 * LANES)] = X[d + I(i)] - x, u[d + I(i)] - y


@inlined
def complete_spokes(k, P):
    """The constant spokes of simplices that have less than three: (0, 0, 1) for the third, (0, 1, 0) for the second."""
    if k < 3:
        P[8 * LANES : 9 * LANES] = 1
    if k < 2:
        P[4 * LANES : 5 * LANES] = 1


@kernel
def gather_differences(t, block, v, V):
    """What `v` is at the ends of the spokes of a block more than at their beginning, in double."""
    first = I(block * 4 * LANES)
    for lane in range(LANES):
        at = first + I(lane)
        a, b = I(3) * I(t[at]), I(3) * I(t[at + I(LANES)])
        c, d = I(3) * I(t[at + I(2 * LANES)]), I(3) * I(t[at + I(3 * LANES)])
        for i in range(3):
            x, to = v[a + I(i)], I(i * LANES + lane)
            V[to] = v[b + I(i)] - x
            V[to + I(3 * LANES)] = v[c + I(i)] - x
            V[to + I(6 * LANES)] = v[d + I(i)] - x


@kernel
def gather_sizes(t, block, X, u, P, B, p):
    """Absolute values of the spokes of a block: at rest, of both displacements together, and now."""
    first = I(block * 4 * LANES)
    for lane in range(LANES):
        at = first + I(lane)
        a = I(3) * I(t[at])
        for spoke in range(3):
            b = I(3) * I(t[at + I((spoke + 1) * LANES)])
            for i in range(3):
                to = I((3 * spoke + i) * LANES + lane)
                rest, x, y = X[b + I(i)] - X[a + I(i)], u[a + I(i)], u[b + I(i)]
                P[to], B[to], p[to] = abs(rest), abs(x) + abs(y), abs(rest + (y - x))


@kernel
def scatter_forces(slots, block, forces, f):
    """Add the forces of a block: those of vertices 1, 2, 3 as they are, minus their sum to vertex 0."""
    first = I(block * 4 * LANES)
    for lane in range(LANES):
        at = first + I(lane)
        a, b = I(3) * I(slots[at]), I(3) * I(slots[at + I(LANES)])
        c, d = I(3) * I(slots[at + I(2 * LANES)]), I(3) * I(slots[at + I(3 * LANES)])
        for i in range(3):
            of = I(i * LANES + lane)
            f1, f2, f3 = forces[of], forces[of + I(3 * LANES)], forces[of + I(6 * LANES)]
            f[a + I(i)] -= f1 + f2 + f3
            f[b + I(i)] += f1
            f[c + I(i)] += f2
            f[d + I(i)] += f3


@kernel
def scatter_sizes(slots, block, forces, f):
    """Add the sizes of the forces of a block: those of vertices 1, 2, 3 as they are, and their sum to vertex 0."""
    first = I(block * 4 * LANES)
    for lane in range(LANES):
        at = first + I(lane)
        a = I(3) * I(slots[at])
        for vertex in range(3):
            b = I(3) * I(slots[at + I((vertex + 1) * LANES)])
            for i in range(3):
                size = forces[I((3 * vertex + i) * LANES + lane)]
                f[a + I(i)] += size
                f[b + I(i)] += size


@kernel
def scatter_blocks(edge_slots, block, values, blocks):
    """Add the blocks of the edges of a block of simplices to their slots."""
    edges = edge_slots.shape[1] // LANES
    for lane in range(LANES):
        for edge in range(edges):
            to = I(9) * I(edge_slots[block, I(edge * LANES + lane)])
            at = I(edge * 9 * LANES + lane)
            for i in range(9):
                blocks[to + I(i)] += values[at + I(i * LANES)]
