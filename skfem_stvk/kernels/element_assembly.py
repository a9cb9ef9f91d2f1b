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
from numpy import uint64

from .compiled import Ids, Reals, by_type, inlined, kernel
from .hourglass import add_hourglass_forces, add_hourglass_magnitudes, hourglass_energy_along
from .lanes import (
    LANES,
    Points,
    absolute,
    add,
    base_vectors,
    find_base_vectors,
    gather,
    gather_base_vectors,
    gather_both,
    gather_magnitudes,
    nodal_zeros,
    point_count,
    point_vectors,
    put,
    scatter,
    scatter_magnitudes,
    six,
    spread,
    vectors,
    weight_of,
)
from .laws import (
    FORMULAS,
    axis_forces,
    base_vector_stiffness,
    between,
    conjugated,
    contracted,
    in_frame,
    law_size,
    magnitudes,
    on_base_vectors,
    respond,
    scale_tensions,
    state_size,
    strain,
    stress,
    stress_magnitudes,
    weighted_sum,
)
from .llvm import prefetch_to_read
from .node_pairs import pair_buffers, put_base_vector_blocks, put_edges, put_pairs
from .rows import add_blocks, close_rows, open_rows


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
    f1, f2, f3 = on_base_vectors(R, s1, s2, s3)
    put(f1, forces, lane)
    put(f2, forces, lane + uint64(3 * LANES))
    put(f3, forces, lane + uint64(6 * LANES))


@inlined
def _prefetch_block(points, block, count, D, t, slots):
    """Prefetch the data of linear simplices two blocks ahead.

    The kernel reads more streams than the hardware prefetcher follows. For 250 000 tetrahedra, F takes 17 ns each with prefetching
    and 20 ns without; K takes 77 and 92 ns (AMD EPYC).
    """
    if points is None:
        later, width = block + 2, slots.size // (len(t) // (4 * LANES))
        prefetch_to_read(D, later * count * LANES, count * LANES)
        prefetch_to_read(t, later * 4 * LANES, 4 * LANES)
        prefetch_to_read(slots, later * width, width)


@kernel
def energy_and_force(
    begin: int, end: int, t: Ids, slots: Ids, points: Points | None, law: Any, X: Reals, u: Reals, f: Reals
) -> float:
    """Return the energy of the blocks `begin` to `end`, and add their forces to the slots `f`, unless `f` is empty."""
    D, count = law.D, law_size(law)
    x, y, total = nodal_zeros(points, D.dtype), nodal_zeros(points, D.dtype), nodal_zeros(points, D.dtype)
    P, U, forces = point_vectors(points, x), point_vectors(points, y), point_vectors(points, total)
    W = 0.0
    for block in range(begin, end):
        _prefetch_block(points, block, count, D, t, slots)
        gather_both(points, t, block, X, u, x, y)
        w = D.dtype.type(0)
        if points is not None:
            total[:] = 0
        for point in range(point_count(points)):
            first, weight = find_base_vectors(points, block, point, count, x, P, y, U), weight_of(points, point, D)
            for i in range(LANES):
                lane, at = uint64(i), uint64(first + i)
                R = six(D, at)
                Q, h, q = _deformed(R, P, U, lane)
                energy, _, s1, s2, s3 = respond(law, at, weight, Q, h, q)
                w += energy
                _put_forces(R, s1, s2, s3, forces, lane)
            w += add_hourglass_forces(points, block, x, y, U, 1, forces, total)
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
    factor `positive` or `negative` for their sign (`laws.scale_tensions`). The hourglass stiffness is multiplied by `positive`,
    because it is a positive tension.
    """
    D, count = law.D, law_size(law)
    x, y, total = nodal_zeros(points, D.dtype), nodal_zeros(points, D.dtype), nodal_zeros(points, D.dtype)
    P, U, forces = point_vectors(points, x), point_vectors(points, y), point_vectors(points, total)
    states = np.empty(state_size(law) * LANES, D.dtype)
    K, T, row, values = pair_buffers(points, to.slots, D.dtype)
    nodes = (len(t) // LANES) // len(to.slots)
    buffer, buffer_state = open_rows(to)
    W = 0.0
    for block in range(begin, end):
        _prefetch_block(points, block, count, D, t, to.slots)
        gather_both(points, t, block, X, u, x, y)
        w = D.dtype.type(0)
        if points is not None:
            total[:] = 0
        for point in range(point_count(points)):
            first, weight = find_base_vectors(points, block, point, count, x, P, y, U), weight_of(points, point, D)
            for i in range(LANES):
                lane, at = uint64(i), uint64(first + i)
                R = six(D, at)
                Q, h, q = _deformed(R, P, U, lane)
                energy, state, s1, s2, s3 = respond(law, at, weight, Q, h, q)
                w += energy
                _put_forces(R, s1, s2, s3, forces, lane)
                put(state, states, lane)
            w += add_hourglass_forces(points, block, x, y, U, 1, forces, total)
            spread(points, block, point, forces, total)
            if positive != 1 or negative != 1:
                scale_tensions(law, points, states, positive, negative)
            for i in range(LANES):
                lane, at = uint64(i), uint64(first + i)
                R = six(D, at)
                stiffness = base_vector_stiffness(law, at, weight, R, states, lane)
                if points is None:
                    put_edges(stiffness, values, lane)
                else:
                    put_base_vector_blocks(stiffness, K, point, lane)
        put_pairs(points, block, nodes, K, x, D.dtype.type(positive), T, row, values)
        W += w
        if len(f) > 0:
            scatter(points, slots, block, total, f)
        buffer_state = add_blocks(to, points, buffer, buffer_state, block, values)
    return W / 4, close_rows(to, buffer, buffer_state)


@kernel
def _scatter_tensions(edge_slots, block, values, out):
    edges = edge_slots.shape[1] // LANES
    for lane in range(LANES):
        for edge in range(edges):
            at = uint64(edge * LANES + lane)
            out[uint64(edge_slots[block, at])] += values[at]


@kernel
def tensions(begin: int, end: int, t: Ids, edge_slots: Ids, marks: Ids, law: Any, X: Reals, u: Reals, out: Reals) -> None:
    """Add the tensions of the edges of linear simplices to their slots in `out`, which are set to zero as in `linearize`.

    With `T = Ri S Ri'` the tensions are `t_ij = -T_ij`, `t_0i = sum_j T_ij`.
    """
    D, count = law.D, law_size(law)
    P, U, values = np.empty(9 * LANES, D.dtype), np.empty(9 * LANES, D.dtype), np.empty(6 * LANES, D.dtype)
    for block in range(begin, end):
        gather_base_vectors(t, block, X, u, P, U)
        for i in range(LANES):
            lane, at = uint64(i), uint64(block * count * LANES + i)
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
    D, count = law.D, law_size(law)
    x, y, z = nodal_zeros(points, D.dtype), nodal_zeros(points, D.dtype), nodal_zeros(points, D.dtype)
    P, U, V = point_vectors(points, x), point_vectors(points, y), point_vectors(points, z)
    c0, c1, c2, c3, c4 = 0.0, 0.0, 0.0, 0.0, 0.0
    zero = D.dtype.type(0)
    for block in range(begin, end):
        gather(points, t, block, X, x)
        gather(points, t, block, u, y)
        gather(points, t, block, v, z)
        w0, w1, w2, w3, w4 = zero, zero, zero, zero, zero
        for point in range(point_count(points)):
            first, weight = find_base_vectors(points, block, point, count, x, P, y, U), weight_of(points, point, D)
            base_vectors(points, block, point, z, V)
            for i in range(LANES):
                lane, at = uint64(i), uint64(first + i)
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
            rr, rs, ss = hourglass_energy_along(points, block, x, y, U, z, V)
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


def rule_forces(rule: Any, law: Any, at: Any, weight: Any, rest: Any, moved: Any, now: Any, change: Any) -> Any:
    """Return a number that is summed over the points, and the forces on the axes of the frame, by a rule such as `MeanStress`.

    `rest`, `moved`, `now`, `change` : the frame at rest Q, its displacements h, q = Q + h, and H, the v in the frame.
    """
    return FORMULAS["rule_forces", type(rule)](rule, law, at, weight, rest, moved, now, change)


def hourglass_share(rule: Any) -> tuple[float, float]:
    """Return the factor of the hourglass forces, and theta: the forces are evaluated at `u + theta v`."""
    return FORMULAS["hourglass_share", type(rule)](rule)


@by_type(hourglass_share, MeanStress, FORMULAS)
def _mean_share(rule):
    return rule.w0 + rule.w1, rule.theta


@by_type(hourglass_share, StressOfRates, FORMULAS)
def _no_share(rule):
    return 0.0, 0.0


@by_type(rule_forces, MeanStress, FORMULAS)
def _forces_of_mean_stress(rule, law, at, weight, Q, h, q, H):
    number = law.D.dtype.type
    S = stress(law, at, weight, strain(h[0], h[1], h[2], Q[0], Q[1], Q[2], q[0], q[1], q[2]))
    N = strain(H[0], H[1], H[2], q[0], q[1], q[2], add(q[0], H[0]), add(q[1], H[1]), add(q[2], H[2]))
    T = stress(law, at, weight, N)
    return contracted(T, N) / 4, axis_forces(
        weighted_sum(number(rule.w0 + rule.w1), S, number(rule.w1), T), *between(q, number(rule.theta), H)
    )


@by_type(rule_forces, StressOfRates, FORMULAS)
def _forces_of_rates(rule, law, at, weight, Q, h, q, H):
    N = strain(H[0], H[1], H[2], q[0], q[1], q[2], q[0], q[1], q[2])
    T = stress(law, at, weight, N)
    return contracted(T, N) / 4, axis_forces(T, q[0], q[1], q[2])


@kernel
def forces_between(
    begin: int, end: int, t: Ids, slots: Ids, points: Points | None, law: Any, X: Reals, u: Reals, v: Reals, rule: Any, f: Reals
) -> float:
    """Add forces between the states `u` and `u + v` to the slots `f`, by a rule such as `MeanStress`.

    Returns the sum of the numbers of the rule over the points of the blocks `begin` to `end`.
    """
    D, count = law.D, law_size(law)
    x, y, z, total = (
        nodal_zeros(points, D.dtype),
        nodal_zeros(points, D.dtype),
        nodal_zeros(points, D.dtype),
        nodal_zeros(points, D.dtype),
    )
    P, U, V, forces = point_vectors(points, x), point_vectors(points, y), point_vectors(points, z), point_vectors(points, total)
    factor, theta = hourglass_share(rule)
    both, part = D.dtype.type(factor), D.dtype.type(theta)
    more = 0.0
    for block in range(begin, end):
        gather(points, t, block, X, x)
        gather(points, t, block, u, y)
        gather(points, t, block, v, z)
        r = D.dtype.type(0)
        if points is not None:
            total[:] = 0
        for point in range(point_count(points)):
            first, weight = find_base_vectors(points, block, point, count, x, P, y, U), weight_of(points, point, D)
            base_vectors(points, block, point, z, V)
            for i in range(LANES):
                lane, at = uint64(i), uint64(first + i)
                R = six(D, at)
                Q, h, q = _deformed(R, P, U, lane)
                V1, V2, V3 = vectors(V, lane)
                added, (s1, s2, s3) = rule_forces(rule, law, at, weight, Q, h, q, in_frame(R, V1, V2, V3))
                r += added
                _put_forces(R, s1, s2, s3, forces, lane)
            add_hourglass_forces(points, block, x, y, U, both, forces, total)
            add_hourglass_forces(points, block, x, z, V, both * part, forces, total)
            spread(points, block, point, forces, total)
        more += r
        scatter(points, slots, block, total, f)
    return more


@inlined
def _absolute(a):
    return abs(a[0]), abs(a[1]), abs(a[2])


@inlined
def _strain_magnitudes(h, Q, q, eh, eQ, eq):
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
    D, count = law.D, law_size(law)
    x, y, z, total = (
        nodal_zeros(points, D.dtype),
        nodal_zeros(points, D.dtype),
        nodal_zeros(points, D.dtype),
        nodal_zeros(points, D.dtype),
    )
    P, U = point_vectors(points, x), point_vectors(points, y)
    X_size, U_size, forces = np.empty(9 * LANES, D.dtype), np.empty(9 * LANES, D.dtype), point_vectors(points, total)
    table = absolute(points)
    for block in range(begin, end):
        gather(points, t, block, X, x)
        gather(points, t, block, u, y)
        if points is not None:
            total[:] = 0
        for point in range(point_count(points)):
            first, weight = find_base_vectors(points, block, point, count, x, P, y, U), weight_of(points, point, D)
            gather_magnitudes(points, t, block, u, z)
            if points is None:
                X_size[:], U_size[:] = np.abs(x), z
            else:
                base_vectors(table, block, point, z, U_size)
                base_vectors(table, block, point, np.abs(x), X_size)
            for i in range(LANES):
                lane, at = uint64(i), uint64(first + i)
                R = six(D, at)
                Q, h, q = _deformed(R, P, U, lane)
                R = magnitudes(R)
                P1, P2, P3 = vectors(X_size, lane)
                U1, U2, U3 = vectors(U_size, lane)
                eQ, eh = in_frame(R, P1, P2, P3), in_frame(R, U1, U2, U3)
                eq = (add(eQ[0], eh[0]), add(eQ[1], eh[1]), add(eQ[2], eh[2]))
                M = strain(h[0], h[1], h[2], Q[0], Q[1], Q[2], q[0], q[1], q[2])
                S, dS = (
                    stress_magnitudes(law, at, weight, magnitudes(M)),
                    stress_magnitudes(law, at, weight, _strain_magnitudes(h, Q, q, eh, eQ, eq)),
                )
                a1, a2, a3 = axis_forces(S, add(_absolute(q[0]), eq[0]), add(_absolute(q[1]), eq[1]), add(_absolute(q[2]), eq[2]))
                b1, b2, b3 = axis_forces(dS, _absolute(q[0]), _absolute(q[1]), _absolute(q[2]))
                s1, s2, s3 = add(a1, b1), add(a2, b2), add(a3, b3)
                f1, f2, f3 = on_base_vectors(R, s1, s2, s3)
                put(f1, forces, lane)
                put(f2, forces, lane + uint64(3 * LANES))
                put(f3, forces, lane + uint64(6 * LANES))
            add_hourglass_magnitudes(points, block, x, z, U_size, forces, total)
            spread(table, block, point, forces, total)
        scatter_magnitudes(points, slots, block, total, f)
