"""W, F and the blocks of node pairs of K, element by element: the kernels of all assembly.

For each block of elements, a kernel gathers the nodal differences. At each point it computes base vectors, frame and law (`laws`).
Then it spreads the forces on the base vectors over the nodes and scatters them. With `K_ij` the stiffness between base vectors, and
sums over points, i and j:

    W = sum of w W        F_a = sum of dN_a/dxi_i f_i        K_ab = sum of dN_a/dxi_i dN_b/dxi_j K_ij

Shape functions sum to 1. Therefore only differences to node 0 are read. The force on node 0 is minus the sum of the others, and
likewise its rows of K. A linear simplex has one point, and its nodes are the ends of the base vectors. `points` is None then, and
nodal differences and base vectors are the same.

W, F and K are computed for any law. The other kernels are for St. Venant-Kirchhoff only:

    zeta(u + s v) is quadratic in s, so W is a quartic. With M' = dM/ds, M'' = d2M/ds2 at s = 0, S', S'' likewise, and H_j the v
    in the frame:
    M'_ij = q_i . H_j + H_i . q_j        M''_ij = 2 H_i . H_j
    W(s)  = S:M/4 + S:M'/2 s + (S:M'' + S':M')/4 s^2 + S':M''/4 s^3 + S'':M''/16 s^4

    From u to u + v M changes by dM_ij = (q_i + H_i) . H_j + H_i . q_j. The stresses w0 S + w1 (S + dS) act along q_i + theta H_i.
    Their work over v is W(u + v) - W(u) + (w1 - w0)/4 dS:dM for theta = 1/2, w0 + w1 = 1. At velocities v the S' act along q_i:
    they are the derivative of R = 1/4 S':M' by H_i, and dissipate the power 2 R.

Blocks of lanes and the shared arrays are described in `lanes`. Threads process consecutive blocks, and no two threads share a slot.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .compiled import Ids, Reals, by_type, inlined, kernel
from .hourglass import add_sizes_of_resistance, resist, resistance_along
from .lanes import (
    LANES,
    I,
    Points,
    absolute,
    add,
    at_point,
    find_spokes,
    gather,
    gather_both,
    gather_sizes,
    gather_spokes,
    points_of,
    put,
    room,
    scatter,
    scatter_sizes,
    six,
    spokes,
    spread,
    vectors,
    weight_of,
)
from .laws import (
    FORMULAS,
    between,
    conjugated,
    contracted,
    in_frame,
    numbers_in,
    numbers_kept,
    on_spokes,
    pulled,
    respond,
    sizes,
    sizes_of_stress,
    spoke_stiffness,
    strain,
    stress,
    weigh,
    weighted_sum,
)
from .node_pairs import put_edges, put_pairs, put_spokes, room_for_pairs
from .rows import add_blocks, close_rows, open_rows
from .wide import bring


@inlined
def _deformed(R, P, U, lane):
    """Return the frame at rest `Q`, its displacements `h` and the deformed frame `q` of a lane with base vectors `P` and `U`."""
    P1, P2, P3 = vectors(P, lane)
    U1, U2, U3 = vectors(U, lane)
    Q, h = in_frame(R, P1, P2, P3), in_frame(R, U1, U2, U3)
    return Q, h, (add(Q[0], h[0]), add(Q[1], h[1]), add(Q[2], h[2]))


@inlined
def _strained(R, P, U, lane):
    """Return the deformed frame of a lane, and `M`."""
    (Q1, Q2, Q3), (h1, h2, h3), (q1, q2, q3) = _deformed(R, P, U, lane)
    return (q1, q2, q3), strain(h1, h2, h3, Q1, Q2, Q3, q1, q2, q3)


@inlined
def _put_forces(R, s1, s2, s3, forces, lane):
    """Write the forces on the base vectors, from the forces `s1, s2, s3` on the axes of the frame."""
    f1, f2, f3 = on_spokes(R, s1, s2, s3)
    put(f1, forces, lane)
    put(f2, forces, lane + I(3 * LANES))
    put(f3, forces, lane + I(6 * LANES))


@inlined
def _bring(points, block, count, D, t, slots):
    """Prefetch the data of linear simplices two blocks ahead.

    The kernel reads more streams than the hardware prefetcher follows. For 250 000 tetrahedra, F takes 17 ns each with prefetching
    and 20 ns without; K takes 77 and 92 ns (AMD EPYC).
    """
    if points is None:
        later, width = block + 2, slots.size // (len(t) // (4 * LANES))
        bring(D, later * count * LANES, count * LANES)
        bring(t, later * 4 * LANES, 4 * LANES)
        bring(slots, later * width, width)


@kernel
def energy_and_force(
    begin: int, end: int, t: Ids, slots: Ids, points: Points | None, law: Any, X: Reals, u: Reals, f: Reals
) -> float:
    """Return the energy of the blocks `begin` to `end`, and add their forces to the slots `f`, unless `f` is empty."""
    D, count = law.D, numbers_in(law)
    x, y, total = room(points, D.dtype), room(points, D.dtype), room(points, D.dtype)
    P, U, forces = at_point(points, x), at_point(points, y), at_point(points, total)
    W = 0.0
    for block in range(begin, end):
        _bring(points, block, count, D, t, slots)
        gather_both(points, t, block, X, u, x, y)
        w = D.dtype.type(0)
        if points is not None:
            total[:] = 0
        for point in range(points_of(points)):
            first, weight = find_spokes(points, block, point, count, x, P, y, U), weight_of(points, point, D)
            for i in range(LANES):
                lane, at = I(i), I(first + i)
                R = six(D, at)
                Q, h, q = _deformed(R, P, U, lane)
                energy, _, s1, s2, s3 = respond(law, at, weight, Q, h, q)
                w += energy
                _put_forces(R, s1, s2, s3, forces, lane)
            w += resist(points, block, x, y, U, 1, forces, total)
            spread(points, block, point, forces, total)
        W += w
        if len(f) > 0:
            scatter(points, slots, block, total, f)
    return W / 4


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
    """Return the energy and the trace of the rows of K that were written (`rows`).

    Forces are added to the slots `f`, unless `f` is empty, and `K_ab` to the destination `to`. Tensions are multiplied by the
    factor `positive` or `negative` for their sign (`laws.weigh`). The hourglass stiffness is multiplied by `positive`, because it
    is a positive tension.
    """
    D, count = law.D, numbers_in(law)
    x, y, total = room(points, D.dtype), room(points, D.dtype), room(points, D.dtype)
    P, U, forces = at_point(points, x), at_point(points, y), at_point(points, total)
    kept = np.empty(numbers_kept(law) * LANES, D.dtype)
    K, T, row, values = room_for_pairs(points, to.slots, D.dtype)
    nodes = (len(t) // LANES) // len(to.slots)
    stage, place = open_rows(to)
    W = 0.0
    for block in range(begin, end):
        _bring(points, block, count, D, t, to.slots)
        gather_both(points, t, block, X, u, x, y)
        w = D.dtype.type(0)
        if points is not None:
            total[:] = 0
        for point in range(points_of(points)):
            first, weight = find_spokes(points, block, point, count, x, P, y, U), weight_of(points, point, D)
            for i in range(LANES):
                lane, at = I(i), I(first + i)
                R = six(D, at)
                Q, h, q = _deformed(R, P, U, lane)
                energy, state, s1, s2, s3 = respond(law, at, weight, Q, h, q)
                w += energy
                _put_forces(R, s1, s2, s3, forces, lane)
                put(state, kept, lane)
            w += resist(points, block, x, y, U, 1, forces, total)
            spread(points, block, point, forces, total)
            if positive != 1 or negative != 1:
                weigh(law, points, kept, positive, negative)
            for i in range(LANES):
                lane, at = I(i), I(first + i)
                R = six(D, at)
                stiffness = spoke_stiffness(law, at, weight, R, kept, lane)
                if points is None:
                    put_edges(stiffness, values, lane)
                else:
                    put_spokes(stiffness, K, point, lane)
        put_pairs(points, block, nodes, K, x, D.dtype.type(positive), T, row, values)
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
    """Add the tensions of the edges of linear simplices to their slots in `out`, which are set to zero as in `linearize`.

    With `T = Ri S Ri'` the tensions are `t_ij = -T_ij`, `t_0i = sum_j T_ij`.
    """
    D, count = law.D, numbers_in(law)
    P, U, values = np.empty(9 * LANES, D.dtype), np.empty(9 * LANES, D.dtype), np.empty(6 * LANES, D.dtype)
    for block in range(begin, end):
        gather_spokes(t, block, X, u, P, U)
        for i in range(LANES):
            lane, at = I(i), I(block * count * LANES + i)
            R = six(D, at)
            _, M = _strained(R, P, U, lane)
            T = conjugated(R, stress(law, at, D.dtype.type(1), M))
            put((T[0] + T[3] + T[4], -T[3], T[3] + T[1] + T[5], T[4] + T[5] + T[2], -T[4], -T[5]), values, lane)
        out[marks[block] : marks[block + 1]] = 0
        _scatter_tensions(edge_slots, block, values, out)


@kernel
def along(
    begin: int, end: int, t: Ids, points: Points | None, law: Any, X: Reals, u: Reals, v: Reals
) -> tuple[float, float, float, float, float]:
    """Return the five coefficients of the energy of the blocks `begin` to `end` along `u + s v`, a quartic in `s`."""
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
            first, weight = find_spokes(points, block, point, count, x, P, y, U), weight_of(points, point, D)
            spokes(points, block, point, z, V)
            for i in range(LANES):
                lane, at = I(i), I(first + i)
                R = six(D, at)
                (q1, q2, q3), M = _strained(R, P, U, lane)
                S = stress(law, at, weight, M)
                V1, V2, V3 = vectors(V, lane)
                H1, H2, H3 = in_frame(R, V1, V2, V3)
                N = strain(H1, H2, H3, q1, q2, q3, q1, q2, q3)  # M'; with H in place of q, twice H_i . H_j: M''
                O = strain(H1, H2, H3, H1, H2, H3, H1, H2, H3)
                T = stress(law, at, weight, N)
                w0 += contracted(S, M)
                w1 += contracted(S, N)
                w2 += contracted(S, O) + contracted(T, N)
                w3 += contracted(T, O)
                w4 += contracted(stress(law, at, weight, O), O)
            rr, rs, ss = resistance_along(points, block, x, y, U, z, V)
            w0, w1, w2 = w0 + rr, w1 + rs, w2 + ss
        c0, c1, c2, c3, c4 = c0 + w0, c1 + w1, c2 + w2, c3 + w3, c4 + w4
    return c0 / 4, c1 / 2, c2 / 4, c3 / 4, c4 / 16


class MeanStress(NamedTuple):
    """Rule of forces between two states, for a law linear in M: stresses `w0 S + w1 (S + dS)` act along `q_i + theta H_i`."""

    w0: float
    w1: float
    theta: float


class StressOfRates(NamedTuple):
    """Rule of forces at velocities `v`: the stress `S'` acts along `q_i`."""


def pulls_along(rule: Any, law: Any, at: Any, weight: Any, rest: Any, moved: Any, now: Any, change: Any) -> Any:
    """Return a number that is summed over the points, and the forces on the axes of the frame, by a rule such as `MeanStress`.

    `rest`, `moved`, `now`, `change` : the frame at rest Q, its displacements h, q = Q + h, and H, the v in the frame.
    """
    return FORMULAS["pulls_along", type(rule)](rule, law, at, weight, rest, moved, now, change)


def share_of_resistance(rule: Any) -> tuple[float, float]:
    """Return the factor of the hourglass forces, and theta: the forces are evaluated at `u + theta v`."""
    return FORMULAS["share_of_resistance", type(rule)](rule)


@by_type(share_of_resistance, MeanStress, FORMULAS)
def _mean_share(rule):
    return rule.w0 + rule.w1, rule.theta


@by_type(share_of_resistance, StressOfRates, FORMULAS)
def _no_share(rule):
    return 0.0, 0.0


@by_type(pulls_along, MeanStress, FORMULAS)
def _pull_of_means(rule, law, at, weight, Q, h, q, H):
    number = law.D.dtype.type
    S = stress(law, at, weight, strain(h[0], h[1], h[2], Q[0], Q[1], Q[2], q[0], q[1], q[2]))
    N = strain(H[0], H[1], H[2], q[0], q[1], q[2], add(q[0], H[0]), add(q[1], H[1]), add(q[2], H[2]))
    T = stress(law, at, weight, N)
    return contracted(T, N) / 4, pulled(
        weighted_sum(number(rule.w0 + rule.w1), S, number(rule.w1), T), *between(q, number(rule.theta), H)
    )


@by_type(pulls_along, StressOfRates, FORMULAS)
def _pull_of_rates(rule, law, at, weight, Q, h, q, H):
    N = strain(H[0], H[1], H[2], q[0], q[1], q[2], q[0], q[1], q[2])
    T = stress(law, at, weight, N)
    return contracted(T, N) / 4, pulled(T, q[0], q[1], q[2])


@kernel
def forces_along(
    begin: int, end: int, t: Ids, slots: Ids, points: Points | None, law: Any, X: Reals, u: Reals, v: Reals, rule: Any, f: Reals
) -> float:
    """Add forces between the states `u` and `u + v` to the slots `f`, by a rule such as `MeanStress`.

    Returns the sum of the numbers of the rule over the points of the blocks `begin` to `end`.
    """
    D, count = law.D, numbers_in(law)
    x, y, z, total = room(points, D.dtype), room(points, D.dtype), room(points, D.dtype), room(points, D.dtype)
    P, U, V, forces = at_point(points, x), at_point(points, y), at_point(points, z), at_point(points, total)
    factor, theta = share_of_resistance(rule)
    both, part = D.dtype.type(factor), D.dtype.type(theta)
    more = 0.0
    for block in range(begin, end):
        gather(points, t, block, X, x)
        gather(points, t, block, u, y)
        gather(points, t, block, v, z)
        r = D.dtype.type(0)
        if points is not None:
            total[:] = 0
        for point in range(points_of(points)):
            first, weight = find_spokes(points, block, point, count, x, P, y, U), weight_of(points, point, D)
            spokes(points, block, point, z, V)
            for i in range(LANES):
                lane, at = I(i), I(first + i)
                R = six(D, at)
                Q, h, q = _deformed(R, P, U, lane)
                V1, V2, V3 = vectors(V, lane)
                added, (s1, s2, s3) = pulls_along(rule, law, at, weight, Q, h, q, in_frame(R, V1, V2, V3))
                r += added
                _put_forces(R, s1, s2, s3, forces, lane)
            resist(points, block, x, y, U, both, forces, total)
            resist(points, block, x, z, V, both * part, forces, total)
            spread(points, block, point, forces, total)
        more += r
        scatter(points, slots, block, total, f)
    return more


@inlined
def _absolute(a):
    return abs(a[0]), abs(a[1]), abs(a[2])


@inlined
def _sizes_of_strain(h, Q, q, eh, eQ, eq):
    """Return the first-order change of `q_i . h_j + h_i . Q_j` by errors `eh, eQ, eq`, with all terms in absolute value."""
    d = (_absolute(h[0]), _absolute(h[1]), _absolute(h[2]))
    D = (_absolute(Q[0]), _absolute(Q[1]), _absolute(Q[2]))
    p = (_absolute(q[0]), _absolute(q[1]), _absolute(q[2]))
    a = strain(eh[0], eh[1], eh[2], D[0], D[1], D[2], p[0], p[1], p[2])
    b = strain(d[0], d[1], d[2], eQ[0], eQ[1], eQ[2], eq[0], eq[1], eq[2])
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5]


@kernel
def round_off(begin: int, end: int, t: Ids, slots: Ids, points: Points | None, law: Any, X: Reals, u: Reals, f: Reals) -> None:
    """Add to the slots `f` the sums of the absolute values of all terms of the forces.

    Eps times these sums estimates the rounding error of the forces. The displacement of a base vector is replaced by `|u_a| +
    |u_0|`, because `u` itself is rounded. A base vector in the frame is replaced by `sum_i |Ri_ij| |P_i|`, which is much larger
    than `|Q_j|` for a flat element.
    """
    D, count = law.D, numbers_in(law)
    x, y, z, total = room(points, D.dtype), room(points, D.dtype), room(points, D.dtype), room(points, D.dtype)
    P, U = at_point(points, x), at_point(points, y)
    X_size, U_size, forces = np.empty(9 * LANES, D.dtype), np.empty(9 * LANES, D.dtype), at_point(points, total)
    table = absolute(points)
    for block in range(begin, end):
        gather(points, t, block, X, x)
        gather(points, t, block, u, y)
        if points is not None:
            total[:] = 0
        for point in range(points_of(points)):
            first, weight = find_spokes(points, block, point, count, x, P, y, U), weight_of(points, point, D)
            gather_sizes(points, t, block, u, z)
            if points is None:
                X_size[:], U_size[:] = np.abs(x), z
            else:
                spokes(table, block, point, z, U_size)
                spokes(table, block, point, np.abs(x), X_size)
            for i in range(LANES):
                lane, at = I(i), I(first + i)
                R = six(D, at)
                Q, h, q = _deformed(R, P, U, lane)
                R = sizes(R)
                P1, P2, P3 = vectors(X_size, lane)
                U1, U2, U3 = vectors(U_size, lane)
                eQ, eh = in_frame(R, P1, P2, P3), in_frame(R, U1, U2, U3)
                eq = (add(eQ[0], eh[0]), add(eQ[1], eh[1]), add(eQ[2], eh[2]))
                M = strain(h[0], h[1], h[2], Q[0], Q[1], Q[2], q[0], q[1], q[2])
                S, dS = (
                    sizes_of_stress(law, at, weight, sizes(M)),
                    sizes_of_stress(law, at, weight, _sizes_of_strain(h, Q, q, eh, eQ, eq)),
                )
                a1, a2, a3 = pulled(S, add(_absolute(q[0]), eq[0]), add(_absolute(q[1]), eq[1]), add(_absolute(q[2]), eq[2]))
                b1, b2, b3 = pulled(dS, _absolute(q[0]), _absolute(q[1]), _absolute(q[2]))
                s1, s2, s3 = add(a1, b1), add(a2, b2), add(a3, b3)
                f1, f2, f3 = on_spokes(R, s1, s2, s3)
                put(f1, forces, lane)
                put(f2, forces, lane + I(3 * LANES))
                put(f3, forces, lane + I(6 * LANES))
            add_sizes_of_resistance(points, block, x, z, U_size, forces, total)
            spread(table, block, point, forces, total)
        scatter_sizes(points, slots, block, total, f)
