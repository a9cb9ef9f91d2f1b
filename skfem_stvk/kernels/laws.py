"""Material laws at a point, in an orthonormal frame: forces on its axes and the tangent stiffness.

The base vectors at rest are `P_i = sum_a dN_a/dxi_i X_a` (`X_i - X_0` for a linear simplex), and their displacements `U_i`
likewise. Both are written in the frame of `P = Q R`, with `Q` orthonormal, `R` upper triangular, and `Ri = R^-1`:

    h_j = sum_i Ri_ij U_i        Q_j = sum_i Ri_ij P_i        q_j = Q_j + h_j = F e_j, F the deformation gradient
    f_i = sum_j Ri_ij s_j                        the forces on base vectors, s_j = w P e_j of the first Piola-Kirchhoff stress P
    K_ij = sum_mn Ri_im Ri_jn A_mn               between base vectors, A_mn = ds_m/dq_n     w = weight of the point times |det R|
                                                 times section

A law returns its energy `w W`, the `s_j` for `Q`, `h` and `q`, and a state (`respond`). From the state follows the stiffness
between base vectors (`base_vector_stiffness`). `Q` is left-handed in elements of negative orientation.

All elements have three base vectors in space here. Triangles and segments lack one or two of them. These are zero, and so are their
columns of Ri.

A law is a `NamedTuple` of its arrays, and its formulas are chosen by that type (`by_type`). A kernel with
a function as an argument or in a closure would not find its code on disk in another process.

`D` begins with the six numbers 11, 12, 13, 22, 23, 33 of Ri, stored in blocks of lanes like all arrays. Where the last block is not
full, its numbers are zero. A law must return zero for them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy import uint64

from .compiled import inlined, kernel
from .lanes import LANES, add, dot, times


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


@inlined
def magnitudes(a):
    """Return the absolute values of six numbers."""
    return abs(a[0]), abs(a[1]), abs(a[2]), abs(a[3]), abs(a[4]), abs(a[5])


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
