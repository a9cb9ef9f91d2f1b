"""W, F and the edge blocks of K of energies of the volume ratio J, simplex by simplex.

With the signed volume form `C = p_1 . (p_2 x p_3)` of the spokes `p_i = P_i + U_i`, `C0` that at rest and `V0` the volume at rest:

    e = J - 1 = (C - C0)/C0        C - C0 = U_1 . (p_2 x p_3) + P_1 . (U_2 x p_3 + P_2 x U_3)        no cancellation at small strain
    W = V0 psi(J)        f_i = V0/C0 psi' n_i        n_i = dC/dp_i: n_1 = p_2 x p_3, and so on; n_0 = -(n_1 + n_2 + n_3)
    K_ab = V0/C0^2 psi'' n_a n_b' + V0/C0 psi' [q_ab]        [q] x = q x x        q_12 = -p_3, q_13 = p_2, q_23 = -p_1

`q` of the edges of vertex 0 follows from the row sums: the edge opposite, as for the others. Per unit of stiffness:

    quadratic      psi = e^2/2                                psi' = e                           psi'' = 1
    compression    psi = -e^3/3           for e < 0           psi' = -e^2                        psi'' = -2 e
    barrier        psi = -e^2 ln J        for 0 < J < 1       psi' = -(2 e ln J + e^2/J)         psi'' = -2 ln J - 4 e/J + e^2/J^2

No `psi''` is negative, and in no sum do terms of both signs meet. Without `psi'` K is positive semi-definite.

A triangle in the plane has (0, 0, 1) for its third spoke, a segment on the line (0, 1, 0) and (0, 0, 1): of what belongs to them
nothing counts.

Simplices stand in blocks of lanes, and arrays are those of `simplices`; `D` (blocks, 2 LANES) has the stiffness times `V0` and
`1/C0`.
"""

from __future__ import annotations

import numpy as np

from .compiled import Ids, Reals, inlined, kernel
from .lanes import (
    LANES,
    I,
    add,
    complete_spokes,
    cross,
    dot,
    gather_sizes,
    gather_spokes,
    put,
    scatter_blocks,
    scatter_forces,
    scatter_sizes,
    times,
    vector,
    vectors,
)

#: The kinds of energy, as kernels know them.
QUADRATIC, COMPRESSION, BARRIER = 0, 1, 2


@inlined
def _minus(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@kernel
def _find_ratios(P, U, D, block, e, J):
    """`e` and `J` of a block: each without cancellation where the other has it, at rest and where no volume is left."""
    for i in range(LANES):
        lane = I(i)
        P1, P2, P3 = vectors(P, lane)
        U1, U2, U3 = vectors(U, lane)
        p1, p2, p3 = add(P1, U1), add(P2, U2), add(P3, U3)
        n1, over_C0 = cross(p2, p3), D[block, lane + I(LANES)]
        e[lane] = over_C0 * (dot(U1, n1) + dot(P1, add(cross(U2, p3), cross(P2, U3))))
        J[lane] = over_C0 * dot(p1, n1)


@kernel
def _find_energies(kind, D, block, e, J, psi, slope, curvature):
    """`psi, psi', psi''` of a block; the smallest `J` of it if that is where psi has no meaning, otherwise 1."""
    zero, half, third = e.dtype.type(0), e.dtype.type(0.5), e.dtype.type(1 / 3)
    nothing, least = e.dtype.type(np.nan), e.dtype.type(1)
    if kind == QUADRATIC:
        for i in range(LANES):
            x = e[I(i)]
            psi[I(i)], slope[I(i)], curvature[I(i)] = half * x * x, x, e.dtype.type(1)
    elif kind == COMPRESSION:
        for i in range(LANES):
            x = zero if e[I(i)] >= 0 else e[I(i)]  # what is not a number stays that
            psi[I(i)], slope[I(i)], curvature[I(i)] = -third * x * x * x, -x * x, -(x + x)
    else:
        for i in range(LANES):
            lane = I(i)
            x, ratio = e[lane], J[lane]
            if x >= 0:
                psi[lane], slope[lane], curvature[lane] = zero, zero, zero
            elif ratio > 0:
                logarithm, y = np.log1p(x) if x > -half else np.log(ratio), x / ratio
                psi[lane] = -x * x * logarithm
                slope[lane] = -((x + x) * logarithm + x * y)
                curvature[lane] = y * y - (logarithm + logarithm) - (y + y + y + y)
            else:
                psi[lane], slope[lane], curvature[lane] = nothing, nothing, nothing
                if ratio <= 0 and D[block, lane] > 0:
                    least = min(ratio, least)
    return least


@inlined
def _normals(P, U, lane, more, most):
    """The spokes now, and `dC/dp_i`; those of constant spokes, for which `more` or `most` is zero, are zero."""
    p1 = add(vector(P, lane), vector(U, lane))
    p2 = add(vector(P, lane + I(3 * LANES)), vector(U, lane + I(3 * LANES)))
    p3 = add(vector(P, lane + I(6 * LANES)), vector(U, lane + I(6 * LANES)))
    return p1, p2, p3, cross(p2, p3), times(more, cross(p3, p1)), times(most, cross(p1, p2))


@kernel
def penalty_energy_and_force(
    begin: int, end: int, t: Ids, slots: Ids, D: Reals, X: Reals, u: Reals, k: int, kind: int, f: Reals
) -> tuple[float, float]:
    """The energy of the blocks `begin` to `end`; adds their forces to the slots `f`, unless that is empty.

    Also the smallest `J` of them if the barrier has no meaning there, `J <= 0`: energy and forces have none then.
    """
    P, U, forces = np.empty(9 * LANES, D.dtype), np.empty(9 * LANES, D.dtype), np.empty(9 * LANES, D.dtype)
    e, J = np.empty(LANES, D.dtype), np.empty(LANES, D.dtype)
    psi, slope, curvature = np.empty(LANES, D.dtype), np.empty(LANES, D.dtype), np.empty(LANES, D.dtype)
    more, most = D.dtype.type(k > 1), D.dtype.type(k > 2)
    W, least = 0.0, 1.0
    for block in range(begin, end):
        gather_spokes(t, block, X, u, P, U)
        complete_spokes(k, P)
        _find_ratios(P, U, D, block, e, J)
        least = min(_find_energies(kind, D, block, e, J, psi, slope, curvature), least)
        w = D.dtype.type(0)
        for i in range(LANES):
            lane = I(i)
            stiffness = D[block, lane]
            w += stiffness * psi[lane]
            factor = stiffness * D[block, lane + I(LANES)] * slope[lane]
            _, _, _, n1, n2, n3 = _normals(P, U, lane, more, most)
            put(times(factor, n1), forces, lane)
            put(times(factor, n2), forces, lane + I(3 * LANES))
            put(times(factor, n3), forces, lane + I(6 * LANES))
        W += w
        if len(f) > 0:
            scatter_forces(slots, block, forces, f)
    return W, least


@inlined
def _put_block(a, b, q, out, at):
    """`a b' + [q]`, row by row."""
    out[at] = a[0] * b[0]
    out[at + I(LANES)] = a[0] * b[1] - q[2]
    out[at + I(2 * LANES)] = a[0] * b[2] + q[1]
    out[at + I(3 * LANES)] = a[1] * b[0] + q[2]
    out[at + I(4 * LANES)] = a[1] * b[1]
    out[at + I(5 * LANES)] = a[1] * b[2] - q[0]
    out[at + I(6 * LANES)] = a[2] * b[0] - q[1]
    out[at + I(7 * LANES)] = a[2] * b[1] + q[0]
    out[at + I(8 * LANES)] = a[2] * b[2]


@kernel
def penalty_linearize(
    begin: int,
    end: int,
    t: Ids,
    slots: Ids,
    edge_slots: Ids,
    marks: Ids,
    D: Reals,
    X: Reals,
    u: Reals,
    k: int,
    kind: int,
    kept: float,
    f: Reals,
    blocks: Reals,
) -> tuple[float, float]:
    """As in `penalty_energy_and_force`; adds `K_ab`, `psi'` times `kept` in it, to the edges' slots in `blocks`."""
    P, U, forces = np.empty(9 * LANES, D.dtype), np.empty(9 * LANES, D.dtype), np.empty(9 * LANES, D.dtype)
    e, J = np.empty(LANES, D.dtype), np.empty(LANES, D.dtype)
    psi, slope, curvature = np.empty(LANES, D.dtype), np.empty(LANES, D.dtype), np.empty(LANES, D.dtype)
    values = np.empty(54 * LANES, D.dtype)
    more, most = D.dtype.type(k > 1), D.dtype.type(k > 2)
    W, least = 0.0, 1.0
    for block in range(begin, end):
        gather_spokes(t, block, X, u, P, U)
        complete_spokes(k, P)
        _find_ratios(P, U, D, block, e, J)
        least = min(_find_energies(kind, D, block, e, J, psi, slope, curvature), least)
        w = D.dtype.type(0)
        for i in range(LANES):
            lane = I(i)
            stiffness, over_C0 = D[block, lane], D[block, lane + I(LANES)]
            w += stiffness * psi[lane]
            factor, bend = stiffness * over_C0 * slope[lane], stiffness * curvature[lane]
            p1, p2, p3, n1, n2, n3 = _normals(P, U, lane, more, most)
            put(times(factor, n1), forces, lane)
            put(times(factor, n2), forces, lane + I(3 * LANES))
            put(times(factor, n3), forces, lane + I(6 * LANES))
            # n/C0, the gradient of J, keeps its size where C0 and n are tiny
            y1, y2, y3 = times(over_C0, n1), times(over_C0, n2), times(over_C0, n3)
            y0 = (-(y1[0] + y2[0] + y3[0]), -(y1[1] + y2[1] + y3[1]), -(y1[2] + y2[2] + y3[2]))
            z0, z1, z2 = times(bend, y0), times(bend, y1), times(bend, y2)
            h = D.dtype.type(kept) * factor
            q12, q13, q23 = times(-h * more, p3), times(h * most, p2), times(-h * most, p1)
            _put_block(z0, y1, add(q12, q13), values, lane)
            _put_block(z1, y2, q12, values, lane + I(9 * LANES))
            _put_block(z0, y2, _minus(q23, q12), values, lane + I(18 * LANES))
            _put_block(z0, y3, times(D.dtype.type(-1), add(q13, q23)), values, lane + I(27 * LANES))
            _put_block(z1, y3, q13, values, lane + I(36 * LANES))
            _put_block(z2, y3, q23, values, lane + I(45 * LANES))
        W += w
        blocks[9 * marks[block] : 9 * marks[block + 1]] = 0
        scatter_blocks(None, edge_slots, block, values, blocks)
        if len(f) > 0:
            scatter_forces(slots, block, forces, f)
    return W, least


@inlined
def _permanent(a, b):
    """The cross product with plus in place of minus."""
    return a[1] * b[2] + a[2] * b[1], a[2] * b[0] + a[0] * b[2], a[0] * b[1] + a[1] * b[0]


@kernel
def penalty_round_off(begin: int, end: int, t: Ids, slots: Ids, D: Reals, X: Reals, u: Reals, k: int, kind: int, f: Reals) -> float:
    """Add the forces of absolute values to the slots `f`: `|V0/C0| (psi'' |e| + |psi'|) |n_i|`.

    The `U` of `|e|` have `|u_i| + |u_0|`.

    The smallest `J` as in `penalty_energy_and_force`.
    """
    P, U, B, p = (
        np.empty(9 * LANES, D.dtype),
        np.empty(9 * LANES, D.dtype),
        np.empty(9 * LANES, D.dtype),
        np.empty(9 * LANES, D.dtype),
    )
    e, J, forces = np.empty(LANES, D.dtype), np.empty(LANES, D.dtype), np.empty(9 * LANES, D.dtype)
    psi, slope, curvature = np.empty(LANES, D.dtype), np.empty(LANES, D.dtype), np.empty(LANES, D.dtype)
    more, most = D.dtype.type(k > 1), D.dtype.type(k > 2)
    least = 1.0
    for block in range(begin, end):
        gather_spokes(t, block, X, u, P, U)
        complete_spokes(k, P)
        _find_ratios(P, U, D, block, e, J)
        least = min(_find_energies(kind, D, block, e, J, psi, slope, curvature), least)
        gather_sizes(None, t, block, u, B)
        for i in range(9 * LANES):
            P[I(i)], p[I(i)] = abs(P[I(i)]), abs(P[I(i)] + U[I(i)])
        B[3 * k * LANES :] = 0
        for i in range(LANES):
            lane = I(i)
            over_C0 = abs(D[block, lane + I(LANES)])
            P1, P2 = vector(P, lane), vector(P, lane + I(3 * LANES))
            B1, B2, B3 = vectors(B, lane)
            p1, p2, p3 = vectors(p, lane)
            n1, n2, n3 = _permanent(p2, p3), times(more, _permanent(p3, p1)), times(most, _permanent(p1, p2))
            size = over_C0 * (dot(B1, n1) + dot(P1, add(_permanent(B2, p3), _permanent(P2, B3))))
            factor = D[block, lane] * over_C0 * (curvature[lane] * size + abs(slope[lane]))
            put(times(factor, n1), forces, lane)
            put(times(factor, n2), forces, lane + I(3 * LANES))
            put(times(factor, n3), forces, lane + I(6 * LANES))
        scatter_sizes(None, slots, block, forces, f)
    return least
