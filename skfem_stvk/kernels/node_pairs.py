"""Blocks of node pairs of K from the stiffness between base vectors: `K_ab = sum of dN_a/dxi_i dN_b/dxi_j K_ij` over points, i, j.

Shape functions sum to 1, so that the rows of node 0 are minus the sums of the others. A linear simplex has one point, and its nodes
are the ends of the base vectors. Its pairs are its edges, and no sum over points is needed.

The stiffness between base vectors at a point is 45 numbers (`laws.base_vector_stiffness`), or nine blocks of nine numbers where
points are summed. Numbers are stored in blocks of lanes (`lanes`).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy import uint64

from .compiled import by_type, inlined, kernel
from .hourglass import put_pairs_of_means
from .lanes import ELEMENT, LANES, MeanPoints, Points, derivatives, point_count, put
from .laws import transposed

#: Number of values of one 3 x 3 block for all lanes.
NINE = 9 * LANES


@inlined
def _put_minus_sum(a, b, c, out, at):
    for i in range(9):
        out[at + uint64(i * LANES)] = -(a[i] + b[i] + c[i])


@inlined
def _nine(a):
    """Return a symmetric block, stored in the order 11, 22, 33, 12, 13, 23, row by row."""
    return a[0], a[3], a[4], a[3], a[1], a[5], a[4], a[5], a[2]


@inlined
def put_edges(K, out, lane):
    """Write the blocks of the edges 01, 12, 02, 03, 13, 23 of a linear simplex, from the stiffness `K` between its base vectors."""
    K11, K22, K33, K12, K13, K23 = _nine(K[:6]), _nine(K[6:12]), _nine(K[12:18]), K[18:27], K[27:36], K[36:45]
    _put_minus_sum(K11, transposed(K12), transposed(K13), out, lane)
    put(K12, out, lane + uint64(9 * LANES))
    _put_minus_sum(K12, K22, transposed(K23), out, lane + uint64(18 * LANES))
    _put_minus_sum(K13, K23, K33, out, lane + uint64(27 * LANES))
    put(K13, out, lane + uint64(36 * LANES))
    put(K23, out, lane + uint64(45 * LANES))


@inlined
def put_base_vector_blocks(K, out, point, lane):
    """Write the stiffness between base vectors at a point as nine blocks of nine numbers, `K_ij` row by row."""
    K12, K13, K23, at = K[18:27], K[27:36], K[36:45], uint64(9 * point * NINE) + lane
    put(_nine(K[:6]), out, at)
    put(_nine(K[6:12]), out, at + uint64(4 * NINE))
    put(_nine(K[12:18]), out, at + uint64(8 * NINE))
    put(K12, out, at + uint64(NINE))
    put(K13, out, at + uint64(2 * NINE))
    put(transposed(K12), out, at + uint64(3 * NINE))
    put(K23, out, at + uint64(5 * NINE))
    put(transposed(K13), out, at + uint64(6 * NINE))
    put(transposed(K23), out, at + uint64(7 * NINE))


@inlined
def _by_nodes(B, point, a, K, T):
    """Write `T_aj = sum_i dN_a/dxi_i K_ij` at a point for the three nodes from `a` on."""
    (b11, b12, b13), (b21, b22, b23), (b31, b32, b33) = derivatives(B, point, a)
    for j in range(3):
        first = uint64((9 * point + j) * NINE)
        for i in range(NINE):
            at = first + uint64(i)
            k1, k2, k3 = K[at], K[at + uint64(3 * NINE)], K[at + uint64(6 * NINE)]
            T[at] = b11 * k1 + b12 * k2 + b13 * k3
            T[at + uint64(3 * NINE)] = b21 * k1 + b22 * k2 + b23 * k3
            T[at + uint64(6 * NINE)] = b31 * k1 + b32 * k2 + b33 * k3


@inlined
def _add_pairs(B, point, b, T, of, out):
    """Add `sum_j dN_b/dxi_j T_j` at a point, for the three nodes from `b` on, to their blocks (3 NINE,)."""
    (b11, b12, b13), (b21, b22, b23), (b31, b32, b33) = derivatives(B, point, b)
    for i in range(NINE):
        at, to = of + uint64(i), uint64(i)
        t1, t2, t3 = T[at], T[at + uint64(NINE)], T[at + uint64(2 * NINE)]
        out[to] += b11 * t1 + b12 * t2 + b13 * t3
        out[to + uint64(NINE)] += b21 * t1 + b22 * t2 + b23 * t3
        out[to + uint64(2 * NINE)] += b31 * t1 + b32 * t2 + b33 * t3


@inlined
def _add_two_points(B, point, b, T, of, out):
    """Do the work of `_add_pairs` for a point and the next point, so that the blocks are read and written once for both."""
    (b11, b12, b13), (b21, b22, b23), (b31, b32, b33) = derivatives(B, point, b)
    (c11, c12, c13), (c21, c22, c23), (c31, c32, c33) = derivatives(B, point + 1, b)
    for i in range(NINE):
        at, to = of + uint64(i), uint64(i)
        t1, t2, t3 = T[at], T[at + uint64(NINE)], T[at + uint64(2 * NINE)]
        s1, s2, s3 = T[at + uint64(9 * NINE)], T[at + uint64(10 * NINE)], T[at + uint64(11 * NINE)]
        out[to] += b11 * t1 + b12 * t2 + b13 * t3 + c11 * s1 + c12 * s2 + c13 * s3
        out[to + uint64(NINE)] += b21 * t1 + b22 * t2 + b23 * t3 + c21 * s1 + c22 * s2 + c23 * s3
        out[to + uint64(2 * NINE)] += b31 * t1 + b32 * t2 + b33 * t3 + c31 * s1 + c32 * s2 + c33 * s3


@inlined
def _add_diagonal(B, point, b, T, of, out):
    """Do the work of `_add_pairs` for nodes with one nonzero derivative each, such as corners 1, 2, 3 of quadratic simplices."""
    b1, b2, b3 = B[point, b, 0], B[point, b + 1, 1], B[point, b + 2, 2]
    for i in range(NINE):
        at, to = of + uint64(i), uint64(i)
        out[to] += b1 * T[at]
        out[to + uint64(NINE)] += b2 * T[at + uint64(NINE)]
        out[to + uint64(2 * NINE)] += b3 * T[at + uint64(2 * NINE)]


@inlined
def _are_diagonal(B):
    """Return whether each of the nodes 1, 2, 3 has only the derivative `dN_i/dxi_i` at all points."""
    for point in range(len(B)):
        for a in range(3):
            for i in range(3):
                if i != a and B[point, a, i] != 0:
                    return False
    return True


@inlined
def pair_buffers(points, edge_slots, dtype):
    """Return the scratch arrays of `put_pairs` and the array of the pair blocks of a block of elements.

    The scratch arrays are the stiffness between base vectors at the points, the stiffness between nodes and base vectors, and a
    row. `edge_slots` are the slots of the pairs.
    """
    size = 0 if points is None else 9 * NINE * point_count(points)
    work = np.empty(0 if points is None else 2 * size + 3 * NINE, dtype)
    values = np.empty(max(9 * edge_slots.shape[1], 54 * LANES), dtype)
    return work[:size], work[size : 2 * size], work[2 * size :], values


def put_pairs(points: Any, block: Any, nodes: Any, K: Any, x: Any, factor: Any, T: Any, row: Any, out: Any) -> None:
    """Write the blocks of all node pairs `(a, b)`, a < b, of a block of elements.

    `K` is the stiffness between base vectors at the points. `x` are the nodal differences at rest from `gather`. The hourglass
    stiffness is multiplied by `factor`. `T` and `row` are scratch arrays.
    """
    ELEMENT["put_pairs", type(points)](points, block, nodes, K, x, factor, T, row, out)


@by_type(put_pairs, type(None), ELEMENT)
def _no_pairs(points, block, nodes, K, x, factor, T, row, out):
    pass


@by_type(put_pairs, MeanPoints, ELEMENT)
def _pairs_of_means(points, block, nodes, K, x, factor, T, row, out):
    put_pairs_of_means(points, block, nodes, K, x, factor, T, out)


@by_type(put_pairs, Points, ELEMENT)
def _pairs_of_tables(points, block, nodes, K, x, factor, T, row, out):
    _put_pairs(points.B, nodes, K, T, row, out)


@kernel
def _put_pairs(B, nodes, K, T, row, out):
    """Write the pair blocks for elements with a table.

    Nodes are processed in groups of three, and each pair of groups once. Loops of 144 vectorise well, and the data read for one
    node serve three. The blocks of node 0 are minus the sums of the columns of the others.
    """
    nq, diagonal = len(B), _are_diagonal(B)
    out[: (nodes - 1) * NINE] = 0
    for group in range(B.shape[1] // 3):
        for point in range(nq):
            _by_nodes(B, point, 3 * group, K, T)
        for a in range(3 * group, min(3 * group + 3, nodes - 1)):
            of = 3 * (a - 3 * group) * NINE
            for other in range(group + 1):
                row[: 3 * NINE] = 0
                if other == 0 and diagonal:
                    for point in range(nq):
                        _add_diagonal(B, point, 0, T, uint64(of + 9 * point * NINE), row)
                else:
                    for two in range(nq // 2):
                        _add_two_points(B, 2 * two, 3 * other, T, uint64(of + 18 * two * NINE), row)
                    if nq % 2 == 1:
                        _add_pairs(B, nq - 1, 3 * other, T, uint64(of + 9 * (nq - 1) * NINE), row)
                for b in range(3 * other, min(3 * other + 3, a + 1)):  # the block (a, b), b <= a
                    of_b, to_a, to_b = uint64((b - 3 * other) * NINE), uint64(a * NINE), uint64(b * NINE)
                    for i in range(NINE):
                        out[to_b + uint64(i)] -= row[of_b + uint64(i)]
                    if b < a:
                        # pairs (0, .), then (1, .) ...: b + 1 and a + 1 are the nodes
                        pair = uint64(((b + 1) * (nodes - 1) - (b + 1) * b // 2 + a - b - 1) * NINE)
                        for e in range(9):
                            at, at_transposed = uint64(e * LANES), uint64((3 * (e % 3) + e // 3) * LANES)
                            for i in range(LANES):
                                value = row[of_b + at_transposed + uint64(i)]
                                out[pair + at + uint64(i)] = value
                                out[to_a + at + uint64(i)] -= value
