"""W, F and the blocks of node pairs of K, element by element: what all assembly is made of.

For a block of elements at a time: gather what its nodes have, and at each point spokes, frame, law (`laws`), and back: the
forces on spokes, spread over the nodes, and scattered. With `K_ij` the stiffness of the spokes:

    W = sum of 1/4 S : M        F_a = sum of dN_a/dxi_i f_i        K_ab = sum of dN_a/dxi_i dN_b/dxi_j K_ij     over points, i, j

Shape functions add up to 1, so only differences to node 0 are read, the force on node 0 is minus the sum of the others, and its
rows of K likewise. A linear simplex has one point and its nodes at the ends of the spokes: `points` is None then, and there is
nothing to do between nodes and spokes.

    zeta(u + s v) is quadratic in s, so W is a quartic: with M' = dM/ds and M'' = d2M/ds2, both at s = 0, S' and S'' likewise,
    and H_j the v in the frame,
    M'_ij = q_i . H_j + H_i . q_j        M''_ij = 2 H_i . H_j
    W(s)  = S:M/4 + S:M'/2 s + (S:M'' + S':M')/4 s^2 + S':M''/4 s^3 + S'':M''/16 s^4

    From u to u + v M changes by dM_ij = (q_i + H_i) . H_j + H_i . q_j. The stresses w0 S + w1 (S + dS) pull along q_i + theta H_i;
    their work over v is W(u + v) - W(u) + (w1 - w0)/4 dS:dM for theta = 1/2, w0 + w1 = 1. At velocities v the S' pull along q_i:
    they are the derivative of R = 1/4 S':M' by H_i, and take the power 2 R.

Blocks of lanes and the arrays that all kernels share: `lanes`. Threads take runs of blocks, and no two of them share a slot.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .compiled import Ids, Reals, by_type, inlined, kernel
from .hourglass import add_sizes_of_resistance, put_pairs_of_means, resist, resistance_along
from .lanes import (
    ELEMENT,
    LANES,
    I,
    MeanPoints,
    Points,
    absolute,
    add,
    at_point,
    gather,
    gather_sizes,
    gather_spokes,
    numbers_of,
    points_of,
    put,
    room,
    scatter,
    scatter_sizes,
    spokes,
    spread,
    times,
    vectors,
    weight_of,
)
from .laws import (
    conjugated,
    contracted,
    frame,
    in_frame,
    numbers_in,
    on_spokes,
    pulled,
    sizes_of_stress,
    spoke_stiffness,
    strain,
    stress,
    weigh_eigenvalues,
)
from .rows import add_blocks, close_rows, open_rows


@inlined
def _deformed(R, P, U, lane):
    """The frame at rest `Q`, its displacements `h` and where it is now, `q`, of a lane with spokes `P` and `U`."""
    P1, P2, P3 = vectors(P, lane)
    U1, U2, U3 = vectors(U, lane)
    Q, h = in_frame(R, P1, P2, P3), in_frame(R, U1, U2, U3)
    return Q, h, (add(Q[0], h[0]), add(Q[1], h[1]), add(Q[2], h[2]))


@inlined
def _put_forces(R, S, q1, q2, q3, forces, lane):
    """Write what the stresses `S` pull on the spokes."""
    s1, s2, s3 = pulled(S, q1, q2, q3)
    f1, f2, f3 = on_spokes(R, s1, s2, s3)
    put(f1, forces, lane)
    put(f2, forces, lane + I(3 * LANES))
    put(f3, forces, lane + I(6 * LANES))


@kernel
def energy_and_force(
    begin: int, end: int, t: Ids, slots: Ids, points: Points | None, law: Any, X: Reals, u: Reals, f: Reals
) -> float:
    """The energy of the blocks `begin` to `end`; adds their forces to the slots `f`, unless that is empty."""
    D, count = law.D, numbers_in(law)
    x, y, total = room(points, D.dtype), room(points, D.dtype), room(points, D.dtype)
    P, U, forces = at_point(points, x), at_point(points, y), at_point(points, total)
    W = 0.0
    for block in range(begin, end):
        gather(points, t, block, X, x)
        gather(points, t, block, u, y)
        w = D.dtype.type(0)
        if points is not None:
            total[:] = 0
        for point in range(points_of(points)):
            first, same = numbers_of(points, block, point, count)
            weight = weight_of(points, point, D)
            if not same:
                spokes(points, block, point, x, P)
            spokes(points, block, point, y, U)
            for i in range(LANES):
                lane, at = I(i), I(first + i)
                R = frame(D, at)
                (Q1, Q2, Q3), (h1, h2, h3), (q1, q2, q3) = _deformed(R, P, U, lane)
                M = strain(h1, h2, h3, Q1, Q2, Q3, q1, q2, q3)
                S = stress(law, at, weight, M)
                w += contracted(S, M)
                _put_forces(R, S, q1, q2, q3, forces, lane)
            w += resist(points, block, x, y, U, 1, forces, total)
            spread(points, block, point, forces, total)
        W += w
        if len(f) > 0:
            scatter(points, slots, block, total, f)
    return W / 4


@inlined
def _put_minus_sum(a, b, c, out, at):
    for i in range(9):
        out[at + I(i * LANES)] = -(a[i] + b[i] + c[i])


@inlined
def _nine(a):
    """A symmetric block in the order 11, 22, 33, 12, 13, 23, row by row."""
    return a[0], a[3], a[4], a[3], a[1], a[5], a[4], a[5], a[2]


@inlined
def _transposed(K):
    return K[0], K[3], K[6], K[1], K[4], K[7], K[2], K[5], K[8]


@inlined
def _put_edges(K, out, lane):
    """Write the blocks of the edges 01, 12, 02, 03, 13, 23 of a linear simplex with the stiffness `K` of its spokes."""
    K11, K22, K33, K12, K13, K23 = _nine(K[:6]), _nine(K[6:12]), _nine(K[12:18]), K[18:27], K[27:36], K[36:45]
    _put_minus_sum(K11, _transposed(K12), _transposed(K13), out, lane)
    put(K12, out, lane + I(9 * LANES))
    _put_minus_sum(K12, K22, _transposed(K23), out, lane + I(18 * LANES))
    _put_minus_sum(K13, K23, K33, out, lane + I(27 * LANES))
    put(K13, out, lane + I(36 * LANES))
    put(K23, out, lane + I(45 * LANES))


@inlined
def put_spokes(K, out, lane):
    """Write the stiffness of spokes as nine blocks of nine numbers, `K_ij` row by row."""
    K12, K13, K23 = K[18:27], K[27:36], K[36:45]
    put(_nine(K[:6]), out, lane)
    put(_nine(K[6:12]), out, lane + I(36 * LANES))
    put(_nine(K[12:18]), out, lane + I(72 * LANES))
    put(K12, out, lane + I(9 * LANES))
    put(K13, out, lane + I(18 * LANES))
    put(_transposed(K12), out, lane + I(27 * LANES))
    put(K23, out, lane + I(45 * LANES))
    put(_transposed(K13), out, lane + I(54 * LANES))
    put(_transposed(K23), out, lane + I(63 * LANES))


#: Numbers of a 3 x 3 block of a block of lanes.
NINE = 9 * LANES


@inlined
def _by_nodes(B, point, a, K, T):
    """`T_aj = sum_i dN_a/dxi_i K_ij` of three nodes from `a` on at a point."""
    b11, b12, b13 = B[point, a, 0], B[point, a, 1], B[point, a, 2]
    b21, b22, b23 = B[point, a + 1, 0], B[point, a + 1, 1], B[point, a + 1, 2]
    b31, b32, b33 = B[point, a + 2, 0], B[point, a + 2, 1], B[point, a + 2, 2]
    for j in range(3):
        of, to = I((9 * point + j) * NINE), I((9 * point + j) * NINE)
        for i in range(NINE):
            at, into = of + I(i), to + I(i)
            k1, k2, k3 = K[at], K[at + I(3 * NINE)], K[at + I(6 * NINE)]
            T[into] = b11 * k1 + b12 * k2 + b13 * k3
            T[into + I(3 * NINE)] = b21 * k1 + b22 * k2 + b23 * k3
            T[into + I(6 * NINE)] = b31 * k1 + b32 * k2 + b33 * k3


@inlined
def _add_pairs(B, point, b, T, of, out):
    """Add `sum_j dN_b/dxi_j T_j` of three nodes from `b` on at a point to their blocks (3 NINE,)."""
    b11, b12, b13 = B[point, b, 0], B[point, b, 1], B[point, b, 2]
    b21, b22, b23 = B[point, b + 1, 0], B[point, b + 1, 1], B[point, b + 1, 2]
    b31, b32, b33 = B[point, b + 2, 0], B[point, b + 2, 1], B[point, b + 2, 2]
    for i in range(NINE):
        at, to = of + I(i), I(i)
        t1, t2, t3 = T[at], T[at + I(NINE)], T[at + I(2 * NINE)]
        out[to] += b11 * t1 + b12 * t2 + b13 * t3
        out[to + I(NINE)] += b21 * t1 + b22 * t2 + b23 * t3
        out[to + I(2 * NINE)] += b31 * t1 + b32 * t2 + b33 * t3


@inlined
def _add_two(B, point, b, T, of, out):
    """As `_add_pairs`, of a point and the next: the blocks are read and written once for both."""
    b11, b12, b13 = B[point, b, 0], B[point, b, 1], B[point, b, 2]
    b21, b22, b23 = B[point, b + 1, 0], B[point, b + 1, 1], B[point, b + 1, 2]
    b31, b32, b33 = B[point, b + 2, 0], B[point, b + 2, 1], B[point, b + 2, 2]
    c11, c12, c13 = B[point + 1, b, 0], B[point + 1, b, 1], B[point + 1, b, 2]
    c21, c22, c23 = B[point + 1, b + 1, 0], B[point + 1, b + 1, 1], B[point + 1, b + 1, 2]
    c31, c32, c33 = B[point + 1, b + 2, 0], B[point + 1, b + 2, 1], B[point + 1, b + 2, 2]
    for i in range(NINE):
        at, to = of + I(i), I(i)
        t1, t2, t3 = T[at], T[at + I(NINE)], T[at + I(2 * NINE)]
        s1, s2, s3 = T[at + I(9 * NINE)], T[at + I(10 * NINE)], T[at + I(11 * NINE)]
        out[to] += b11 * t1 + b12 * t2 + b13 * t3 + c11 * s1 + c12 * s2 + c13 * s3
        out[to + I(NINE)] += b21 * t1 + b22 * t2 + b23 * t3 + c21 * s1 + c22 * s2 + c23 * s3
        out[to + I(2 * NINE)] += b31 * t1 + b32 * t2 + b33 * t3 + c31 * s1 + c32 * s2 + c33 * s3


@inlined
def _add_diagonal(B, point, b, T, of, out):
    """As `_add_pairs`, where each of the nodes has but one derivative, as the corners 1, 2, 3 of a quadratic simplex."""
    b1, b2, b3 = B[point, b, 0], B[point, b + 1, 1], B[point, b + 2, 2]
    for i in range(NINE):
        at, to = of + I(i), I(i)
        out[to] += b1 * T[at]
        out[to + I(NINE)] += b2 * T[at + I(NINE)]
        out[to + I(2 * NINE)] += b3 * T[at + I(2 * NINE)]


@inlined
def _are_diagonal(B):
    """Whether the nodes 1, 2, 3 have but one derivative each at all points."""
    for point in range(len(B)):
        for a in range(3):
            for i in range(3):
                if i != a and B[point, a, i] != 0:
                    return False
    return True


def put_pairs(points: Any, block: Any, nodes: Any, K: Any, x: Any, T: Any, row: Any, out: Any) -> None:
    """Write the blocks of all pairs of nodes `(a, b)`, a < b, of a block of elements from the stiffness `K` of spokes at the
    points.

    `x` is what `gather` found at rest; `T` and `row` are room to work in.
    """
    ELEMENT["put_pairs", type(points)](points, block, nodes, K, x, T, row, out)


@by_type(put_pairs, type(None), ELEMENT)
def _no_pairs(points, block, nodes, K, x, T, row, out):
    pass


@by_type(put_pairs, MeanPoints, ELEMENT)
def _pairs_of_means(points, block, nodes, K, x, T, row, out):
    put_pairs_of_means(points, block, nodes, K, x, T, out)


@by_type(put_pairs, Points, ELEMENT)
def _pairs_of_tables(points, block, nodes, K, x, T, row, out):
    _put_pairs(points.B, nodes, K, T, row, out)


@kernel
def _put_pairs(B, nodes, K, T, row, out):
    """`put_pairs` by a table.

    Nodes are taken three at a time, and of those two groups each pair once: loops of 144 are vectorised well, and what is read for
    one node serves three. Blocks of node 0 are minus the sums of the columns of the others.
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
                        _add_diagonal(B, point, 0, T, I(of + 9 * point * NINE), row)
                else:
                    for two in range(nq // 2):
                        _add_two(B, 2 * two, 3 * other, T, I(of + 18 * two * NINE), row)
                    if nq % 2 == 1:
                        _add_pairs(B, nq - 1, 3 * other, T, I(of + 9 * (nq - 1) * NINE), row)
                for b in range(3 * other, min(3 * other + 3, a + 1)):  # the block (a, b), b <= a
                    of_b, to_a, to_b = I((b - 3 * other) * NINE), I(a * NINE), I(b * NINE)
                    for i in range(NINE):
                        out[to_b + I(i)] -= row[of_b + I(i)]
                    if b < a:
                        # pairs (0, .), then (1, .) ...: b + 1 and a + 1 are the nodes
                        pair = I(((b + 1) * (nodes - 1) - (b + 1) * b // 2 + a - b - 1) * NINE)
                        for e in range(9):
                            at, turned = I(e * LANES), I((3 * (e % 3) + e // 3) * LANES)
                            for i in range(LANES):
                                value = row[of_b + turned + I(i)]
                                out[pair + at + I(i)] = value
                                out[to_a + at + I(i)] -= value


@kernel
def linearize(
    begin: int,
    end: int,
    t: Ids,
    slots: Ids,
    to: Any,
    points: Points | None,
    law: Any,
    X: Reals,
    u: Reals,
    positive: float,
    negative: float,
    f: Reals,
) -> tuple[float, float]:
    """The energy; adds forces to the slots `f`, unless that is empty, and `K_ab`, `S` times `positive` in it, to what `to` says.

    Of elements with a table of points the negative eigenvalues of `S` count by `negative`; of linear simplices as the others. The
    second number is the trace of the rows of K that were written (`rows`).
    """
    D, count = law.D, numbers_in(law)
    x, y, total = room(points, D.dtype), room(points, D.dtype), room(points, D.dtype)
    P, U, forces = at_point(points, x), at_point(points, y), at_point(points, total)
    q, S_kept, apart = np.empty(9 * LANES, D.dtype), np.empty(6 * LANES, D.dtype), points is not None and positive != negative
    g = D.dtype.type(1) if apart else D.dtype.type(positive)
    values = np.empty(max(9 * to.slots.shape[1], 54 * LANES), D.dtype)
    size = 0 if points is None else 9 * NINE * points_of(points)
    K, T, row = np.empty(size, D.dtype), np.empty(size, D.dtype), np.empty(3 * NINE, D.dtype)
    nodes = (len(t) // LANES) // len(to.slots)
    stage, place = open_rows(to)
    W = 0.0
    for block in range(begin, end):
        gather(points, t, block, X, x)
        gather(points, t, block, u, y)
        w = D.dtype.type(0)
        if points is not None:
            total[:] = 0
        for point in range(points_of(points)):
            first, same = numbers_of(points, block, point, count)
            weight = weight_of(points, point, D)
            if not same:
                spokes(points, block, point, x, P)
            spokes(points, block, point, y, U)
            for i in range(LANES):
                lane, at = I(i), I(first + i)
                R = frame(D, at)
                (Q1, Q2, Q3), (h1, h2, h3), (q1, q2, q3) = _deformed(R, P, U, lane)
                M = strain(h1, h2, h3, Q1, Q2, Q3, q1, q2, q3)
                S = stress(law, at, weight, M)
                w += contracted(S, M)
                _put_forces(R, S, q1, q2, q3, forces, lane)
                put(q1, q, lane)
                put(q2, q, lane + I(3 * LANES))
                put(q3, q, lane + I(6 * LANES))
                put((g * S[0], g * S[1], g * S[2], g * S[3], g * S[4], g * S[5]), S_kept, lane)
            w += resist(points, block, x, y, U, 1, forces, total)
            spread(points, block, point, forces, total)
            if apart:
                for i in range(LANES):
                    weigh_eigenvalues(S_kept, I(i), positive, negative)
            for i in range(LANES):
                lane, at = I(i), I(first + i)
                R = frame(D, at)
                q1, q2, q3 = vectors(q, lane)
                S = (
                    S_kept[lane],
                    S_kept[lane + I(LANES)],
                    S_kept[lane + I(2 * LANES)],
                    S_kept[lane + I(3 * LANES)],
                    S_kept[lane + I(4 * LANES)],
                    S_kept[lane + I(5 * LANES)],
                )
                stiffness = spoke_stiffness(law, at, weight, R, q1, q2, q3, S)
                if points is None:
                    _put_edges(stiffness, values, lane)
                else:
                    put_spokes(stiffness, K, I(9 * point * NINE) + lane)
        put_pairs(points, block, nodes, K, x, T, row, values)
        W += w
        if len(f) > 0:
            scatter(points, slots, block, total, f)
        place = add_blocks(to, points, stage, place, block, values)
    return W / 4, close_rows(to, stage, place)


@kernel
def _scatter_tensions(edge_slots, block, values, out):
    edges = edge_slots.shape[1] // LANES
    for lane in range(LANES):
        for edge in range(edges):
            at = I(edge * LANES + lane)
            out[I(edge_slots[block, at])] += values[at]


@kernel
def tensions(begin: int, end: int, t: Ids, edge_slots: Ids, marks: Ids, law: Any, X: Reals, u: Reals, out: Reals) -> None:
    """Add the tensions of the edges of linear simplices to their slots in `out`, which are set to zero as those of `linearize` are.

    With `T = Ri S Ri'` they are `t_ij = -T_ij`, `t_0i = sum_j T_ij`.
    """
    D, count = law.D, numbers_in(law)
    P, U, values = np.empty(9 * LANES, D.dtype), np.empty(9 * LANES, D.dtype), np.empty(6 * LANES, D.dtype)
    for block in range(begin, end):
        gather_spokes(t, block, X, u, P, U)
        for i in range(LANES):
            lane, at = I(i), I(block * count * LANES + i)
            R = frame(D, at)
            (Q1, Q2, Q3), (h1, h2, h3), (q1, q2, q3) = _deformed(R, P, U, lane)
            T = conjugated(R, stress(law, at, D.dtype.type(1), strain(h1, h2, h3, Q1, Q2, Q3, q1, q2, q3)))
            put((T[0] + T[3] + T[4], -T[3], T[3] + T[1] + T[5], T[4] + T[5] + T[2], -T[4], -T[5]), values, lane)
        out[marks[block] : marks[block + 1]] = 0
        _scatter_tensions(edge_slots, block, values, out)


@kernel
def along(
    begin: int, end: int, t: Ids, points: Points | None, law: Any, X: Reals, u: Reals, v: Reals
) -> tuple[float, float, float, float, float]:
    """Coefficients of the energy of the blocks `begin` to `end` along `u + s v`, a quartic in `s`."""
    D, count = law.D, numbers_in(law)
    x, y, z = room(points, D.dtype), room(points, D.dtype), room(points, D.dtype)
    P, U, V = at_point(points, x), at_point(points, y), at_point(points, z)
    c0, c1, c2, c3, c4 = 0.0, 0.0, 0.0, 0.0, 0.0
    zero = D.dtype.type(0)
    for block in range(begin, end):
        gather(points, t, block, X, x)
        gather(points, t, block, u, y)
        gather(points, t, block, v, z)
        w0, w1, w2, w3, w4 = zero, zero, zero, zero, zero
        for point in range(points_of(points)):
            first, same = numbers_of(points, block, point, count)
            weight = weight_of(points, point, D)
            if not same:
                spokes(points, block, point, x, P)
            spokes(points, block, point, y, U)
            spokes(points, block, point, z, V)
            for i in range(LANES):
                lane, at = I(i), I(first + i)
                R = frame(D, at)
                (Q1, Q2, Q3), (h1, h2, h3), (q1, q2, q3) = _deformed(R, P, U, lane)
                V1, V2, V3 = vectors(V, lane)
                H1, H2, H3 = in_frame(R, V1, V2, V3)
                M = strain(h1, h2, h3, Q1, Q2, Q3, q1, q2, q3)
                N = strain(H1, H2, H3, q1, q2, q3, q1, q2, q3)  # M', and with H in the place of q twice H_i . H_j: M''
                O = strain(H1, H2, H3, H1, H2, H3, H1, H2, H3)
                S, T = stress(law, at, weight, M), stress(law, at, weight, N)
                w0 += contracted(S, M)
                w1 += contracted(S, N)
                w2 += contracted(S, O) + contracted(T, N)
                w3 += contracted(T, O)
                w4 += contracted(stress(law, at, weight, O), O)
            rr, rs, ss = resistance_along(points, block, x, y, U, z, V)
            w0, w1, w2 = w0 + rr, w1 + rs, w2 + ss
        c0, c1, c2, c3, c4 = c0 + w0, c1 + w1, c2 + w2, c3 + w3, c4 + w4
    return c0 / 4, c1 / 2, c2 / 4, c3 / 4, c4 / 16


@inlined
def _between(w, S, w1, T):
    return (
        w * S[0] + w1 * T[0],
        w * S[1] + w1 * T[1],
        w * S[2] + w1 * T[2],
        w * S[3] + w1 * T[3],
        w * S[4] + w1 * T[4],
        w * S[5] + w1 * T[5],
    )


@kernel
def mean_force(
    begin: int,
    end: int,
    t: Ids,
    slots: Ids,
    points: Points | None,
    law: Any,
    X: Reals,
    u: Reals,
    v: Reals,
    w0: float,
    w1: float,
    theta: float,
    f: Reals,
) -> float:
    """Add to the slots `f` what the stresses `w0` at `u` and `w1` at `u + v` pull along the frames at `u + theta v`.

    Returns `1/4 dS:dM` of the blocks `begin` to `end`, the energy of the change of all squared elongations.
    """
    D, count = law.D, numbers_in(law)
    x, y, z, total = room(points, D.dtype), room(points, D.dtype), room(points, D.dtype), room(points, D.dtype)
    P, U, V, forces = at_point(points, x), at_point(points, y), at_point(points, z), at_point(points, total)
    both, later, part = D.dtype.type(w0 + w1), D.dtype.type(w1), D.dtype.type(theta)
    dR = 0.0
    for block in range(begin, end):
        gather(points, t, block, X, x)
        gather(points, t, block, u, y)
        gather(points, t, block, v, z)
        r = D.dtype.type(0)
        if points is not None:
            total[:] = 0
        for point in range(points_of(points)):
            first, same = numbers_of(points, block, point, count)
            weight = weight_of(points, point, D)
            if not same:
                spokes(points, block, point, x, P)
            spokes(points, block, point, y, U)
            spokes(points, block, point, z, V)
            for i in range(LANES):
                lane, at = I(i), I(first + i)
                R = frame(D, at)
                (Q1, Q2, Q3), (h1, h2, h3), (q1, q2, q3) = _deformed(R, P, U, lane)
                V1, V2, V3 = vectors(V, lane)
                H1, H2, H3 = in_frame(R, V1, V2, V3)
                S = stress(law, at, weight, strain(h1, h2, h3, Q1, Q2, Q3, q1, q2, q3))
                N = strain(H1, H2, H3, q1, q2, q3, add(q1, H1), add(q2, H2), add(q3, H3))
                T = stress(law, at, weight, N)
                r += contracted(T, N)
                q1, q2, q3 = add(q1, times(part, H1)), add(q2, times(part, H2)), add(q3, times(part, H3))
                _put_forces(R, _between(both, S, later, T), q1, q2, q3, forces, lane)
            resist(points, block, x, y, U, both, forces, total)
            r += resist(points, block, x, z, V, later, forces, total)
            spread(points, block, point, forces, total)
        dR += r
        scatter(points, slots, block, total, f)
    return dR / 4


@kernel
def damping_force(
    begin: int, end: int, t: Ids, slots: Ids, points: Points | None, law: Any, X: Reals, u: Reals, v: Reals, f: Reals
) -> float:
    """Add the pull of the stresses' rates at velocities `v` along the frames at `u` to the slots `f`; `R` of the blocks."""
    D, count = law.D, numbers_in(law)
    x, y, z, total = room(points, D.dtype), room(points, D.dtype), room(points, D.dtype), room(points, D.dtype)
    P, U, V, forces = at_point(points, x), at_point(points, y), at_point(points, z), at_point(points, total)
    power = 0.0
    for block in range(begin, end):
        gather(points, t, block, X, x)
        gather(points, t, block, u, y)
        gather(points, t, block, v, z)
        r = D.dtype.type(0)
        if points is not None:
            total[:] = 0
        for point in range(points_of(points)):
            first, same = numbers_of(points, block, point, count)
            weight = weight_of(points, point, D)
            if not same:
                spokes(points, block, point, x, P)
            spokes(points, block, point, y, U)
            spokes(points, block, point, z, V)
            for i in range(LANES):
                lane, at = I(i), I(first + i)
                R = frame(D, at)
                _, _, (q1, q2, q3) = _deformed(R, P, U, lane)
                V1, V2, V3 = vectors(V, lane)
                H1, H2, H3 = in_frame(R, V1, V2, V3)
                N = strain(H1, H2, H3, q1, q2, q3, q1, q2, q3)
                T = stress(law, at, weight, N)
                r += contracted(T, N)
                _put_forces(R, T, q1, q2, q3, forces, lane)
            r += resist(points, block, x, z, V, 1, forces, total)
            spread(points, block, point, forces, total)
        power += r
        scatter(points, slots, block, total, f)
    return power / 4


@inlined
def _absolute(a):
    return abs(a[0]), abs(a[1]), abs(a[2])


@inlined
def _sizes_of_strain(h, Q, q, eh, eQ, eq):
    """What the parts of `q_i . h_j + h_i . Q_j` add up to, and what errors `eh, eQ, eq` of them change it by."""
    d = (_absolute(h[0]), _absolute(h[1]), _absolute(h[2]))
    D = (_absolute(Q[0]), _absolute(Q[1]), _absolute(Q[2]))
    p = (_absolute(q[0]), _absolute(q[1]), _absolute(q[2]))
    a = strain(eh[0], eh[1], eh[2], D[0], D[1], D[2], p[0], p[1], p[2])
    b = strain(d[0], d[1], d[2], eQ[0], eQ[1], eQ[2], eq[0], eq[1], eq[2])
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5]


@kernel
def round_off(begin: int, end: int, t: Ids, slots: Ids, points: Points | None, law: Any, X: Reals, u: Reals, f: Reals) -> None:
    """Add to the slots `f` the sizes of all that adds up to the forces: eps times them is what rounding changes the forces by.

    The ends of a spoke have `|u_a| + |u_0|` for its displacement, for `u` is rounded itself; a spoke in its frame has
    `sum_i |Ri_ij| |P_i|`, which of a flat element is much more than `|Q_j|`.
    """
    D, count = law.D, numbers_in(law)
    x, y, z, total = room(points, D.dtype), room(points, D.dtype), room(points, D.dtype), room(points, D.dtype)
    P, U = at_point(points, x), at_point(points, y)
    X_size, U_size, forces = np.empty(9 * LANES, D.dtype), np.empty(9 * LANES, D.dtype), at_point(points, total)
    sizes = absolute(points)
    for block in range(begin, end):
        gather(points, t, block, X, x)
        gather(points, t, block, u, y)
        if points is not None:
            total[:] = 0
        for point in range(points_of(points)):
            first, _ = numbers_of(points, block, point, count)
            weight = weight_of(points, point, D)
            spokes(points, block, point, x, P)
            spokes(points, block, point, y, U)
            gather_sizes(points, t, block, u, z)
            if points is None:
                X_size[:], U_size[:] = np.abs(x), z
            else:
                spokes(sizes, block, point, z, U_size)
                spokes(sizes, block, point, np.abs(x), X_size)
            for i in range(LANES):
                lane, at = I(i), I(first + i)
                R = frame(D, at)
                Q, h, q = _deformed(R, P, U, lane)
                R = (abs(R[0]), abs(R[1]), abs(R[2]), abs(R[3]), abs(R[4]), abs(R[5]))
                P1, P2, P3 = vectors(X_size, lane)
                U1, U2, U3 = vectors(U_size, lane)
                eQ, eh = in_frame(R, P1, P2, P3), in_frame(R, U1, U2, U3)
                eq = (add(eQ[0], eh[0]), add(eQ[1], eh[1]), add(eQ[2], eh[2]))
                M = strain(h[0], h[1], h[2], Q[0], Q[1], Q[2], q[0], q[1], q[2])
                M = (abs(M[0]), abs(M[1]), abs(M[2]), abs(M[3]), abs(M[4]), abs(M[5]))
                S, dS = sizes_of_stress(law, at, weight, M), sizes_of_stress(law, at, weight, _sizes_of_strain(h, Q, q, eh, eQ, eq))
                a1, a2, a3 = pulled(S, add(_absolute(q[0]), eq[0]), add(_absolute(q[1]), eq[1]), add(_absolute(q[2]), eq[2]))
                b1, b2, b3 = pulled(dS, _absolute(q[0]), _absolute(q[1]), _absolute(q[2]))
                s1, s2, s3 = add(a1, b1), add(a2, b2), add(a3, b3)
                f1, f2, f3 = on_spokes(R, s1, s2, s3)
                put(f1, forces, lane)
                put(f2, forces, lane + I(3 * LANES))
                put(f3, forces, lane + I(6 * LANES))
            add_sizes_of_resistance(points, block, x, z, U_size, forces, total)
            spread(sizes, block, point, forces, total)
        scatter_sizes(points, slots, block, total, f)
