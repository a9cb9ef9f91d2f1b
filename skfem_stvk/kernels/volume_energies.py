"""W, F and the blocks of node pairs of K for energies of the volume ratio J, element by element.

The signed volume form of the base vectors `p_i = P_i + U_i` at a point is `C = p_1 . (p_2 x p_3)`, at rest `C0`. `V0` is the volume
at rest, `|C0|` times the weight of the point:

    e = J - 1 = (C - C0)/C0        C - C0 = U_1 . (p_2 x p_3) + P_1 . (U_2 x p_3 + P_2 x U_3)        no cancellation at small strain
    W = V0 psi(J)        f_i = V0/C0 psi' n_i        n_i = dC/dp_i: n_1 = p_2 x p_3, and so on; n_0 = -(n_1 + n_2 + n_3)
    K_ab = V0/C0^2 psi'' n_a n_b' + V0/C0 psi' [q_ab]        [q] x = q x x        q_12 = -p_3, q_13 = p_2, q_23 = -p_1

For linear simplices this is K of the nodes, which are the ends of the base vectors. For the edges of vertex 0, `q` follows from the
row sums; it is the opposite edge, as for the other edges. For other elements this is the stiffness between base vectors. Forces and
K are then spread over the nodes. Per unit of stiffness:

    quadratic      psi = e^2/2                                psi' = e                           psi'' = 1
    compression    psi = -e^3/3           for e < 0           psi' = -e^2                        psi'' = -2 e
    barrier        psi = -e^2 ln J        for 0 < J < 1       psi' = -(2 e ln J + e^2/J)         psi'' = -2 ln J - 4 e/J + e^2/J^2

No `psi''` may be negative, so that K without `psi'` is positive semi-definite. No sum has terms of both signs.

A triangle in the plane has the third base vector (0, 0, 1). A segment on the line has (0, 1, 0) and (0, 0, 1). Forces and stiffness
of these vectors are set to zero.

Elements are stored in blocks of lanes, and arrays are those of `elements`. `D` has two numbers: the stiffness times `V0` (without
the weight of a table of points) and `1/C0`. Both are zero for removed elements and unused lanes. There `e = J = 0`, and `psi`,
`psi'` and `psi''` must be finite.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy import uint64

from .compiled import Ids, Reals, inlined, kernel
from .lanes import (
    LANES,
    Points,
    absolute,
    add,
    base_vectors,
    complete_base_vectors,
    cross,
    dot,
    find_base_vectors,
    gather_both,
    gather_magnitudes,
    nodal_zeros,
    point_count,
    point_vectors,
    put,
    scatter,
    scatter_magnitudes,
    spread,
    times,
    vector,
    vectors,
    weight_of,
)
from .node_pairs import pair_buffers, put_base_vector_blocks, put_pairs
from .rows import add_blocks, close_rows, open_rows

#: Kinds of energy in the kernels.
QUADRATIC, COMPRESSION, BARRIER = 0, 1, 2


@inlined
def _minus(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@kernel
def _find_ratios(P, U, D, first, e, J):
    """Write `e` and `J` of a block at a point, `e` without cancellation at rest, and `J` without cancellation at zero volume."""
    for i in range(LANES):
        lane = uint64(i)
        P1, P2, P3 = vectors(P, lane)
        U1, U2, U3 = vectors(U, lane)
        p1, p2, p3 = add(P1, U1), add(P2, U2), add(P3, U3)
        n1, over_C0 = cross(p2, p3), D[uint64(first + i) + uint64(LANES)]
        e[lane] = over_C0 * (dot(U1, n1) + dot(P1, add(cross(U2, p3), cross(P2, U3))))
        J[lane] = over_C0 * dot(p1, n1)


@kernel
def _find_energies(kind, D, first, e, J, psi, slope, curvature):
    """Write `psi, psi', psi''` of a block at a point, and return the smallest `J <= 0` at which `psi` is infinite, or else 1."""
    zero, half, third = e.dtype.type(0), e.dtype.type(0.5), e.dtype.type(1 / 3)
    nothing, least = e.dtype.type(np.nan), e.dtype.type(1)
    if kind == QUADRATIC:
        for i in range(LANES):
            x = e[uint64(i)]
            psi[uint64(i)], slope[uint64(i)], curvature[uint64(i)] = half * x * x, x, e.dtype.type(1)
    elif kind == COMPRESSION:
        for i in range(LANES):
            x = zero if e[uint64(i)] >= 0 else e[uint64(i)]  # NaN is propagated
            psi[uint64(i)], slope[uint64(i)], curvature[uint64(i)] = -third * x * x * x, -x * x, -(x + x)
    else:
        for i in range(LANES):
            lane = uint64(i)
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
                if ratio <= 0 and D[uint64(first + i)] > 0:
                    least = min(ratio, least)
    return least


@inlined
def _find(kind, P, U, D, first, found):
    """Write `psi, psi', psi'', e, J` of a block at a point, and return the result of `_find_energies`."""
    e, J = found[3], found[4]
    _find_ratios(P, U, D, first, e, J)
    return _find_energies(kind, D, first, e, J, found[0], found[1], found[2])


@inlined
def _normals(P, U, lane, has_second, has_third):
    """Return the deformed base vectors, and `dC/dp_i`.

    For constant base vectors `has_second` or `has_third` is zero, and `dC/dp_i` is zero, too.
    """
    p1 = add(vector(P, lane), vector(U, lane))
    p2 = add(vector(P, lane + uint64(3 * LANES)), vector(U, lane + uint64(3 * LANES)))
    p3 = add(vector(P, lane + uint64(6 * LANES)), vector(U, lane + uint64(6 * LANES)))
    return p1, p2, p3, cross(p2, p3), times(has_second, cross(p3, p1)), times(has_third, cross(p1, p2))


@inlined
def _put_forces(factor, n1, n2, n3, forces, lane):
    put(times(factor, n1), forces, lane)
    put(times(factor, n2), forces, lane + uint64(3 * LANES))
    put(times(factor, n3), forces, lane + uint64(6 * LANES))


@kernel
def penalty_energy_and_force(
    begin: int, end: int, t: Ids, slots: Ids, points: Points | None, D: Reals, X: Reals, u: Reals, k: int, kind: int, f: Reals
) -> tuple[float, float]:
    """Return the energy of the blocks `begin` to `end`, and the smallest `J` at which the barrier is not defined.

    If there is no such `J`, the second number is 1. Forces are added to the slots `f`, unless `f` is empty. The barrier is not
    defined at `J <= 0`. Then energy and forces are not defined either.
    """
    x, y, total = nodal_zeros(points, D.dtype), nodal_zeros(points, D.dtype), nodal_zeros(points, D.dtype)
    P, U, forces = point_vectors(points, x), point_vectors(points, y), point_vectors(points, total)
    found = np.empty((5, LANES), D.dtype)
    psi, slope = found[0], found[1]
    has_second, has_third = D.dtype.type(k > 1), D.dtype.type(k > 2)
    W, least = 0.0, 1.0
    for block in range(begin, end):
        gather_both(points, t, block, X, u, x, y)
        w = D.dtype.type(0)
        if points is not None:
            total[:] = 0
        for point in range(point_count(points)):
            first, weight = find_base_vectors(points, block, point, 2, x, P, y, U), weight_of(points, point, D)
            complete_base_vectors(k, P)
            least = min(_find(kind, P, U, D, first, found), least)
            for i in range(LANES):
                lane, at = uint64(i), uint64(first + i)
                stiffness = weight * D[at]
                w += stiffness * psi[lane]
                _, _, _, n1, n2, n3 = _normals(P, U, lane, has_second, has_third)
                _put_forces(stiffness * D[at + uint64(LANES)] * slope[lane], n1, n2, n3, forces, lane)
            spread(points, block, point, forces, total)
        W += w
        if len(f) > 0:
            scatter(points, slots, block, total, f)
    return W, least


@inlined
def _symmetric(a, b):
    """Return `a b'` for parallel vectors, in the order 11, 22, 33, 12, 13, 23."""
    return a[0] * b[0], a[1] * b[1], a[2] * b[2], a[0] * b[1], a[0] * b[2], a[1] * b[2]


@inlined
def _block(a, b, q):
    """Return `a b' + [q]`, row by row."""
    return (
        a[0] * b[0],
        a[0] * b[1] - q[2],
        a[0] * b[2] + q[1],
        a[1] * b[0] + q[2],
        a[1] * b[1],
        a[1] * b[2] - q[0],
        a[2] * b[0] - q[1],
        a[2] * b[1] + q[0],
        a[2] * b[2],
    )


@kernel
def penalty_linearize(
    begin: int,
    end: int,
    t: Ids,
    slots: Ids,
    to: Any,
    points: Points | None,
    D: Reals,
    X: Reals,
    u: Reals,
    k: int,
    kind: int,
    slope_factor: float,
    f: Reals,
) -> tuple[float, float, float]:
    """Return the results of `penalty_energy_and_force` and the trace of the rows of K that were written (`rows`).

    Forces are added to the slots `f`, unless `f` is empty, and `K_ab` to the destination `to`. In K, `psi'` is multiplied by
    `slope_factor`.
    """
    x, y, total = nodal_zeros(points, D.dtype), nodal_zeros(points, D.dtype), nodal_zeros(points, D.dtype)
    P, U, forces = point_vectors(points, x), point_vectors(points, y), point_vectors(points, total)
    found = np.empty((5, LANES), D.dtype)
    psi, slope, curvature = found[0], found[1], found[2]
    K, T, row, values = pair_buffers(points, to.slots, D.dtype)
    nodes = (len(t) // LANES) // len(to.slots)
    buffer, buffer_state = open_rows(to)
    has_second, has_third = D.dtype.type(k > 1), D.dtype.type(k > 2)
    W, least = 0.0, 1.0
    for block in range(begin, end):
        gather_both(points, t, block, X, u, x, y)
        w = D.dtype.type(0)
        if points is not None:
            total[:] = 0
        for point in range(point_count(points)):
            first, weight = find_base_vectors(points, block, point, 2, x, P, y, U), weight_of(points, point, D)
            complete_base_vectors(k, P)
            least = min(_find(kind, P, U, D, first, found), least)
            for i in range(LANES):
                lane, at = uint64(i), uint64(first + i)
                stiffness, over_C0 = weight * D[at], D[at + uint64(LANES)]
                w += stiffness * psi[lane]
                factor, bend = stiffness * over_C0 * slope[lane], stiffness * curvature[lane]
                p1, p2, p3, n1, n2, n3 = _normals(P, U, lane, has_second, has_third)
                _put_forces(factor, n1, n2, n3, forces, lane)
                # n/C0, the gradient of J, keeps its size where C0 and n are tiny
                y1, y2, y3 = times(over_C0, n1), times(over_C0, n2), times(over_C0, n3)
                z1, z2, z3 = times(bend, y1), times(bend, y2), times(bend, y3)
                h = D.dtype.type(slope_factor) * factor
                q12, q13, q23 = times(-h * has_second, p3), times(h * has_third, p2), times(-h * has_third, p1)
                if points is None:
                    y0 = (-(y1[0] + y2[0] + y3[0]), -(y1[1] + y2[1] + y3[1]), -(y1[2] + y2[2] + y3[2]))
                    z0 = times(bend, y0)
                    put(_block(z0, y1, add(q12, q13)), values, lane)
                    put(_block(z1, y2, q12), values, lane + uint64(9 * LANES))
                    put(_block(z0, y2, _minus(q23, q12)), values, lane + uint64(18 * LANES))
                    put(_block(z0, y3, times(D.dtype.type(-1), add(q13, q23))), values, lane + uint64(27 * LANES))
                    put(_block(z1, y3, q13), values, lane + uint64(36 * LANES))
                    put(_block(z2, y3, q23), values, lane + uint64(45 * LANES))
                else:
                    symmetric = *_symmetric(z1, y1), *_symmetric(z2, y2), *_symmetric(z3, y3)
                    stiffnesses = *symmetric, *_block(z1, y2, q12), *_block(z1, y3, q13), *_block(z2, y3, q23)
                    put_base_vector_blocks(stiffnesses, K, point, lane)
            spread(points, block, point, forces, total)
        put_pairs(points, block, nodes, K, x, D.dtype.type(0), T, row, values)
        W += w
        if len(f) > 0:
            scatter(points, slots, block, total, f)
        buffer_state = add_blocks(to, points, buffer, buffer_state, block, values)
    return W, least, close_rows(to, buffer, buffer_state)


@inlined
def _permanent(a, b):
    """Return the cross product with plus in place of minus."""
    return a[1] * b[2] + a[2] * b[1], a[2] * b[0] + a[0] * b[2], a[0] * b[1] + a[1] * b[0]


@kernel
def penalty_round_off(
    begin: int, end: int, t: Ids, slots: Ids, points: Points | None, D: Reals, X: Reals, u: Reals, k: int, kind: int, f: Reals
) -> float:
    """Add forces from absolute values to the slots `f`: `|V0/C0| (psi'' |e| + |psi'|) |n_i|`.

    In `|e|`, `U` is replaced by `|u_a| + |u_0|`. Base vectors at a point are sums, and their rounding error is that of all terms.
    Therefore the resulting error of `n_i` replaces `n_i` in the product with `psi'`.

    Returns the smallest `J` as in `penalty_energy_and_force`.
    """
    x, y, z, total = (
        nodal_zeros(points, D.dtype),
        nodal_zeros(points, D.dtype),
        nodal_zeros(points, D.dtype),
        nodal_zeros(points, D.dtype),
    )
    P, U, B, forces = point_vectors(points, x), point_vectors(points, y), point_vectors(points, z), point_vectors(points, total)
    rest, now, E = np.empty(9 * LANES, D.dtype), np.empty(9 * LANES, D.dtype), np.empty(9 * LANES, D.dtype)
    table = absolute(points)
    found = np.empty((5, LANES), D.dtype)
    slope, curvature = found[1], found[2]
    has_second, has_third = D.dtype.type(k > 1), D.dtype.type(k > 2)
    least = 1.0
    for block in range(begin, end):
        gather_both(points, t, block, X, u, x, y)
        if points is not None:
            total[:] = 0
        for point in range(point_count(points)):
            first, weight = find_base_vectors(points, block, point, 2, x, P, y, U), weight_of(points, point, D)
            complete_base_vectors(k, P)
            least = min(_find(kind, P, U, D, first, found), least)
            gather_magnitudes(points, t, block, u, z)
            rest[:], now[:] = np.abs(P), np.abs(P + U)
            if points is None:
                B[3 * k * LANES :] = 0
            else:
                base_vectors(table, block, point, z, B)
                base_vectors(table, block, point, np.abs(x), E)
                E += B
            for i in range(LANES):
                lane, at = uint64(i), uint64(first + i)
                over_C0 = abs(D[at + uint64(LANES)])
                P1, P2 = vector(rest, lane), vector(rest, lane + uint64(3 * LANES))
                B1, B2, B3 = vectors(B, lane)
                p1, p2, p3 = vectors(now, lane)
                n1, n2, n3 = _permanent(p2, p3), times(has_second, _permanent(p3, p1)), times(has_third, _permanent(p1, p2))
                size = over_C0 * (dot(B1, n1) + dot(P1, add(_permanent(B2, p3), _permanent(P2, B3))))
                factor = weight * D[at] * over_C0
                bent, straight = factor * (curvature[lane] * size), factor * abs(slope[lane])
                if points is None:
                    _put_forces(bent + straight, n1, n2, n3, forces, lane)
                else:
                    E1, E2, E3 = vectors(E, lane)
                    m1 = add(_permanent(E2, p3), _permanent(p2, E3))
                    m2 = times(has_second, add(_permanent(E3, p1), _permanent(p3, E1)))
                    m3 = times(has_third, add(_permanent(E1, p2), _permanent(p1, E2)))
                    put(add(times(bent, n1), times(straight, m1)), forces, lane)
                    put(add(times(bent, n2), times(straight, m2)), forces, lane + uint64(3 * LANES))
                    put(add(times(bent, n3), times(straight, m3)), forces, lane + uint64(6 * LANES))
            spread(table, block, point, forces, total)
        scatter_magnitudes(points, slots, block, total, f)
    return least
