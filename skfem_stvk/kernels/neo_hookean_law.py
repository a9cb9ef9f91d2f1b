"""Neo-Hookean laws at a point: for solids and plane strain, and for sheets, in which the stress across the thickness is zero.

Notation of `laws`; `g_m . q_n = d_mn` (so `g_m = F^-T e_m`), `J` the ratio of volumes, `M = F'F - 1` without cancellation:

    W = mu/2 (I1 - 3 - 2 ln J) + lam/2 (J - 1)^2        P = mu (F - F^-T) + lam (J - 1) J F^-T
    s_m = w (mu sum_k M_mk g_k + lam (J - 1) J g_m)     F - F^-T = F^-T M
    A_mn = w (mu d_mn I + a g_m g_n' + c g_n g_m')      a = lam J (2 J - 1), c = mu - lam (J - 1) J

With `x = J^2 - 1 = tr M + I2(M) + det M`, at small strain the first part is `I1 - 3 - 2 ln J = (x - ln(1 + x)) - I2(M) - det M`.
This is a sum of terms of second order. A triangle in the plane has the third axis (0, 0, 1), which does not change.

For a sheet, `j` is the ratio of areas and `N` the normal. `l` is the stretch of the thickness, for which W is stationary. It is the
positive root of `(mu + lam j^2) l^2 - lam j l - mu = 0`. With `y = l^2 - 1`, `D` the root of the discriminant, and `J = j l`:

    s_m = w mu (sum_k M_mk g_k - y g_m)                 a = 2 mu lam l^2 j (2 j l - 1)/D, c = mu l^2
    A_mn = w (mu d_mn I + a g_m g_n' + c (g_n g_m' - g_m . g_n N N'))

W is not defined where `J <= 0`, and is NaN there.

The tangent is positive semi-definite after two replacements. `mu` is replaced by `m >= |c| k`. For `c > 0`, `k` is an upper bound
of all `1/(s_i s_j)` of the principal stretches; for `c < 0`, of all `1/s_i^2`. `a` is raised to at least `-(m/l + c)/3`, where `l`
is an upper bound of all `1/s_i^2`. The reason is the form in principal axes, `F = U s V'` and `dF = U X V'`:

    m sum_ij X_ij^2 + c sum_ij X_ij X_ji/(s_i s_j) + a (sum_i X_ii/s_i)^2

The pairs `X_ij, X_ji` have the eigenvalues `m +- c/(s_i s_j)`. The bounds are those of a symmetric 3 x 3 matrix by its mean
eigenvalue and the norm of its deviator, `tr/3 + sqrt(2/3) |dev|`. At rest they are exact, so that the tangent does not change
there. For sheets a 2 x 2 matrix is diagonalised. Across a sheet, `c` is limited to `m` over the largest `1/s_i^2`.

Sources: Simo, Pister (1984) for W; Smith, De Goes, Kim (2019) for the eigenvalues of such tangents; Samuelson (1968) for the bound.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy import uint64

from .compiled import Reals, by_type, inlined
from .discrete_gradient import response_through_frame, response_to_strain
from .lanes import LANES, add, cross, dot, put, times, vector, vectors
from .laws import (
    FORMULAS,
    base_vector_stiffness,
    combination,
    law_size,
    on_base_vectors,
    respond,
    scale_tensions,
    state_size,
    strain,
)


class NeoHookeanLaw(NamedTuple):
    """Neo-Hookean law of solids and plane strain: `Ri`, then `w mu`, `w lam`, and the orientation, 1 or -1."""

    D: Reals


class NeoHookeanSheet(NamedTuple):
    """Neo-Hookean law of sheets, with the numbers of `NeoHookeanLaw`; the orientation of sheets in space is 0."""

    D: Reals


by_type(response_to_strain, NeoHookeanLaw, FORMULAS)(response_through_frame)
by_type(response_to_strain, NeoHookeanSheet, FORMULAS)(response_through_frame)


@by_type(law_size, NeoHookeanLaw, FORMULAS)
@by_type(law_size, NeoHookeanSheet, FORMULAS)
def _numbers(law):
    return 9


@inlined
def _excess(x):
    """Return `x - ln(1 + x)` for `|x| < 1/4` without cancellation.

    The series is `x z - 2 z^3 (1/3 + z^2/5 + ...)` with `z = x/(2 + x)`. None of its terms is of first order.
    """
    z = x / (2 + x)
    y = z * z
    series = 1 / 3 + y * (1 / 5 + y * (1 / 7 + y * (1 / 9 + y * (1 / 11 + y * (1 / 13 + y * (1 / 15 + y * (1 / 17 + y / 19)))))))
    return x * z - 2 * z * y * series


@inlined
def _shape_energy(x, J, invariants, trace):
    """Return `tr M - 2 ln J`, at small strain as `(x - ln(1 + x)) - invariants`.

    `x` is `J^2 - 1`; `invariants` is the sum of all invariants of `M` except the trace.
    """
    small = J > 0 and abs(x) < 0.25 and abs(invariants) < 0.25
    logarithm = np.log(J)
    return _excess(x if small else 0.0) - invariants if small else trace - 2 * logarithm


@by_type(respond, NeoHookeanLaw, FORMULAS)
def _solid_response(law, at, weight, Q, h, q):
    D = law.D
    mu, lam, sign = weight * D[at + uint64(6 * LANES)], weight * D[at + uint64(7 * LANES)], D[at + uint64(8 * LANES)]
    one, zero = D.dtype.type(1), D.dtype.type(0)
    constant = one if D[at + uint64(5 * LANES)] == 0 else zero
    (Q1, Q2, Q3), (h1, h2, h3), (q1, q2, q3) = Q, h, q
    Q3, q3 = (Q3[0], Q3[1], Q3[2] + constant), (q3[0], q3[1], q3[2] + constant)
    n1, n2, n3 = cross(q2, q3), cross(q3, q1), cross(q1, q2)
    e = sign * (dot(h1, n1) + dot(Q1, add(cross(h2, q3), cross(Q2, h3))))
    J = sign * dot(q1, n1) if sign != 0 else one
    over = sign / J
    g1, g2, g3 = times(over, n1), times(over, n2), times(over, n3)
    M = strain(h1, h2, h3, Q1, Q2, Q3, q1, q2, q3)
    bulk = lam * e * J
    m = (mu * M[0] + bulk, mu * M[1] + bulk, mu * M[2] + bulk, mu * M[3], mu * M[4], mu * M[5])
    s1 = combination(m[0], g1, m[3], g2, m[4], g3)
    s2 = combination(m[3], g1, m[1], g2, m[5], g3)
    s3 = combination(m[4], g1, m[5], g2, m[2], g3)
    minor = M[1] * M[2] - M[5] * M[5]
    determinant = M[0] * minor - M[3] * (M[3] * M[2] - M[4] * M[5]) + M[4] * (M[3] * M[5] - M[1] * M[4])
    invariants = M[0] * M[1] - M[3] * M[3] + M[0] * M[2] - M[4] * M[4] + minor + determinant
    shape = _shape_energy(e * (one + J), J, invariants, M[0] + M[1] + M[2])
    energy = mu * shape + lam * e * e
    return energy + energy, (*g1, *g2, *g3, mu, lam * J * (e + J), mu - bulk), s1, s2, s3


@by_type(state_size, NeoHookeanLaw, FORMULAS)
def _numbers_of_solids(law):
    return 12


@inlined
def _largest(a, b, c, d, e, f):
    """Return an upper bound of the largest eigenvalue of a symmetric matrix in the order 11, 22, 33, 12, 13, 23."""
    mean = (a + b + c) / 3
    x, y, z = a - mean, b - mean, c - mean
    return mean + np.sqrt((x * x + y * y + z * z + 2 * (d * d + e * e + f * f)) * (2 / 3))


@by_type(scale_tensions, NeoHookeanLaw, FORMULAS)
def _scale_solids(law, points, states, positive, negative):
    for i in range(LANES):
        lane = uint64(i)
        g1, g2, g3 = vectors(states, lane)
        m, a, c = vector(states, lane + uint64(9 * LANES))
        n1, n2, n3 = cross(g2, g3), cross(g3, g1), cross(g1, g2)
        most = _largest(dot(g1, g1), dot(g2, g2), dot(g3, g3), dot(g1, g2), dot(g1, g3), dot(g2, g3))
        twist = np.sqrt(_largest(dot(n1, n1), dot(n2, n2), dot(n3, n3), dot(n1, n2), dot(n1, n3), dot(n2, n3)))
        new = max(m, c * twist if c > 0 else -c * most)
        least = -(new / most + c) / 3 if most > 0 else a
        put((m + (1 - negative) * (new - m), a + (1 - negative) * (max(a, least) - a)), states, lane + uint64(9 * LANES))


@inlined
def _diagonal_block(a, x, T):
    """Return `a x x' + T I`, in the order 11, 22, 33, 12, 13, 23."""
    y = times(a, x)
    return y[0] * x[0] + T, y[1] * x[1] + T, y[2] * x[2] + T, y[0] * x[1], y[0] * x[2], y[1] * x[2]


@inlined
def _mixed_block(a, c, x, y, T):
    """Return `a x y' + c y x' + T I`, row by row."""
    z, v = times(a, x), times(c, y)
    return (
        z[0] * y[0] + v[0] * x[0] + T,
        z[0] * y[1] + v[0] * x[1],
        z[0] * y[2] + v[0] * x[2],
        z[1] * y[0] + v[1] * x[0],
        z[1] * y[1] + v[1] * x[1] + T,
        z[1] * y[2] + v[1] * x[2],
        z[2] * y[0] + v[2] * x[0],
        z[2] * y[1] + v[2] * x[1],
        z[2] * y[2] + v[2] * x[2] + T,
    )


@by_type(base_vector_stiffness, NeoHookeanLaw, FORMULAS)
def _solid_stiffness(law, at, weight, R, states, lane):
    """Return `m G_ij I + a y_i y_j' + c y_j y_i'` with `y_i = sum_j Ri_ij g_j`, `G = Ri Ri'`."""
    (g1, g2, g3), (m, a, c) = vectors(states, lane), vector(states, lane + uint64(9 * LANES))
    y1, y2, y3 = on_base_vectors(R, g1, g2, g3)
    return (
        *_diagonal_block(a + c, y1, m * (R[0] * R[0] + R[1] * R[1] + R[2] * R[2])),
        *_diagonal_block(a + c, y2, m * (R[3] * R[3] + R[4] * R[4])),
        *_diagonal_block(a + c, y3, m * (R[5] * R[5])),
        *_mixed_block(a, c, y1, y2, m * (R[1] * R[3] + R[2] * R[4])),
        *_mixed_block(a, c, y1, y3, m * (R[2] * R[5])),
        *_mixed_block(a, c, y2, y3, m * (R[4] * R[5])),
    )


@by_type(respond, NeoHookeanSheet, FORMULAS)
def _sheet_response(law, at, weight, Q, h, q):
    D = law.D
    mu, lam, sign = weight * D[at + uint64(6 * LANES)], weight * D[at + uint64(7 * LANES)], D[at + uint64(8 * LANES)]
    one, zero = D.dtype.type(1), D.dtype.type(0)
    (Q1, Q2, Q3), (h1, h2, h3), (q1, q2, q3) = Q, h, q
    M = strain(h1, h2, h3, Q1, Q2, Q3, q1, q2, q3)
    n = cross(q1, q2)
    area = np.sqrt(dot(n, n)) if mu != 0 else one
    N = times(one / area, n)
    g1, g2 = times(one / area, cross(q2, N)), times(one / area, cross(N, q1))
    determinant = M[0] * M[1] - M[3] * M[3]
    x = M[0] + M[1] + determinant
    e = x / (one + area)
    j = -area if sign * n[2] < 0 else area
    # l = 1 + d
    both = mu + lam * j * j if mu != 0 else one
    root = np.sqrt(lam * j * lam * j + 4 * mu * both) if mu != 0 else one
    d = -2 * lam * j * e / (both + both - lam * j + root)
    y, J, change = d * (2 + d), j + j * d, e + d + e * d
    stretch = one + y
    m = (mu * (M[0] - y), mu * (M[1] - y), mu * M[3])
    s1, s2 = combination(m[0], g1, m[2], g2, zero, g2), combination(m[2], g1, m[1], g2, zero, g2)
    shape = _shape_energy(x, j, determinant, M[0] + M[1]) + _shape_energy(y, one + d, zero, y)
    energy = mu * shape + lam * change * change
    a, c = 2 * mu * lam * stretch * j * (J + J - 1) / root, mu * stretch
    state = (*g1, *g2, *N, mu, D.dtype.type(a), D.dtype.type(c), D.dtype.type(c))
    return energy + energy, state, s1, s2, (zero, zero, zero)


@by_type(state_size, NeoHookeanSheet, FORMULAS)
def _numbers_of_sheets(law):
    return 13


@by_type(scale_tensions, NeoHookeanSheet, FORMULAS)
def _scale_sheets(law, points, states, positive, negative):
    for i in range(LANES):
        lane = uint64(i)
        g1, g2, _ = vectors(states, lane)
        m, a, c = vector(states, lane + uint64(9 * LANES))
        b11, b22, b12 = dot(g1, g1), dot(g2, g2), dot(g1, g2)
        most = (b11 + b22) / 2 + np.sqrt((b11 - b22) * (b11 - b22) / 4 + b12 * b12)
        twist = np.sqrt(max(b11 * b22 - b12 * b12, 0))
        new = max(m, c * twist)
        least, across = (-(new / most + c) / 2, min(c, new / most)) if most > 0 else (a, c)
        share = 1 - negative
        put((m + share * (new - m), a + share * (max(a, least) - a)), states, lane + uint64(9 * LANES))
        states[lane + uint64(12 * LANES)] = c + share * (across - c)


@by_type(base_vector_stiffness, NeoHookeanSheet, FORMULAS)
def _sheet_stiffness(law, at, weight, R, states, lane):
    """Return the stiffness of solids plus `-c y_i . y_j N N'`."""
    (g1, g2, N), (m, a, c) = vectors(states, lane), vector(states, lane + uint64(9 * LANES))
    across = states[lane + uint64(12 * LANES)]
    y1, y2 = add(times(R[0], g1), times(R[1], g2)), times(R[3], g2)
    N11, N22, N12 = -across * dot(y1, y1), -across * dot(y2, y2), -across * dot(y1, y2)
    T11, T22, T12 = m * (R[0] * R[0] + R[1] * R[1]), m * (R[3] * R[3]), m * (R[1] * R[3])
    none = N11 - N11
    six, nine = (none, none, none, none, none, none), (none, none, none, none, none, none, none, none, none)
    return (*_plus_dyad(_diagonal_block(a + c, y1, T11), N11, N), *_plus_dyad(_diagonal_block(a + c, y2, T22), N22, N), *six,
            *_plus_dyad_by_rows(_mixed_block(a, c, y1, y2, T12), N12, N), *nine, *nine)  # fmt: skip


@inlined
def _plus_dyad(K, s, N):
    """Return a symmetric block plus `s N N'`."""
    z = times(s, N)
    return (
        K[0] + z[0] * N[0],
        K[1] + z[1] * N[1],
        K[2] + z[2] * N[2],
        K[3] + z[0] * N[1],
        K[4] + z[0] * N[2],
        K[5] + z[1] * N[2],
    )


@inlined
def _plus_dyad_by_rows(K, s, N):
    """Return a block, row by row, plus `s N N'`."""
    a, b, c, d, e, f = _plus_dyad((K[0], K[4], K[8], K[1], K[2], K[5]), s, N)
    z = times(s, N)
    return a, d, e, K[3] + z[1] * N[0], b, f, K[6] + z[2] * N[0], K[7] + z[2] * N[1], c
