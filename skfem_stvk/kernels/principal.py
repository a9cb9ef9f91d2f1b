"""Laws of isotropic energies of principal stretches: stress and tangent from the decomposition of F (`svd`).

    W = w(s_1, s_2, s_3)        p_i = dw/ds_i        H_ij = d2w/ds_i ds_j
    f_ij = (p_i - p_j)/(s_i - s_j)        t_ij = (p_i + p_j)/(s_i + s_j)        flips and twists
    P = U diag(p) V'
    dP = U T V'        T_ii = sum_j H_ij D_jj        T_ij = f_ij (D_ij + D_ji)/2 + t_ij (D_ij - D_ji)/2        D = U' dF V

The nine eigenvalues of the tangent of W are those of H, the three `f_ij` and the three `t_ij`. All are known, so that negative ones
can be removed. Between base vectors, with `Z = Ri V` of rows `z_a`,

    K_ab = U G U'        G_ii = H_ii z_ai z_bi + sum_j (f_ij + t_ij)/2 z_aj z_bj
                         G_ij = H_ij z_ai z_bj + (f_ij - t_ij)/2 z_aj z_bi

Elements of fewer dimensions lack a stretch. Its flips and twists are both `p_i/s_i`, tension over stretch. A law is a type with its
numbers `D` and the kind `flat` of its elements. It supplies `w`, `p`, `H` and the flips (`stretch_response`). `of_stretches`
derives the formulas of the kernels from these.

Source: Smith, de Goes, Kim, "Analytic eigensystems for isotropic distortion energies" (2019).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy import uint64

from .compiled import by_type, inlined
from .lanes import LANES, put, six, times, vector, vectors
from .laws import FORMULAS, base_vector_stiffness, combination, law_size, respond, scale_tensions, state_size, strain
from .svd import decompose, eigen, present, small


def stretch_response(law: Any, at: Any, weight: Any, s: Any, e: Any) -> Any:
    """Return `w`, `p_i`, `H` in the order 11, 22, 33, 12, 13, 23 and the flips 12, 13, 23 for stretches `s` and `e = s - 1`."""
    return FORMULAS["stretch_response", type(law)](law, at, weight, s, e)


@inlined
def lame(law, at, weight):
    """Return `w lam` and `w mu`."""
    lam = weight * law.D[at + uint64(6 * LANES)]
    return lam + lam, weight * law.D[at + uint64(7 * LANES)]


@inlined
def _twist(p, r, s, t, least):
    """Return `(p_i + p_j)/(s_i + s_j)`, or 0 where the sum of stretches is round-off.

    The graph of the energy is a cone around such states. The decomposition selects one side of it, which is straight.
    """
    both = s + t
    return (p + r) / both if both > least else least - least


def _numbers_of_an_isotropic_law(law):
    return 8


def _numbers_of_a_decomposition(law):
    return 30


def _response_of_stretches(law, at, weight, Q, h, q):
    """Return `4 w W`, the state, and the forces on the axes; the state is `U`, `V`, `H`, the flips 12, 13, 23 and the twists."""
    D = law.D
    M = strain(h[0], h[1], h[2], Q[0], Q[1], Q[2], q[0], q[1], q[2])
    u1, u2, u3, v1, v2, v3, s, e = decompose(law.flat, D, Q, q, M)
    w, p, H, (f12, f13, f23) = stretch_response(law, at, weight, s, e)
    least = D.dtype.type(64 * np.finfo(D.dtype).eps) * (D.dtype.type(1) + abs(s[0]))
    t12, t13, t23 = (
        _twist(p[0], p[1], s[0], s[1], least),
        _twist(p[0], p[2], s[0], s[2], least),
        _twist(p[1], p[2], s[1], s[2], least),
    )
    _, y, z = present(law.flat, D)
    flips, twists = ((f12 if y > 0 else t12), (f13 if z > 0 else t13), (f23 if z > 0 else t23)), (t12, t13, t23)
    x1, x2, x3 = times(p[0], u1), times(p[1], u2), times(p[2], u3)
    w += w
    return (
        w + w,
        (*u1, *u2, *u3, *v1, *v2, *v3, *H, *flips, *twists),
        combination(v1[0], x1, v2[0], x2, v3[0], x3),
        combination(v1[1], x1, v2[1], x2, v3[1], x3),
        combination(v1[2], x1, v2[2], x2, v3[2], x3),
    )


@inlined
def _part(x, positive, negative):
    """Return a number times the factor for its sign."""
    a, b = positive * x, negative * x
    return a if x > 0 else b


def _scale_stretches(law, points, states, positive, negative):
    """Multiply twists by the factors for their signs, and other negative eigenvalues, of `H` and the flips, by the second factor.

    Without twists K is that of warped stiffness.
    """
    D = law.D
    one, plus, minus, (_, y, z) = D.dtype.type(1), D.dtype.type(positive), D.dtype.type(negative), present(law.flat, D)
    for i in range(LANES):
        lane = uint64(i)
        H = six(states, lane + uint64(18 * LANES))
        size = abs(H[0]) + abs(H[1]) + abs(H[2]) + abs(H[3]) + abs(H[4]) + abs(H[5]) + small(D)
        r = one / size
        (a, b, c), v1, v2, v3 = eigen((r * H[0], r * H[1], r * H[2], r * H[3], r * H[4], r * H[5]), D)
        a, b, c = _part(size * a, one, minus), _part(size * b, one, minus), _part(size * c, one, minus)
        x1, x2, x3 = times(a, v1), times(b, v2), times(c, v3)
        H = (
            x1[0] * v1[0] + x2[0] * v2[0] + x3[0] * v3[0],
            x1[1] * v1[1] + x2[1] * v2[1] + x3[1] * v3[1],
            x1[2] * v1[2] + x2[2] * v2[2] + x3[2] * v3[2],
            x1[0] * v1[1] + x2[0] * v2[1] + x3[0] * v3[1],
            x1[0] * v1[2] + x2[0] * v2[2] + x3[0] * v3[2],
            x1[1] * v1[2] + x2[1] * v2[2] + x3[1] * v3[2],
        )
        f, t = vector(states, lane + uint64(24 * LANES)), vector(states, lane + uint64(27 * LANES))
        t = (_part(t[0], plus, minus), _part(t[1], plus, minus), _part(t[2], plus, minus))
        f = (_part(f[0], one, minus), _part(f[1], one, minus), _part(f[2], one, minus))
        f = ((f[0] if y > 0 else t[0]), (f[1] if z > 0 else t[1]), (f[2] if z > 0 else t[2]))
        put(H, states, lane + uint64(18 * LANES))
        put(f, states, lane + uint64(24 * LANES))
        put(t, states, lane + uint64(27 * LANES))


@inlined
def _products(x, y):
    """Return `x_i y_j`, row by row."""
    return (
        (x[0] * y[0], x[0] * y[1], x[0] * y[2]),
        (x[1] * y[0], x[1] * y[1], x[1] * y[2]),
        (x[2] * y[0], x[2] * y[1], x[2] * y[2]),
    )


@inlined
def _in_axes(H, alpha, beta, x, y):
    """Return `G` for the rows `x = z_a` and `y = z_b`, row by row."""
    Z = _products(x, y)
    return (
        (
            H[0] * Z[0][0] + alpha[0] * Z[1][1] + alpha[1] * Z[2][2],
            H[3] * Z[0][1] + beta[0] * Z[1][0],
            H[4] * Z[0][2] + beta[1] * Z[2][0],
        ),
        (
            H[3] * Z[1][0] + beta[0] * Z[0][1],
            H[1] * Z[1][1] + alpha[0] * Z[0][0] + alpha[2] * Z[2][2],
            H[5] * Z[1][2] + beta[2] * Z[2][1],
        ),
        (
            H[4] * Z[2][0] + beta[1] * Z[0][2],
            H[5] * Z[2][1] + beta[2] * Z[1][2],
            H[2] * Z[2][2] + alpha[1] * Z[0][0] + alpha[2] * Z[1][1],
        ),
    )


@inlined
def _in_space(u, G):
    """Return the rows `sum_j G_ij u_j'` of `G U'`."""
    a = combination(G[0][0], u[0], G[0][1], u[1], G[0][2], u[2])
    b = combination(G[1][0], u[0], G[1][1], u[1], G[1][2], u[2])
    c = combination(G[2][0], u[0], G[2][1], u[1], G[2][2], u[2])
    return a, b, c


@inlined
def _nine(u, G):
    """Return `U G U'`, row by row."""
    a, b, c = _in_space(u, G)
    return (
        *combination(u[0][0], a, u[1][0], b, u[2][0], c),
        *combination(u[0][1], a, u[1][1], b, u[2][1], c),
        *combination(u[0][2], a, u[1][2], b, u[2][2], c),
    )


@inlined
def _six_of(u, G):
    """Return `U G U'` for a symmetric `G`, in the order 11, 22, 33, 12, 13, 23."""
    a, b, c = _in_space(u, G)
    return (
        u[0][0] * a[0] + u[1][0] * b[0] + u[2][0] * c[0],
        u[0][1] * a[1] + u[1][1] * b[1] + u[2][1] * c[1],
        u[0][2] * a[2] + u[1][2] * b[2] + u[2][2] * c[2],
        u[0][0] * a[1] + u[1][0] * b[1] + u[2][0] * c[1],
        u[0][0] * a[2] + u[1][0] * b[2] + u[2][0] * c[2],
        u[0][1] * a[2] + u[1][1] * b[2] + u[2][1] * c[2],
    )


def _stiffness_of_stretches(law, at, weight, R, states, lane):
    half = law.D.dtype.type(0.5)
    u, (v1, v2, v3) = vectors(states, lane), vectors(states, lane + uint64(9 * LANES))
    H = six(states, lane + uint64(18 * LANES))
    f, t = vector(states, lane + uint64(24 * LANES)), vector(states, lane + uint64(27 * LANES))
    alpha = (half * (f[0] + t[0]), half * (f[1] + t[1]), half * (f[2] + t[2]))
    beta = (half * (f[0] - t[0]), half * (f[1] - t[1]), half * (f[2] - t[2]))
    z1 = (
        R[0] * v1[0] + R[1] * v1[1] + R[2] * v1[2],
        R[0] * v2[0] + R[1] * v2[1] + R[2] * v2[2],
        R[0] * v3[0] + R[1] * v3[1] + R[2] * v3[2],
    )
    z2 = (R[3] * v1[1] + R[4] * v1[2], R[3] * v2[1] + R[4] * v2[2], R[3] * v3[1] + R[4] * v3[2])
    z3 = (R[5] * v1[2], R[5] * v2[2], R[5] * v3[2])
    return (
        *_six_of(u, _in_axes(H, alpha, beta, z1, z1)),
        *_six_of(u, _in_axes(H, alpha, beta, z2, z2)),
        *_six_of(u, _in_axes(H, alpha, beta, z3, z3)),
        *_nine(u, _in_axes(H, alpha, beta, z1, z2)),
        *_nine(u, _in_axes(H, alpha, beta, z1, z3)),
        *_nine(u, _in_axes(H, alpha, beta, z2, z3)),
    )


def of_stretches(kind: type) -> None:
    """Register the formulas of a law of principal stretches, which use its `stretch_response`."""
    for stub, formula in (
        (law_size, _numbers_of_an_isotropic_law),
        (state_size, _numbers_of_a_decomposition),
        (respond, _response_of_stretches),
        (scale_tensions, _scale_stretches),
        (base_vector_stiffness, _stiffness_of_stretches),
    ):
        by_type(stub, kind, FORMULAS)(formula)
