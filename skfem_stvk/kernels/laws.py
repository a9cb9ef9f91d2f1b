"""Material laws at a point, in an orthonormal frame: forces on its axes and the tangent stiffness; and the laws of StVK.

The base vectors at rest are `P_i = sum_a dN_a/dxi_i X_a` (`X_i - X_0` for a linear simplex), and their displacements `U_i`
likewise. Both are written in the frame of `P = Q R`, with `Q` orthonormal, `R` upper triangular, and `Ri = R^-1`:

    h_j = sum_i Ri_ij U_i        Q_j = sum_i Ri_ij P_i        q_j = Q_j + h_j = F e_j, F the deformation gradient
    f_i = sum_j Ri_ij s_j                        the forces on base vectors, s_j = w P e_j of the first Piola-Kirchhoff stress P
    K_ij = sum_mn Ri_im Ri_jn A_mn               between base vectors, A_mn = ds_m/dq_n     w = weight of the point times |det R|
                                                 times section

A law returns its energy `w W`, the `s_j` for `Q`, `h` and `q`, and a state (`respond`). From the state follows the stiffness
between base vectors (`base_vector_stiffness`). `Q` is left-handed in elements of negative orientation.

St. Venant-Kirchhoff:

    M_ij = q_i . h_j + h_i . Q_j = 2 E_ij        without cancellation at small strain
    S_ij = w C_ijkl M_kl / 2                     w W = 1/4 S : M        s_j = sum_k S_jk q_k
    A_mn = w sum_kl C_mknl q_k q_l' + S_mn I

    isotropic, 2 numbers    S = w (lam/2 tr M I + mu M)        y_i = sum_j Ri_ij q_j = F g_i,  G = Ri Ri',  B = sum_i q_i q_i'
                            K_ij = w (lam y_i y_j' + mu y_j y_i' + mu G_ij B) + (Ri S Ri')_ij I
    general, 21 numbers     w C/2 in the order 11, 22, 33, 12, 13, 23, the upper half row by row

All elements have three base vectors in space here. Triangles and segments lack one or two of them. These are zero, and so are their
columns of Ri.

A law is a `NamedTuple` of its arrays, and its formulas are chosen by that type (`by_type`). A kernel with
a function as an argument or in a closure would not find its code on disk in another process.

`D` begins with the six numbers 11, 12, 13, 22, 23, 33 of Ri, stored in blocks of lanes like all arrays. Where the last block is not
full, its numbers are zero. A law must return zero for them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy import uint64

from .compiled import Reals, by_type, inlined, kernel
from .lanes import LANES, add, dot, six, times, vectors


class IsotropicLaw(NamedTuple):
    """Isotropic StVK law: `Ri`, then `w lam/2` and `w mu`."""

    D: Reals


class GeneralLaw(NamedTuple):
    """General StVK law: `Ri`, then 21 numbers `w C/2`."""

    D: Reals


@inlined
def combination(x, a, y, b, z, c):
    """Return `x a + y b + z c` for vectors."""
    return x * a[0] + y * b[0] + z * c[0], x * a[1] + y * b[1] + z * c[1], x * a[2] + y * b[2] + z * c[2]


@inlined
def in_frame(R, U1, U2, U3):
    """Return `sum_i Ri_ij U_i`, j = 1, 2, 3."""
    return (
        (R[0] * U1[0], R[0] * U1[1], R[0] * U1[2]),
        (R[1] * U1[0] + R[3] * U2[0], R[1] * U1[1] + R[3] * U2[1], R[1] * U1[2] + R[3] * U2[2]),
        combination(R[2], U1, R[4], U2, R[5], U3),
    )


@inlined
def on_base_vectors(R, f1, f2, f3):
    """Return `sum_j Ri_ij f_j`, i = 1, 2, 3."""
    return (
        combination(R[0], f1, R[1], f2, R[2], f3),
        (R[3] * f2[0] + R[4] * f3[0], R[3] * f2[1] + R[4] * f3[1], R[3] * f2[2] + R[4] * f3[2]),
        (R[5] * f3[0], R[5] * f3[1], R[5] * f3[2]),
    )


@inlined
def strain(h1, h2, h3, Q1, Q2, Q3, q1, q2, q3):
    """Return `M_ij = q_i . h_j + h_i . Q_j` in the order 11, 22, 33, 12, 13, 23."""
    return (
        dot(q1, h1) + dot(h1, Q1),
        dot(q2, h2) + dot(h2, Q2),
        dot(q3, h3) + dot(h3, Q3),
        dot(q1, h2) + dot(h1, Q2),
        dot(q1, h3) + dot(h1, Q3),
        dot(q2, h3) + dot(h2, Q3),
    )


@inlined
def contracted(S, M):
    """Return `S : M`."""
    shear = S[3] * M[3] + S[4] * M[4] + S[5] * M[5]
    return S[0] * M[0] + S[1] * M[1] + S[2] * M[2] + shear + shear


@inlined
def weighted_sum(x, a, y, b):
    """Return `x a + y b` for six numbers each."""
    return (
        x * a[0] + y * b[0],
        x * a[1] + y * b[1],
        x * a[2] + y * b[2],
        x * a[3] + y * b[3],
        x * a[4] + y * b[4],
        x * a[5] + y * b[5],
    )


@inlined
def between(q, theta, H):
    """Return the frame `q_i + theta H_i`."""
    return add(q[0], times(theta, H[0])), add(q[1], times(theta, H[1])), add(q[2], times(theta, H[2]))


@inlined
def axis_forces(S, q1, q2, q3):
    """Return `sum_k S_jk q_k`, j = 1, 2, 3."""
    return (
        combination(S[0], q1, S[3], q2, S[4], q3),
        combination(S[3], q1, S[1], q2, S[5], q3),
        combination(S[4], q1, S[5], q2, S[2], q3),
    )


def law_size(law: Any) -> int:
    """Return how many numbers a law has at a point, including those of `Ri`."""
    return int(FORMULAS["law_size", type(law)](law))


def state_size(law: Any) -> int:
    """Return how many numbers the state has that `base_vector_stiffness` needs."""
    return int(FORMULAS["state_size", type(law)](law))


def respond(law: Any, at: Any, weight: Any, Q: Any, h: Any, q: Any) -> Any:
    """Return `4 w W`, the state, and `s_1, s_2, s_3`, for the frame at rest `Q`, its displacement `h` and `q = Q + h`.

    The numbers of the law begin at index `at`; `weight` is the weight of the point. Where `W` is not defined, it is not finite.
    """
    return FORMULAS["respond", type(law)](law, at, weight, Q, h, q)


def scale_tensions(law: Any, points: Any, states: Any, positive: Any, negative: Any) -> None:
    """Multiply the tensions in the states `states` (state_size LANES,) by the factors for their sign, which are not both 1.

    With factors (1, 0) and (0, 0), the result of `base_vector_stiffness` is positive semi-definite. St. Venant-Kirchhoff on linear
    simplices is an exception, because there only the sums of tensions over elements have a sign.
    """
    FORMULAS["scale_tensions", type(law)](law, points, states, positive, negative)


def base_vector_stiffness(law: Any, at: Any, weight: Any, R: Any, states: Any, lane: Any) -> Any:
    """Return the stiffness between base vectors, as 45 numbers.

    These are `K_11, K_22, K_33` in the order 11, 22, 33, 12, 13, 23, then `K_12, K_13, K_23` row by row.
    """
    return FORMULAS["base_vector_stiffness", type(law)](law, at, weight, R, states, lane)


def stress(law: Any, at: Any, weight: Any, M: Any) -> Any:
    """Return `weight` times the St. Venant-Kirchhoff stress `S` for the strains `M`; the numbers of the law begin at index `at`."""
    return FORMULAS["stress", type(law)](law, at, weight, M)


def stress_magnitudes(law: Any, at: Any, weight: Any, M: Any) -> Any:
    """Return the `stress` that follows from the absolute values of the numbers of the law."""
    return FORMULAS["stress_magnitudes", type(law)](law, at, weight, M)


FORMULAS: dict[tuple[str, type], Any] = {}


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
def magnitudes(a):
    """Return the absolute values of six numbers."""
    return abs(a[0]), abs(a[1]), abs(a[2]), abs(a[3]), abs(a[4]), abs(a[5])


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


@kernel
def scale_eigenvalues(S, lane, positive, negative):
    """Multiply the eigenvalues of a symmetric matrix by the factor for their sign, with Jacobi's method.

    The order of components is 11, 22, 33, 12, 13, 23.
    """
    a, b, c = S[lane], S[lane + uint64(LANES)], S[lane + uint64(2 * LANES)]
    A = np.array(
        [
            [a, S[lane + uint64(3 * LANES)], S[lane + uint64(4 * LANES)]],
            [S[lane + uint64(3 * LANES)], b, S[lane + uint64(5 * LANES)]],
            [S[lane + uint64(4 * LANES)], S[lane + uint64(5 * LANES)], c],
        ]
    )
    V = np.eye(3)
    for _ in range(12):
        off = abs(A[0, 1]) + abs(A[0, 2]) + abs(A[1, 2])
        if not off > 1e-17 * (abs(A[0, 0]) + abs(A[1, 1]) + abs(A[2, 2])):
            break
        for p, r in ((0, 1), (0, 2), (1, 2)):
            if A[p, r] == 0:
                continue
            tau = (A[r, r] - A[p, p]) / (2 * A[p, r])
            t = (1 if tau >= 0 else -1) / (abs(tau) + np.sqrt(1 + tau * tau))
            co = 1 / np.sqrt(1 + t * t)
            si = t * co
            for k in range(3):
                x, y = A[k, p], A[k, r]
                A[k, p], A[k, r] = co * x - si * y, si * x + co * y
            for k in range(3):
                x, y = A[p, k], A[r, k]
                A[p, k], A[r, k] = co * x - si * y, si * x + co * y
                x, y = V[k, p], V[k, r]
                V[k, p], V[k, r] = co * x - si * y, si * x + co * y
    x = A[0, 0] * (positive if A[0, 0] > 0 else negative)
    y = A[1, 1] * (positive if A[1, 1] > 0 else negative)
    z = A[2, 2] * (positive if A[2, 2] > 0 else negative)
    for number, (i, j) in enumerate(((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))):
        S[lane + uint64(number * LANES)] = x * V[i, 0] * V[j, 0] + y * V[i, 1] * V[j, 1] + z * V[i, 2] * V[j, 2]


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


@inlined
def conjugated(R, S):
    """Return `Ri S Ri'` for a symmetric `S`, both in the order 11, 22, 33, 12, 13, 23."""
    a1, a2, a3 = (
        R[0] * S[0] + R[1] * S[3] + R[2] * S[4],
        R[0] * S[3] + R[1] * S[1] + R[2] * S[5],
        R[0] * S[4] + R[1] * S[5] + R[2] * S[2],
    )
    b2, b3 = R[3] * S[1] + R[4] * S[5], R[3] * S[5] + R[4] * S[2]
    c3 = R[5] * S[2]
    return a1 * R[0] + a2 * R[1] + a3 * R[2], b2 * R[3] + b3 * R[4], c3 * R[5], a2 * R[3] + a3 * R[4], a3 * R[5], b3 * R[5]


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


@inlined
def _six(K):
    """Return the components of a symmetric block of nine numbers in the order 11, 22, 33, 12, 13, 23."""
    return K[0], K[4], K[8], K[1], K[2], K[5]


@inlined
def _weighted(x, a, y, b):
    """Return `x a + y b` for blocks."""
    return (
        x * a[0] + y * b[0],
        x * a[1] + y * b[1],
        x * a[2] + y * b[2],
        x * a[3] + y * b[3],
        x * a[4] + y * b[4],
        x * a[5] + y * b[5],
        x * a[6] + y * b[6],
        x * a[7] + y * b[7],
        x * a[8] + y * b[8],
    )


@inlined
def _three(x, a, y, b, z, c):
    """Return `x a + y b + z c` for blocks."""
    return (
        x * a[0] + y * b[0] + z * c[0],
        x * a[1] + y * b[1] + z * c[1],
        x * a[2] + y * b[2] + z * c[2],
        x * a[3] + y * b[3] + z * c[3],
        x * a[4] + y * b[4] + z * c[4],
        x * a[5] + y * b[5] + z * c[5],
        x * a[6] + y * b[6] + z * c[6],
        x * a[7] + y * b[7] + z * c[7],
        x * a[8] + y * b[8] + z * c[8],
    )


@inlined
def transposed(K):
    """Return the transpose of a block of nine numbers."""
    return K[0], K[3], K[6], K[1], K[4], K[7], K[2], K[5], K[8]


@inlined
def _scaled(s, a):
    return s * a[0], s * a[1], s * a[2], s * a[3], s * a[4], s * a[5], s * a[6], s * a[7], s * a[8]


@inlined
def to_base_vectors(R, A11, A22, A33, A12, A13, A23):
    """Return `K_ij = sum_mn Ri_im Ri_jn A_mn`, the 45 numbers of `base_vector_stiffness`, from blocks in the frame, row by row."""
    # rows first: B_in = sum_m Ri_im A_mn
    A31, A32, A21 = transposed(A13), transposed(A23), transposed(A12)
    B11 = _three(R[0], A11, R[1], A21, R[2], A31)
    B12 = _three(R[0], A12, R[1], A22, R[2], A32)
    B13 = _three(R[0], A13, R[1], A23, R[2], A33)
    B22, B23, B33 = _weighted(R[3], A22, R[4], A32), _weighted(R[3], A23, R[4], A33), _scaled(R[5], A33)
    K11 = _three(R[0], B11, R[1], B12, R[2], B13)
    K12, K13 = _weighted(R[3], B12, R[4], B13), _scaled(R[5], B13)
    K22, K23, K33 = _weighted(R[3], B22, R[4], B23), _scaled(R[5], B23), _scaled(R[5], B33)
    return (*_six(K11), *_six(K22), *_six(K33), *K12, *K13, *K23)


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
