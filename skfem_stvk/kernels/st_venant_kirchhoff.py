"""St. Venant-Kirchhoff law at a point: stress, response and stiffness of isotropic and of general materials.

The symbols are those of `laws`. `C` is the constant elasticity tensor, `E` the Green-Lagrange strain, `lam` and `mu` are Lame's
parameters:

    M_ij = q_i . h_j + h_i . Q_j = 2 E_ij        without cancellation at small strain
    S_ij = w C_ijkl M_kl / 2                     w W = 1/4 S : M        s_j = sum_k S_jk q_k
    A_mn = w sum_kl C_mknl q_k q_l' + S_mn I

    isotropic, 2 numbers    S = w (lam/2 tr M I + mu M)        y_i = sum_j Ri_ij q_j = F g_i,  G = Ri Ri',  B = sum_i q_i q_i'
                            K_ij = w (lam y_i y_j' + mu y_j y_i' + mu G_ij B) + (Ri S Ri')_ij I
    general, 21 numbers     w C/2 in the order 11, 22, 33, 12, 13, 23, the upper half row by row
"""

from __future__ import annotations

from typing import NamedTuple

from numpy import uint64

from .compiled import Reals, by_type, inlined
from .lanes import LANES, six, vectors
from .laws import (
    FORMULAS,
    axis_forces,
    base_vector_stiffness,
    combination,
    conjugated,
    contracted,
    law_size,
    on_base_vectors,
    respond,
    scale_eigenvalues,
    scale_tensions,
    state_size,
    strain,
    stress,
    stress_magnitudes,
    to_base_vectors,
)


class IsotropicLaw(NamedTuple):
    """Isotropic StVK law: `Ri`, then `w lam/2` and `w mu`."""

    D: Reals


class GeneralLaw(NamedTuple):
    """General StVK law: `Ri`, then 21 numbers `w C/2`."""

    D: Reals


@by_type(law_size, IsotropicLaw, FORMULAS)
def _isotropic_numbers(law):
    return 8


@by_type(law_size, GeneralLaw, FORMULAS)
def _general_numbers(law):
    return 27


@by_type(state_size, IsotropicLaw, FORMULAS)
@by_type(state_size, GeneralLaw, FORMULAS)
def _numbers_of_a_frame_and_its_stress(law):
    return 15


@by_type(respond, IsotropicLaw, FORMULAS)
@by_type(respond, GeneralLaw, FORMULAS)
def _response_of_stress(law, at, weight, Q, h, q):
    (q1, q2, q3), M = q, strain(h[0], h[1], h[2], Q[0], Q[1], Q[2], q[0], q[1], q[2])
    S = stress(law, at, weight, M)
    s1, s2, s3 = axis_forces(S, q1, q2, q3)
    return contracted(S, M), (*q1, *q2, *q3, *S), s1, s2, s3


@inlined
def _isotropic(lam, mu, M):
    """Return `lam/2 tr M I + mu M` for `lam/2` and `mu`."""
    trace = lam * (M[0] + M[1] + M[2])
    return trace + mu * M[0], trace + mu * M[1], trace + mu * M[2], mu * M[3], mu * M[4], mu * M[5]


@by_type(stress, IsotropicLaw, FORMULAS)
def _isotropic_stress(law, at, weight, M):
    return _isotropic(weight * law.D[at + uint64(6 * LANES)], weight * law.D[at + uint64(7 * LANES)], M)


@by_type(stress_magnitudes, IsotropicLaw, FORMULAS)
def _isotropic_magnitudes(law, at, weight, M):
    return _isotropic(weight * abs(law.D[at + uint64(6 * LANES)]), weight * abs(law.D[at + uint64(7 * LANES)]), M)


@inlined
def _number(D, at, size):
    """Return a stored number, or its absolute value if `size` is not None."""
    if size is None:
        return D[at]
    else:
        return abs(D[at])


@inlined
def _general_row(D, at, size, x, a, b, c, d, e, f):
    return (
        _number(D, at + uint64((6 + a) * LANES), size) * x[0]
        + _number(D, at + uint64((6 + b) * LANES), size) * x[1]
        + _number(D, at + uint64((6 + c) * LANES), size) * x[2]
        + _number(D, at + uint64((6 + d) * LANES), size) * x[3]
        + _number(D, at + uint64((6 + e) * LANES), size) * x[4]
        + _number(D, at + uint64((6 + f) * LANES), size) * x[5]
    )


@inlined
def _general(D, at, size, weight, M):
    """Return `w C M / 2` from the upper half of `w C/2`, row by row: 0 ... 5, 6 ... 10, 11 ... 14, 15 ... 17, 18 ... 19, 20."""
    twice = weight + weight
    x = (weight * M[0], weight * M[1], weight * M[2], twice * M[3], twice * M[4], twice * M[5])
    return (
        _general_row(D, at, size, x, 0, 1, 2, 3, 4, 5),
        _general_row(D, at, size, x, 1, 6, 7, 8, 9, 10),
        _general_row(D, at, size, x, 2, 7, 11, 12, 13, 14),
        _general_row(D, at, size, x, 3, 8, 12, 15, 16, 17),
        _general_row(D, at, size, x, 4, 9, 13, 16, 18, 19),
        _general_row(D, at, size, x, 5, 10, 14, 17, 19, 20),
    )


@by_type(stress, GeneralLaw, FORMULAS)
def _general_stress(law, at, weight, M):
    return _general(law.D, at, None, weight, M)


@by_type(stress_magnitudes, GeneralLaw, FORMULAS)
def _general_magnitudes(law, at, weight, M):
    return _general(law.D, at, True, weight, M)


@by_type(scale_tensions, IsotropicLaw, FORMULAS)
@by_type(scale_tensions, GeneralLaw, FORMULAS)
def _scale_stress(law, points, states, positive, negative):
    """Multiply the eigenvalues of `S` by the factors for their signs; for linear simplices, multiply `S` by the first factor."""
    S = states[9 * LANES :]
    if points is None or positive == negative:
        S *= states.dtype.type(positive)
    else:
        for i in range(LANES):
            scale_eigenvalues(S, uint64(i), positive, negative)


@inlined
def _symmetric(s, y, g, B, T):
    """Return `s y y' + g B + T I`, in the order 11, 22, 33, 12, 13, 23."""
    z = (s * y[0], s * y[1], s * y[2])
    return (
        z[0] * y[0] + g * B[0] + T,
        z[1] * y[1] + g * B[1] + T,
        z[2] * y[2] + g * B[2] + T,
        z[0] * y[1] + g * B[3],
        z[0] * y[2] + g * B[4],
        z[1] * y[2] + g * B[5],
    )


@inlined
def _mixed(a, x, b, y, g, B, T):
    """Return `a x' + b y' + g B + T I`, row by row."""
    return (
        a[0] * x[0] + b[0] * y[0] + g * B[0] + T,
        a[0] * x[1] + b[0] * y[1] + g * B[3],
        a[0] * x[2] + b[0] * y[2] + g * B[4],
        a[1] * x[0] + b[1] * y[0] + g * B[3],
        a[1] * x[1] + b[1] * y[1] + g * B[1] + T,
        a[1] * x[2] + b[1] * y[2] + g * B[5],
        a[2] * x[0] + b[2] * y[0] + g * B[4],
        a[2] * x[1] + b[2] * y[1] + g * B[5],
        a[2] * x[2] + b[2] * y[2] + g * B[2] + T,
    )


@by_type(base_vector_stiffness, IsotropicLaw, FORMULAS)
def _isotropic_stiffness(law, at, weight, R, states, lane):
    (q1, q2, q3), S = vectors(states, lane), six(states, lane + uint64(9 * LANES))
    lam, mu = weight * law.D[at + uint64(6 * LANES)], weight * law.D[at + uint64(7 * LANES)]
    lam, both = lam + lam, lam + lam + mu
    y1, y2, y3 = on_base_vectors(R, q1, q2, q3)
    B = (
        mu * (q1[0] * q1[0] + q2[0] * q2[0] + q3[0] * q3[0]),
        mu * (q1[1] * q1[1] + q2[1] * q2[1] + q3[1] * q3[1]),
        mu * (q1[2] * q1[2] + q2[2] * q2[2] + q3[2] * q3[2]),
        mu * (q1[0] * q1[1] + q2[0] * q2[1] + q3[0] * q3[1]),
        mu * (q1[0] * q1[2] + q2[0] * q2[2] + q3[0] * q3[2]),
        mu * (q1[1] * q1[2] + q2[1] * q2[2] + q3[1] * q3[2]),
    )
    G11, G22, G33 = R[0] * R[0] + R[1] * R[1] + R[2] * R[2], R[3] * R[3] + R[4] * R[4], R[5] * R[5]
    G12, G13, G23 = R[1] * R[3] + R[2] * R[4], R[2] * R[5], R[4] * R[5]
    T = conjugated(R, S)
    z1, z2 = (lam * y1[0], lam * y1[1], lam * y1[2]), (lam * y2[0], lam * y2[1], lam * y2[2])
    x1, x2 = (mu * y1[0], mu * y1[1], mu * y1[2]), (mu * y2[0], mu * y2[1], mu * y2[2])
    return (
        *_symmetric(both, y1, G11, B, T[0]),
        *_symmetric(both, y2, G22, B, T[1]),
        *_symmetric(both, y3, G33, B, T[2]),
        *_mixed(z1, y2, y2, x1, G12, B, T[3]),
        *_mixed(z1, y3, y3, x1, G13, B, T[4]),
        *_mixed(z2, y3, y3, x2, G23, B, T[5]),
    )


@inlined
def _elasticity_times_frame(D, at, twice, a, b, c, q1, q2, q3):
    """Return `w sum_k C_mknl q_k` for one pair `m, l`; a, b, c are the indices of `C_m1nl, C_m2nl, C_m3nl` in the law."""
    x, y, z = D[at + uint64((6 + a) * LANES)], D[at + uint64((6 + b) * LANES)], D[at + uint64((6 + c) * LANES)]
    return combination(twice * x, q1, twice * y, q2, twice * z, q3)


@inlined
def _block(a, b, c, q1, q2, q3, S):
    """Return `a q_1' + b q_2' + c q_3' + S I`, row by row."""
    return (
        a[0] * q1[0] + b[0] * q2[0] + c[0] * q3[0] + S,
        a[0] * q1[1] + b[0] * q2[1] + c[0] * q3[1],
        a[0] * q1[2] + b[0] * q2[2] + c[0] * q3[2],
        a[1] * q1[0] + b[1] * q2[0] + c[1] * q3[0],
        a[1] * q1[1] + b[1] * q2[1] + c[1] * q3[1] + S,
        a[1] * q1[2] + b[1] * q2[2] + c[1] * q3[2],
        a[2] * q1[0] + b[2] * q2[0] + c[2] * q3[0],
        a[2] * q1[1] + b[2] * q2[1] + c[2] * q3[1],
        a[2] * q1[2] + b[2] * q2[2] + c[2] * q3[2] + S,
    )


@by_type(base_vector_stiffness, GeneralLaw, FORMULAS)
def _general_stiffness(law, at, weight, R, states, lane):
    """Return the stiffness of `A_mn = sum_l a_mn,l q_l' + S_mn I`, `a_mn,l = w sum_k C_mknl q_k`."""
    (q1, q2, q3), S = vectors(states, lane), six(states, lane + uint64(9 * LANES))
    D, twice = law.D, weight + weight
    a11 = _elasticity_times_frame(D, at, twice, 0, 3, 4, q1, q2, q3)
    a12 = _elasticity_times_frame(D, at, twice, 3, 15, 16, q1, q2, q3)
    a13 = _elasticity_times_frame(D, at, twice, 4, 16, 18, q1, q2, q3)
    a22 = _elasticity_times_frame(D, at, twice, 1, 8, 9, q1, q2, q3)
    a23 = _elasticity_times_frame(D, at, twice, 5, 17, 19, q1, q2, q3)
    a33 = _elasticity_times_frame(D, at, twice, 2, 12, 13, q1, q2, q3)
    b12 = _elasticity_times_frame(D, at, twice, 15, 8, 17, q1, q2, q3)
    b22 = _elasticity_times_frame(D, at, twice, 8, 6, 10, q1, q2, q3)
    b23 = _elasticity_times_frame(D, at, twice, 17, 10, 20, q1, q2, q3)
    b13 = _elasticity_times_frame(D, at, twice, 16, 9, 19, q1, q2, q3)
    b33 = _elasticity_times_frame(D, at, twice, 12, 7, 14, q1, q2, q3)
    c13 = _elasticity_times_frame(D, at, twice, 18, 19, 13, q1, q2, q3)
    c23 = _elasticity_times_frame(D, at, twice, 19, 20, 14, q1, q2, q3)
    c33 = _elasticity_times_frame(D, at, twice, 13, 14, 11, q1, q2, q3)
    return to_base_vectors(
        R,
        _block(a11, a12, a13, q1, q2, q3, S[0]),
        _block(b12, b22, b23, q1, q2, q3, S[1]),
        _block(c13, c23, c33, q1, q2, q3, S[2]),
        _block(a12, a22, a23, q1, q2, q3, S[3]),
        _block(a13, a23, a33, q1, q2, q3, S[4]),
        _block(b13, b23, b33, q1, q2, q3, S[5]),
    )
