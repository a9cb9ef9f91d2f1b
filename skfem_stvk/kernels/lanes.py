"""Vectors in blocks of lanes, and the gather and scatter operations that all element kernels share.

Elements are grouped in blocks of LANES. The lane is the last axis of every array, so that the arithmetic runs on vector registers.
LLVM recognises this because arrays have one dimension and offsets are known at compile time.

Arrays: `t` vertices (blocks 4 LANES), and `slots` of their forces. `edge_slots` (blocks, edges LANES) are the slots of edge blocks.
`X`, `u`, `v` are (3 nv,) in double precision, `f` is (3 slots,), `blocks` (9 slots,). The base vectors at rest `P`, the edge
differences `U`, `V` of `u`, `v`, and the forces of a block are (9 LANES,).

Indices are `uint64`, because numba tests signed indices for wrap-around.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload
from numpy import uint64

from .compiled import OPTIONS_OF_PIECES, Ids, Reals, by_type, inlined, kernel

#: Number of elements in a block. 16 is fastest: loops of 8 are unrolled before they are vectorised (2 x slower), and 32 spill
#: from the registers and their cache.
LANES = 16

#: Highest bit of a slot: the block is added transposed.
TRANSPOSED = np.uint32(1 << 31)


@inlined
def vector(a, at):
    """Return three components with a stride of LANES."""
    return a[at], a[at + uint64(LANES)], a[at + uint64(2 * LANES)]


@inlined
def six(a, at):
    """Return six numbers with a stride of LANES: the components of `Ri`, or of a symmetric matrix."""
    return (
        a[at],
        a[at + uint64(LANES)],
        a[at + uint64(2 * LANES)],
        a[at + uint64(3 * LANES)],
        a[at + uint64(4 * LANES)],
        a[at + uint64(5 * LANES)],
    )


@inlined
def vectors(a, lane):
    """Return the three vectors of an element at a point, such as its base vectors."""
    return vector(a, lane), vector(a, lane + uint64(3 * LANES)), vector(a, lane + uint64(6 * LANES))


@inlined
def add(a, b):
    """Return `a + b` for two vectors."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@inlined
def times(s, a):
    """Return `s a` for a vector."""
    return s * a[0], s * a[1], s * a[2]


@inlined
def dot(a, b):
    """Return `a . b` for two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def cross(a, b):
    """Return `a x b` for two vectors."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def put(a: Any, out: Any, at: Any) -> None:
    """Write numbers with a stride of LANES."""
    for i in range(len(a)):
        out[at + uint64(i * LANES)] = a[i]


def _put_parts(a, out, at):
    """Write numbers in two loops, each short enough for the compiler to unroll.

    A loop that is not unrolled prevents vectorisation of the surrounding loop over the lanes.
    """
    put(a[:15], out, at)
    put(a[15:], out, at + uint64(15 * LANES))


@overload(put, jit_options=OPTIONS_OF_PIECES, strict=False)
def _put_of_length(a, out, at):
    return _put_parts if len(a) > 15 else put


@kernel
def gather_base_vectors(t, block, X, u, P, U):
    """Write the base vectors of a block at rest, and the differences of their displacements, both in double precision.

    The two are stored separately, because the compiler may reorder the sum `(X_b - X_a) + (u_b - u_a)`.
    """
    first = uint64(block * 4 * LANES)
    for lane in range(LANES):
        at = first + uint64(lane)
        a, b = uint64(3) * uint64(t[at]), uint64(3) * uint64(t[at + uint64(LANES)])
        c, d = uint64(3) * uint64(t[at + uint64(2 * LANES)]), uint64(3) * uint64(t[at + uint64(3 * LANES)])
        for i in range(3):
            x, y, to = X[a + uint64(i)], u[a + uint64(i)], uint64(i * LANES + lane)
            P[to], U[to] = X[b + uint64(i)] - x, u[b + uint64(i)] - y
            P[to + uint64(3 * LANES)], U[to + uint64(3 * LANES)] = X[c + uint64(i)] - x, u[c + uint64(i)] - y
            P[to + uint64(6 * LANES)], U[to + uint64(6 * LANES)] = X[d + uint64(i)] - x, u[d + uint64(i)] - y


class Points(NamedTuple):
    """Table of integration points, the same for all elements. Linear simplices have None in its place.

    Attributes
    ----------
    B
        (nq, m, 3) derivatives `dN_a/dxi_i` of the nodes 1, 2, ... at the points. Missing rows and columns are zero; m is a multiple
        of three.
    weights
        (nq,) weights of the points.
    starts
        (blocks + 1,) index of the first number of the law for each block of lanes. Straight elements have one set of numbers for
        all points, others one set for each point.
    """

    B: Reals
    weights: Reals
    starts: Ids


class MeanPoints(NamedTuple):
    """One integration point for each box, with mean gradients, and the resistance of the hourglass modes.

    Attributes
    ----------
    B
        (blocks, m, 3, LANES) mean gradients `g_a = int dN_a/dX dV / V` of the nodes 1, 2, ..., as in `Points`, along the axes of
        space. Then the base vectors at rest are these axes, and `Ri = I`. With the gradients at the centre a patch test fails.
    weights
        (1,) the weight, which is 1.
    starts
        (blocks + 1,) as in `Points`.
    modes
        (nh, m) hourglass modes `h_ka = +-1` of these nodes: products of the signs of two or three reference coordinates.
    hourglass_stiffness
        (blocks, LANES) `c = hourglass/16 (lam + 2 mu) V sum_a |g_a|^2`.
    """

    B: Reals
    weights: Reals
    starts: Ids
    modes: Reals
    hourglass_stiffness: Reals


def absolute(points: Any) -> Any:
    """Return `points` with the absolute values of the derivatives."""
    return ELEMENT["absolute", type(points)](points)


def base_vectors(points: Any, block: Any, point: Any, x: Any, out: Any) -> None:
    """Write `sum_a dN_a/dxi_i x_a` (9 LANES,) at a point of a block, for nodal differences `x` from `gather`."""
    ELEMENT["base_vectors", type(points)](points, block, point, x, out)


def spread(points: Any, block: Any, point: Any, forces: Any, out: Any) -> None:
    """Add `sum_i dN_a/dxi_i f_i` to the nodal forces `out`, for `forces` (9 LANES,) on the base vectors at a point of a block."""
    ELEMENT["spread", type(points)](points, block, point, forces, out)


#: Formulas by name and by the type of `points`: None, a table of points, or one point with mean gradients.
ELEMENT: dict[tuple[str, type], Any] = {}


@by_type(absolute, type(None), ELEMENT)
def _nothing_absolute(points):
    return None


@by_type(absolute, Points, ELEMENT)
def _table_absolute(points):
    return Points(np.abs(points.B), points.weights, points.starts)


@by_type(absolute, MeanPoints, ELEMENT)
def _means_absolute(points):
    return MeanPoints(np.abs(points.B), points.weights, points.starts, points.modes, points.hourglass_stiffness)


@inlined
def point_vectors(points, x):
    """Return an array for three vectors at a point (9 LANES,).

    For linear simplices this is `x` itself, because nodal differences and base vectors are the same.
    """
    if points is None:
        return x
    else:
        return np.zeros(9 * LANES, x.dtype)


@inlined
def point_count(points):
    """Return the number of points of an element."""
    if points is None:
        return 1
    else:
        return len(points.weights)


@inlined
def nodal_zeros(points, dtype):
    """Return a zero vector (3 m LANES,) for each node except node 0 of a block of elements."""
    if points is None:
        return np.zeros(9 * LANES, dtype)
    else:
        return np.zeros(3 * points.B.shape[1] * LANES, dtype)


@inlined
def law_index(points, block, point, count):
    """Return the index of the first of the `count` numbers of a law for a block at a point, and whether it is unchanged.

    Unchanged means that it is the index of the previous point.
    """
    if points is None:
        return block * count * LANES, False
    else:
        begin = points.starts[block]
        if points.starts[block + 1] - begin == count * LANES:
            return begin, point > 0
        return begin + point * count * LANES, False


@inlined
def weight_of(points, point, D):
    """Return the weight of a point, in the precision of `D`."""
    if points is None:
        return D.dtype.type(1)
    else:
        return D.dtype.type(points.weights[point])


@kernel
def gather(points, t, block, x, out):
    """Write the differences of a field `x` between nodes 1, 2, ... and node 0 of a block of elements, in double precision."""
    if points is None:
        gather_differences(t, block, x, out)
    else:
        nodes = (len(t) // LANES) // (len(points.starts) - 1)
        first = uint64(block * nodes * LANES)
        for lane in range(LANES):
            a = uint64(3) * uint64(t[first + uint64(lane)])
            x0, x1, x2 = x[a], x[a + uint64(1)], x[a + uint64(2)]
            for node in range(1, nodes):
                b, to = uint64(3) * uint64(t[first + uint64(node * LANES + lane)]), uint64((node - 1) * 3 * LANES + lane)
                out[to] = x[b] - x0
                out[to + uint64(LANES)] = x[b + uint64(1)] - x1
                out[to + uint64(2 * LANES)] = x[b + uint64(2)] - x2


@kernel
def gather_both(points, t, block, X, u, x, y):
    """Apply `gather` to the rest coordinates `X` and to the displacements `u`."""
    if points is None:
        gather_base_vectors(t, block, X, u, x, y)
    else:
        gather(points, t, block, X, x)
        gather(points, t, block, u, y)


@inlined
def find_base_vectors(points, block, point, count, x, P, y, U):
    """Write the base vectors `P` at rest and their displacements `U` at a point, for nodal differences `x` and `y` from `gather`.

    Returns the index of the first of the `count` numbers of the law there. At rest the base vectors of straight elements are the
    same at all points.
    """
    first, same = law_index(points, block, point, count)
    if not same:
        base_vectors(points, block, point, x, P)
    base_vectors(points, block, point, y, U)
    return first


@inlined
def derivatives(B, point, a):
    """Return `dN/dxi_1, dN/dxi_2, dN/dxi_3` at a point for each of the three nodes from `a` on."""
    return _of_node(B, point, a), _of_node(B, point, a + 1), _of_node(B, point, a + 2)


@inlined
def _of_node(B, point, a):
    return B[point, a, 0], B[point, a, 1], B[point, a, 2]


@by_type(base_vectors, type(None), ELEMENT)
def _differences_are_base_vectors(points, block, point, x, out):
    pass


@by_type(spread, type(None), ELEMENT)
def _forces_are_nodal(points, block, point, forces, out):
    pass


@by_type(base_vectors, Points, ELEMENT)
def _base_vectors_by_table(points, block, point, x, out):
    B = points.B
    out[:] = 0
    for group in range(B.shape[1] // 3):
        a = 3 * group
        (b11, b12, b13), (b21, b22, b23), (b31, b32, b33) = derivatives(B, point, a)
        for c in range(3):
            first, to = uint64((3 * a + c) * LANES), uint64(c * LANES)
            for lane in range(LANES):
                at, i = first + uint64(lane), to + uint64(lane)
                x1, x2, x3 = x[at], x[at + uint64(3 * LANES)], x[at + uint64(6 * LANES)]
                out[i] += b11 * x1 + b21 * x2 + b31 * x3
                out[i + uint64(3 * LANES)] += b12 * x1 + b22 * x2 + b32 * x3
                out[i + uint64(6 * LANES)] += b13 * x1 + b23 * x2 + b33 * x3


@by_type(spread, Points, ELEMENT)
def _spread_by_table(points, block, point, forces, out):
    B = points.B
    for group in range(B.shape[1] // 3):
        a = 3 * group
        (b11, b12, b13), (b21, b22, b23), (b31, b32, b33) = derivatives(B, point, a)
        for c in range(3):
            first, of = uint64((3 * a + c) * LANES), uint64(c * LANES)
            for lane in range(LANES):
                to, i = first + uint64(lane), of + uint64(lane)
                f1, f2, f3 = forces[i], forces[i + uint64(3 * LANES)], forces[i + uint64(6 * LANES)]
                out[to] += b11 * f1 + b12 * f2 + b13 * f3
                out[to + uint64(3 * LANES)] += b21 * f1 + b22 * f2 + b23 * f3
                out[to + uint64(6 * LANES)] += b31 * f1 + b32 * f2 + b33 * f3


@by_type(base_vectors, MeanPoints, ELEMENT)
def _base_vectors_by_means(points, block, point, x, out):
    B, nodes = points.B.reshape(-1), points.B.shape[1]
    out[:] = 0
    for group in range(nodes // 3):
        of = uint64(3 * LANES * (block * nodes + 3 * group))
        for c in range(3):
            first, to = uint64((9 * group + c) * LANES), uint64(c * LANES)
            for lane in range(LANES):
                at, i, g = first + uint64(lane), to + uint64(lane), of + uint64(lane)
                x1, x2, x3 = x[at], x[at + uint64(3 * LANES)], x[at + uint64(6 * LANES)]
                (b11, b12, b13), (b21, b22, b23), (b31, b32, b33) = vectors(B, g)
                out[i] += b11 * x1 + b21 * x2 + b31 * x3
                out[i + uint64(3 * LANES)] += b12 * x1 + b22 * x2 + b32 * x3
                out[i + uint64(6 * LANES)] += b13 * x1 + b23 * x2 + b33 * x3


@by_type(spread, MeanPoints, ELEMENT)
def _spread_by_means(points, block, point, forces, out):
    B, nodes = points.B.reshape(-1), points.B.shape[1]
    for group in range(nodes // 3):
        of = uint64(3 * LANES * (block * nodes + 3 * group))
        for c in range(3):
            first, at = uint64((9 * group + c) * LANES), uint64(c * LANES)
            for lane in range(LANES):
                to, i, g = first + uint64(lane), at + uint64(lane), of + uint64(lane)
                f1, f2, f3 = forces[i], forces[i + uint64(3 * LANES)], forces[i + uint64(6 * LANES)]
                (b11, b12, b13), (b21, b22, b23), (b31, b32, b33) = vectors(B, g)
                out[to] += b11 * f1 + b12 * f2 + b13 * f3
                out[to + uint64(3 * LANES)] += b21 * f1 + b22 * f2 + b23 * f3
                out[to + uint64(6 * LANES)] += b31 * f1 + b32 * f2 + b33 * f3


@kernel
def scatter(points, slots, block, forces, f):
    """Add the forces of a block to the slots of its nodes: `forces` to nodes 1, 2, ..., and minus their sum to node 0."""
    if points is None:
        scatter_forces(slots, block, forces, f)
    else:
        nodes = (len(slots) // LANES) // (len(points.starts) - 1)
        first = uint64(block * nodes * LANES)
        for lane in range(LANES):
            a = uint64(3) * uint64(slots[first + uint64(lane)])
            s0, s1, s2 = f.dtype.type(0), f.dtype.type(0), f.dtype.type(0)
            for node in range(1, nodes):
                b, of = uint64(3) * uint64(slots[first + uint64(node * LANES + lane)]), uint64((node - 1) * 3 * LANES + lane)
                f0, f1, f2 = forces[of], forces[of + uint64(LANES)], forces[of + uint64(2 * LANES)]
                f[b] += f0
                f[b + uint64(1)] += f1
                f[b + uint64(2)] += f2
                s0, s1, s2 = s0 + f0, s1 + f1, s2 + f2
            f[a] -= s0
            f[a + uint64(1)] -= s1
            f[a + uint64(2)] -= s2


@inlined
def complete_base_vectors(k, P):
    """Write the constant base vectors of simplices with fewer than three: (0, 0, 1) for the third, (0, 1, 0) for the second."""
    if k < 3:
        P[8 * LANES : 9 * LANES] = 1
    if k < 2:
        P[4 * LANES : 5 * LANES] = 1


@kernel
def gather_differences(t, block, v, V):
    """Write the differences of `v` between vertices 1, 2, 3 and vertex 0 of a block of simplices, in double precision."""
    first = uint64(block * 4 * LANES)
    for lane in range(LANES):
        at = first + uint64(lane)
        a, b = uint64(3) * uint64(t[at]), uint64(3) * uint64(t[at + uint64(LANES)])
        c, d = uint64(3) * uint64(t[at + uint64(2 * LANES)]), uint64(3) * uint64(t[at + uint64(3 * LANES)])
        for i in range(3):
            x, to = v[a + uint64(i)], uint64(i * LANES + lane)
            V[to] = v[b + uint64(i)] - x
            V[to + uint64(3 * LANES)] = v[c + uint64(i)] - x
            V[to + uint64(6 * LANES)] = v[d + uint64(i)] - x


@kernel
def gather_magnitudes(points, t, block, v, out):
    """Write `|v_a| + |v_0|` by component for the nodes a = 1, 2, ... of a block."""
    nodes = 4 if points is None else (len(t) // LANES) // (len(points.starts) - 1)
    first = uint64(block * nodes * LANES)
    for lane in range(LANES):
        a = uint64(3) * uint64(t[first + uint64(lane)])
        for node in range(1, nodes):
            b = uint64(3) * uint64(t[first + uint64(node * LANES + lane)])
            for i in range(3):
                out[uint64((3 * (node - 1) + i) * LANES + lane)] = abs(v[a + uint64(i)]) + abs(v[b + uint64(i)])


@kernel
def scatter_forces(slots, block, forces, f):
    """Add the forces of a block of simplices: `forces` to vertices 1, 2, 3, and minus their sum to vertex 0."""
    first = uint64(block * 4 * LANES)
    for lane in range(LANES):
        at = first + uint64(lane)
        a, b = uint64(3) * uint64(slots[at]), uint64(3) * uint64(slots[at + uint64(LANES)])
        c, d = uint64(3) * uint64(slots[at + uint64(2 * LANES)]), uint64(3) * uint64(slots[at + uint64(3 * LANES)])
        for i in range(3):
            of = uint64(i * LANES + lane)
            f1, f2, f3 = forces[of], forces[of + uint64(3 * LANES)], forces[of + uint64(6 * LANES)]
            f[a + uint64(i)] -= f1 + f2 + f3
            f[b + uint64(i)] += f1
            f[c + uint64(i)] += f2
            f[d + uint64(i)] += f3


@kernel
def scatter_magnitudes(points, slots, block, forces, f):
    """Add the magnitudes of the forces of a block: `forces` to nodes 1, 2, ..., and their sum to node 0."""
    nodes = 4 if points is None else (len(slots) // LANES) // (len(points.starts) - 1)
    first = uint64(block * nodes * LANES)
    for lane in range(LANES):
        a = uint64(3) * uint64(slots[first + uint64(lane)])
        for node in range(1, nodes):
            b = uint64(3) * uint64(slots[first + uint64(node * LANES + lane)])
            for i in range(3):
                size = forces[uint64((3 * (node - 1) + i) * LANES + lane)]
                f[a + uint64(i)] += size
                f[b + uint64(i)] += size


@kernel
def scatter_blocks(points, edge_slots, block, values, blocks):
    """Add the blocks of the node pairs of a block of elements to their slots.

    For elements with a table of points, the highest bit of a slot marks a block that is added transposed. Its first node has the
    higher number.
    """
    edges = edge_slots.shape[1] // LANES
    for lane in range(LANES):
        for edge in range(edges):
            slot = edge_slots[block, uint64(edge * LANES + lane)]
            at = uint64(edge * 9 * LANES + lane)
            if points is None or slot < TRANSPOSED:
                to = uint64(9) * uint64(slot)
                for i in range(9):
                    blocks[to + uint64(i)] += values[at + uint64(i * LANES)]
            else:
                to = uint64(9) * uint64(slot - TRANSPOSED)
                for i in range(3):
                    for j in range(3):
                        blocks[to + uint64(3 * i + j)] += values[at + uint64((3 * j + i) * LANES)]
