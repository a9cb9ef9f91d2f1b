"""W, F and the edge blocks of K, simplex by simplex: what all assembly is made of.

A simplex has its vertex 0 and `k` spokes from there to the others: at rest `P_i = X_i - X_0`, of displacements `U_i = u_i - u_0`,
now `p_i = P_i + U_i`. The squared elongations of all of its edges, in the basis of its spokes, and the tensions that answer them:

    M_ij = p_i . p_j - P_i . P_j = p_i . U_j + U_i . P_j         zeta_0i = M_ii        zeta_ij = M_ii + M_jj - 2 M_ij
    S_ij = sum_kl D_ijkl M_kl                                    t_ij = -S_ij         t_0i = sum_j S_ij
    W    = 1/4 sum_ij S_ij M_ij        f_i = sum_j S_ij p_j    f_0 = -sum_i f_i
    K_ij = 2 sum_kl D_ikjl p_k p_l' + S_ij I                     K_0j = -sum_i K_ij

    zeta(u + s v) is quadratic in s, so W is a quartic: with M' = dM/ds and M'' = d2M/ds2, both at s = 0, S' and S'' likewise,
    M'_ij = p_i . V_j + V_i . p_j        M''_ij = 2 V_i . V_j
    W(s)  = S:M/4 + S:M'/2 s + (S:M'' + S':M')/4 s^2 + S':M''/4 s^3 + S'':M''/16 s^4

    From u to u + v M changes by dM_ij = (p_i + V_i) . V_j + V_i . p_j. The tensions w0 S + w1 (S + dS) pull along p_i + theta V_i;
    their work over v is W(u + v) - W(u) + (w1 - w0)/4 dS:dM for theta = 1/2, w0 + w1 = 1. At velocities v the S' pull along p_i:
    they are the derivative of R = 1/4 S':M' by V_i, and take the power 2 R.

    isotropic, 7 numbers    S = r (g : M) g + g M g        g_ij = sqrt(V mu) G_ij,  r = lam / (2 mu),  G_ij = g_i . g_j (Gram)
                            K_ij = 2 r y_i y_j' + y_j y_i' + g_ij B + S_ij I        y_i = sum_j g_ij p_j,  B = sum_i p_i y_i'
    general, 21 numbers     D in the order 11, 22, 33, 12, 13, 23

`M` has no cancellation at small strain. All simplices are tetrahedra in space here: what a triangle or a segment lacks of spokes
and components is zero. That makes one specialisation for each precision and law instead of six.

Blocks of lanes and the arrays that all kernels share: `lanes`. W and F take 15 ns per tetrahedron, one at a time 20 to 28
(`python -m validation kernels`). `D` is one-dimensional (blocks 7 LANES) if isotropic, two-dimensional (blocks, 21 LANES) if
general. Threads take runs of blocks, and no two of them share a slot.
"""

from __future__ import annotations

import numpy as np

from .compiled import Ids, Reals, inlined, kernel
from .lanes import (
    LANES,
    I,
    add,
    dot,
    gather_differences,
    gather_sizes,
    gather_spokes,
    put,
    scatter_blocks,
    scatter_forces,
    scatter_sizes,
    vectors,
)


@inlined
def _combination(x, a, y, b, z, c):
    return x * a[0] + y * b[0] + z * c[0], x * a[1] + y * b[1] + z * c[1], x * a[2] + y * b[2] + z * c[2]


@inlined
def _scaled(s, S):
    return s * S[0], s * S[1], s * S[2], s * S[3], s * S[4], s * S[5]


@inlined
def _strain(P1, P2, P3, U1, U2, U3, p1, p2, p3):
    """`M` in the order 11, 22, 33, 12, 13, 23."""
    return (
        dot(add(P1, p1), U1),
        dot(add(P2, p2), U2),
        dot(add(P3, p3), U3),
        dot(p1, U2) + dot(U1, P2),
        dot(p1, U3) + dot(U1, P3),
        dot(p2, U3) + dot(U2, P3),
    )


@inlined
def _gram(D, block, lane):
    at = I(block * 7 * LANES + lane)
    return (
        D[at],
        D[at + I(LANES)],
        D[at + I(2 * LANES)],
        D[at + I(3 * LANES)],
        D[at + I(4 * LANES)],
        D[at + I(5 * LANES)],
        D[at + I(6 * LANES)],
    )


@inlined
def _isotropic_stress(g, M):
    g11, g22, g33, g12, g13, g23, r = g
    M11, M22, M33, M12, M13, M23 = M
    a11, a12, a13 = g11 * M11 + g12 * M12 + g13 * M13, g11 * M12 + g12 * M22 + g13 * M23, g11 * M13 + g12 * M23 + g13 * M33
    a21, a22, a23 = g12 * M11 + g22 * M12 + g23 * M13, g12 * M12 + g22 * M22 + g23 * M23, g12 * M13 + g22 * M23 + g23 * M33
    a31, a32, a33 = g13 * M11 + g23 * M12 + g33 * M13, g13 * M12 + g23 * M22 + g33 * M23, g13 * M13 + g23 * M23 + g33 * M33
    trace = r * (a11 + a22 + a33)
    return (
        trace * g11 + a11 * g11 + a12 * g12 + a13 * g13,
        trace * g22 + a21 * g12 + a22 * g22 + a23 * g23,
        trace * g33 + a31 * g13 + a32 * g23 + a33 * g33,
        trace * g12 + a11 * g12 + a12 * g22 + a13 * g23,
        trace * g13 + a11 * g13 + a12 * g23 + a13 * g33,
        trace * g23 + a21 * g13 + a22 * g23 + a23 * g33,
    )


@inlined
def _general_row(D, block, lane, x, a, b, c, d, e, f):
    at = I(lane)
    return (
        D[block, at + I(a * LANES)] * x[0]
        + D[block, at + I(b * LANES)] * x[1]
        + D[block, at + I(c * LANES)] * x[2]
        + D[block, at + I(d * LANES)] * x[3]
        + D[block, at + I(e * LANES)] * x[4]
        + D[block, at + I(f * LANES)] * x[5]
    )


@inlined
def _general_stress(D, block, lane, M):
    """The upper half of D, row by row: 0 ... 5, 6 ... 10, 11 ... 14, 15 ... 17, 18 ... 19, 20."""
    x = (M[0], M[1], M[2], M[3] + M[3], M[4] + M[4], M[5] + M[5])
    return (
        _general_row(D, block, lane, x, 0, 1, 2, 3, 4, 5),
        _general_row(D, block, lane, x, 1, 6, 7, 8, 9, 10),
        _general_row(D, block, lane, x, 2, 7, 11, 12, 13, 14),
        _general_row(D, block, lane, x, 3, 8, 12, 15, 16, 17),
        _general_row(D, block, lane, x, 4, 9, 13, 16, 18, 19),
        _general_row(D, block, lane, x, 5, 10, 14, 17, 19, 20),
    )


@inlined
def _stress(D, block, lane, M):
    if D.ndim == 1:
        return _isotropic_stress(_gram(D, block, lane), M)
    else:
        return _general_stress(D, block, lane, M)


@inlined
def _four_energies(S, M):
    shear = S[3] * M[3] + S[4] * M[4] + S[5] * M[5]
    return S[0] * M[0] + S[1] * M[1] + S[2] * M[2] + shear + shear


@inlined
def _state(P, U, D, block, i):
    """Of simplex `i` of a block: the spokes now, the tensions `S`, and four times the energy."""
    lane = I(i)
    P1, P2, P3 = vectors(P, lane)
    U1, U2, U3 = vectors(U, lane)
    p1, p2, p3 = add(P1, U1), add(P2, U2), add(P3, U3)
    M = _strain(P1, P2, P3, U1, U2, U3, p1, p2, p3)
    S = _stress(D, block, i, M)
    return p1, p2, p3, S, _four_energies(S, M)


@inlined
def _put_forces(S, p1, p2, p3, forces, lane):
    put(_combination(S[0], p1, S[3], p2, S[4], p3), forces, lane)
    put(_combination(S[3], p1, S[1], p2, S[5], p3), forces, lane + I(3 * LANES))
    put(_combination(S[4], p1, S[5], p2, S[2], p3), forces, lane + I(6 * LANES))


@kernel
def energy_and_force(begin: int, end: int, t: Ids, slots: Ids, D: Reals, X: Reals, u: Reals, f: Reals) -> float:
    """The energy of the blocks `begin` to `end`; adds their forces to the slots `f`, unless that is empty."""
    P, U, forces = np.empty(9 * LANES, D.dtype), np.empty(9 * LANES, D.dtype), np.empty(9 * LANES, D.dtype)
    W = 0.0
    for block in range(begin, end):
        gather_spokes(t, block, X, u, P, U)
        w = D.dtype.type(0)
        for i in range(LANES):
            lane = I(i)
            p1, p2, p3, S, four_energies = _state(P, U, D, block, i)
            w += four_energies
            _put_forces(S, p1, p2, p3, forces, lane)
        W += w
        if len(f) > 0:
            scatter_forces(slots, block, forces, f)
    return W / 4


@inlined
def _put_block(a, x, b, y, g, B, S, out, at):
    """`a x' + b y' + g B + S I`, row by row; `B` symmetric in the order 11, 22, 33, 12, 13, 23."""
    out[at] = a[0] * x[0] + b[0] * y[0] + g * B[0] + S
    out[at + I(LANES)] = a[0] * x[1] + b[0] * y[1] + g * B[3]
    out[at + I(2 * LANES)] = a[0] * x[2] + b[0] * y[2] + g * B[4]
    out[at + I(3 * LANES)] = a[1] * x[0] + b[1] * y[0] + g * B[3]
    out[at + I(4 * LANES)] = a[1] * x[1] + b[1] * y[1] + g * B[1] + S
    out[at + I(5 * LANES)] = a[1] * x[2] + b[1] * y[2] + g * B[5]
    out[at + I(6 * LANES)] = a[2] * x[0] + b[2] * y[0] + g * B[4]
    out[at + I(7 * LANES)] = a[2] * x[1] + b[2] * y[1] + g * B[5]
    out[at + I(8 * LANES)] = a[2] * x[2] + b[2] * y[2] + g * B[2] + S


@inlined
def _put_isotropic_blocks(g, S, p1, p2, p3, out, lane):
    """Write the blocks of the edges 01, 12, 02, 03, 13, 23."""
    g11, g22, g33, g12, g13, g23, r = g
    y1, y2, y3 = (
        _combination(g11, p1, g12, p2, g13, p3),
        _combination(g12, p1, g22, p2, g23, p3),
        _combination(g13, p1, g23, p2, g33, p3),
    )
    B = (
        p1[0] * y1[0] + p2[0] * y2[0] + p3[0] * y3[0],
        p1[1] * y1[1] + p2[1] * y2[1] + p3[1] * y3[1],
        p1[2] * y1[2] + p2[2] * y2[2] + p3[2] * y3[2],
        p1[0] * y1[1] + p2[0] * y2[1] + p3[0] * y3[1],
        p1[0] * y1[2] + p2[0] * y2[2] + p3[0] * y3[2],
        p1[1] * y1[2] + p2[1] * y2[2] + p3[1] * y3[2],
    )
    y0 = (-(y1[0] + y2[0] + y3[0]), -(y1[1] + y2[1] + y3[1]), -(y1[2] + y2[2] + y3[2]))
    s = r + r
    z0, z1, z2 = (s * y0[0], s * y0[1], s * y0[2]), (s * y1[0], s * y1[1], s * y1[2]), (s * y2[0], s * y2[1], s * y2[2])
    _put_block(z0, y1, y1, y0, -(g11 + g12 + g13), B, -(S[0] + S[3] + S[4]), out, lane)
    _put_block(z1, y2, y2, y1, g12, B, S[3], out, lane + I(9 * LANES))
    _put_block(z0, y2, y2, y0, -(g12 + g22 + g23), B, -(S[3] + S[1] + S[5]), out, lane + I(18 * LANES))
    _put_block(z0, y3, y3, y0, -(g13 + g23 + g33), B, -(S[4] + S[5] + S[2]), out, lane + I(27 * LANES))
    _put_block(z1, y3, y3, y1, g13, B, S[4], out, lane + I(36 * LANES))
    _put_block(z2, y3, y3, y2, g23, B, S[5], out, lane + I(45 * LANES))


@inlined
def _answer(D, block, lane, a, b, c, p1, p2, p3):
    """`2 sum_k D_ikq p_k`, with the places a, b, c of `D_i1q, D_i2q, D_i3q`."""
    at = I(lane)
    x, y, z = D[block, at + I(a * LANES)], D[block, at + I(b * LANES)], D[block, at + I(c * LANES)]
    return _combination(x + x, p1, y + y, p2, z + z, p3)


@inlined
def _general_block(a, b, c, p1, p2, p3, S):
    """`a p_1' + b p_2' + c p_3' + S I`, row by row."""
    return (
        a[0] * p1[0] + b[0] * p2[0] + c[0] * p3[0] + S,
        a[0] * p1[1] + b[0] * p2[1] + c[0] * p3[1],
        a[0] * p1[2] + b[0] * p2[2] + c[0] * p3[2],
        a[1] * p1[0] + b[1] * p2[0] + c[1] * p3[0],
        a[1] * p1[1] + b[1] * p2[1] + c[1] * p3[1] + S,
        a[1] * p1[2] + b[1] * p2[2] + c[1] * p3[2],
        a[2] * p1[0] + b[2] * p2[0] + c[2] * p3[0],
        a[2] * p1[1] + b[2] * p2[1] + c[2] * p3[1],
        a[2] * p1[2] + b[2] * p2[2] + c[2] * p3[2] + S,
    )


@inlined
def _put_minus_sum(a, b, c, out, at):
    for i in range(9):
        out[at + I(i * LANES)] = -(a[i] + b[i] + c[i])


@inlined
def _transposed(K):
    return K[0], K[3], K[6], K[1], K[4], K[7], K[2], K[5], K[8]


@inlined
def _put_general_blocks(D, block, lane, S, p1, p2, p3, out):
    """`K_ij = sum_l A_i,jl p_l' + S_ij I` of the spokes, `A_i,jl = 2 sum_k D_ikjl p_k`; those of vertex 0 from the row sums."""
    a11 = _answer(D, block, lane, 0, 3, 4, p1, p2, p3)
    a12 = _answer(D, block, lane, 3, 15, 16, p1, p2, p3)
    a13 = _answer(D, block, lane, 4, 16, 18, p1, p2, p3)
    a22 = _answer(D, block, lane, 1, 8, 9, p1, p2, p3)
    a23 = _answer(D, block, lane, 5, 17, 19, p1, p2, p3)
    a33 = _answer(D, block, lane, 2, 12, 13, p1, p2, p3)
    K11 = _general_block(a11, a12, a13, p1, p2, p3, S[0])
    K12 = _general_block(a12, a22, a23, p1, p2, p3, S[3])
    K13 = _general_block(a13, a23, a33, p1, p2, p3, S[4])
    b12 = _answer(D, block, lane, 15, 8, 17, p1, p2, p3)
    b22 = _answer(D, block, lane, 8, 6, 10, p1, p2, p3)
    b23 = _answer(D, block, lane, 17, 10, 20, p1, p2, p3)
    b13 = _answer(D, block, lane, 16, 9, 19, p1, p2, p3)
    b33 = _answer(D, block, lane, 12, 7, 14, p1, p2, p3)
    K22 = _general_block(b12, b22, b23, p1, p2, p3, S[1])
    K23 = _general_block(b13, b23, b33, p1, p2, p3, S[5])
    c13 = _answer(D, block, lane, 18, 19, 13, p1, p2, p3)
    c23 = _answer(D, block, lane, 19, 20, 14, p1, p2, p3)
    c33 = _answer(D, block, lane, 13, 14, 11, p1, p2, p3)
    K33 = _general_block(c13, c23, c33, p1, p2, p3, S[2])
    at = I(lane)
    _put_minus_sum(K11, _transposed(K12), _transposed(K13), out, at)
    put(K12, out, at + I(9 * LANES))
    _put_minus_sum(K12, K22, _transposed(K23), out, at + I(18 * LANES))
    _put_minus_sum(K13, K23, K33, out, at + I(27 * LANES))
    put(K13, out, at + I(36 * LANES))
    put(K23, out, at + I(45 * LANES))


@kernel
def linearize(
    begin: int,
    end: int,
    t: Ids,
    slots: Ids,
    edge_slots: Ids,
    marks: Ids,
    D: Reals,
    X: Reals,
    u: Reals,
    kept: float,
    f: Reals,
    blocks: Reals,
) -> float:
    """The energy; adds forces to the slots `f`, unless that is empty, and `K_ab`, `S` times `kept` in it, to slots in `blocks`.

    `marks[i]` to `marks[i + 1]` are the edges that block `i` is the first to have: they are set to zero just before. To do so for
    all edges beforehand takes 1.5 x the time on 250 000 tetrahedra.
    """
    P, U, values = np.empty(9 * LANES, D.dtype), np.empty(9 * LANES, D.dtype), np.empty(63 * LANES, D.dtype)
    forces, g = values[54 * LANES :], D.dtype.type(kept)
    W = 0.0
    for block in range(begin, end):
        gather_spokes(t, block, X, u, P, U)
        w = D.dtype.type(0)
        for i in range(LANES):
            lane = I(i)
            p1, p2, p3, S, four_energies = _state(P, U, D, block, i)
            w += four_energies
            _put_forces(S, p1, p2, p3, values, lane + I(54 * LANES))
            S = _scaled(g, S)
            if D.ndim == 1:
                _put_isotropic_blocks(_gram(D, block, i), S, p1, p2, p3, values, lane)
            else:
                _put_general_blocks(D, block, i, S, p1, p2, p3, values)
        W += w
        if len(f) > 0:
            scatter_forces(slots, block, forces, f)
        blocks[9 * marks[block] : 9 * marks[block + 1]] = 0  # while it is in the cache
        scatter_blocks(edge_slots, block, values, blocks)
    return W / 4


@kernel
def _scatter_tensions(edge_slots, block, values, out):
    edges = edge_slots.shape[1] // LANES
    for lane in range(LANES):
        for edge in range(edges):
            at = I(edge * LANES + lane)
            out[I(edge_slots[block, at])] += values[at]


@kernel
def tensions(begin: int, end: int, t: Ids, edge_slots: Ids, marks: Ids, D: Reals, X: Reals, u: Reals, out: Reals) -> None:
    """Add the tensions of the edges to their slots in `out`, which are set to zero as those of `linearize` are."""
    P, U, values = np.empty(9 * LANES, D.dtype), np.empty(9 * LANES, D.dtype), np.empty(6 * LANES, D.dtype)
    for block in range(begin, end):
        gather_spokes(t, block, X, u, P, U)
        for i in range(LANES):
            _, _, _, S, _ = _state(P, U, D, block, i)
            put((S[0] + S[3] + S[4], -S[3], S[3] + S[1] + S[5], S[4] + S[5] + S[2], -S[4], -S[5]), values, I(i))
        out[marks[block] : marks[block + 1]] = 0
        _scatter_tensions(edge_slots, block, values, out)


@kernel
def along(begin: int, end: int, t: Ids, D: Reals, X: Reals, u: Reals, v: Reals) -> tuple[float, float, float, float, float]:
    """Coefficients of the energy of the blocks `begin` to `end` along `u + s v`, a quartic in `s`."""
    P, U, V = np.empty(9 * LANES, D.dtype), np.empty(9 * LANES, D.dtype), np.empty(9 * LANES, D.dtype)
    c0, c1, c2, c3, c4 = 0.0, 0.0, 0.0, 0.0, 0.0
    zero = D.dtype.type(0)
    for block in range(begin, end):
        gather_spokes(t, block, X, u, P, U)
        gather_differences(t, block, v, V)
        w0, w1, w2, w3, w4 = zero, zero, zero, zero, zero
        for i in range(LANES):
            lane = I(i)
            P1, P2, P3 = vectors(P, lane)
            U1, U2, U3 = vectors(U, lane)
            V1, V2, V3 = vectors(V, lane)
            p1, p2, p3 = add(P1, U1), add(P2, U2), add(P3, U3)
            M = _strain(P1, P2, P3, U1, U2, U3, p1, p2, p3)
            N = _strain(p1, p2, p3, V1, V2, V3, p1, p2, p3)  # M', and with V in the place of p twice V_i . V_j: M''
            O = _strain(V1, V2, V3, V1, V2, V3, V1, V2, V3)
            S, T = _stress(D, block, i, M), _stress(D, block, i, N)
            w0 += _four_energies(S, M)
            w1 += _four_energies(S, N)
            w2 += _four_energies(S, O) + _four_energies(T, N)
            w3 += _four_energies(T, O)
            w4 += _four_energies(_stress(D, block, i, O), O)
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


@inlined
def _moved(p, s, V):
    return p[0] + s * V[0], p[1] + s * V[1], p[2] + s * V[2]


@kernel
def mean_force(
    begin: int, end: int, t: Ids, slots: Ids, D: Reals, X: Reals, u: Reals, v: Reals, w0: float, w1: float, theta: float, f: Reals
) -> float:
    """Add to the slots `f` what the tensions `w0` at `u` and `w1` at `u + v` pull along the edges at `u + theta v`.

    Returns `1/4 dS:dM` of the blocks `begin` to `end`, the energy of the change of all squared elongations.
    """
    P, U, V, forces = (
        np.empty(9 * LANES, D.dtype),
        np.empty(9 * LANES, D.dtype),
        np.empty(9 * LANES, D.dtype),
        np.empty(9 * LANES, D.dtype),
    )
    both, later, part = D.dtype.type(w0 + w1), D.dtype.type(w1), D.dtype.type(theta)
    R = 0.0
    for block in range(begin, end):
        gather_spokes(t, block, X, u, P, U)
        gather_differences(t, block, v, V)
        r = D.dtype.type(0)
        for i in range(LANES):
            lane = I(i)
            V1, V2, V3 = vectors(V, lane)
            p1, p2, p3, S, _ = _state(P, U, D, block, i)
            N = _strain(p1, p2, p3, V1, V2, V3, add(p1, V1), add(p2, V2), add(p3, V3))
            T = _stress(D, block, i, N)
            r += _four_energies(T, N)
            q1, q2, q3 = _moved(p1, part, V1), _moved(p2, part, V2), _moved(p3, part, V3)
            _put_forces(_between(both, S, later, T), q1, q2, q3, forces, lane)
        R += r
        scatter_forces(slots, block, forces, f)
    return R / 4


@kernel
def damping_force(begin: int, end: int, t: Ids, slots: Ids, D: Reals, X: Reals, u: Reals, v: Reals, f: Reals) -> float:
    """Add the pull of the tensions' rates at velocities `v` along the edges at `u` to the slots `f`; `R` of the blocks."""
    P, U, V, forces = (
        np.empty(9 * LANES, D.dtype),
        np.empty(9 * LANES, D.dtype),
        np.empty(9 * LANES, D.dtype),
        np.empty(9 * LANES, D.dtype),
    )
    R = 0.0
    for block in range(begin, end):
        gather_spokes(t, block, X, u, P, U)
        gather_differences(t, block, v, V)
        r = D.dtype.type(0)
        for i in range(LANES):
            lane = I(i)
            P1, P2, P3 = vectors(P, lane)
            U1, U2, U3 = vectors(U, lane)
            V1, V2, V3 = vectors(V, lane)
            p1, p2, p3 = add(P1, U1), add(P2, U2), add(P3, U3)
            N = _strain(p1, p2, p3, V1, V2, V3, p1, p2, p3)
            T = _stress(D, block, i, N)
            r += _four_energies(T, N)
            _put_forces(T, p1, p2, p3, forces, lane)
        R += r
        scatter_forces(slots, block, forces, f)
    return R / 4


@kernel
def _absolute(D, block):
    """Absolute values of the stiffness of a block."""
    if D.ndim == 1:
        return np.abs(D[block * 7 * LANES : (block + 1) * 7 * LANES])
    else:
        return np.abs(D[block : block + 1])


@kernel
def round_off(begin: int, end: int, t: Ids, slots: Ids, D: Reals, X: Reals, u: Reals, f: Reals) -> None:
    """Add to the slots `f` the forces of absolute values: of D, P and p, and `|u_i| + |u_0|` for U, for `u` is rounded itself."""
    P, B, p, forces = (
        np.empty(9 * LANES, D.dtype),
        np.empty(9 * LANES, D.dtype),
        np.empty(9 * LANES, D.dtype),
        np.empty(9 * LANES, D.dtype),
    )
    for block in range(begin, end):
        gather_sizes(t, block, X, u, P, B, p)
        A = _absolute(D, block)
        for i in range(LANES):
            lane = I(i)
            P1, P2, P3 = vectors(P, lane)
            B1, B2, B3 = vectors(B, lane)
            p1, p2, p3 = vectors(p, lane)
            S = _stress(A, 0, i, _strain(P1, P2, P3, B1, B2, B3, p1, p2, p3))
            _put_forces(S, p1, p2, p3, forces, lane)
        scatter_sizes(slots, block, forces, f)
