"""St. Venant-Kirchhoff law of sheets and cables without compressive stress: the relaxed energy of tension fields.

`m_1 >= m_2` are the principal values of `M = 2 E`, `nu` is Poisson's ratio, and S is isotropic in plane stress. Each value is
replaced by at least the lateral contraction due to tension along the other axis:

    n_1 = max(m_1, 0)        n_2 = max(m_2, -nu n_1)        S_i = w (lam/2 (n_1 + n_2) + mu n_i)        4 w W = S_1 m_1 + S_2 m_2

    taut        n = m: unchanged
    wrinkled    S_1 = w E/2 m_1, S_2 = 0: uniaxial tension, of Young's modulus E = 2 mu (1 + nu)
    slack       S = 0

W is the minimum energy over all strains larger than M; the difference is due to wrinkles. Therefore W is convex in M and S has no
negative principal value, so that the tangent is positive semi-definite. S is continuous, but its derivative jumps between the three
states. On a border the derivative is that of the taut state, or of the wrinkled state next to the slack state. With `r_i = F v_i`
of the principal axes, `Z = Ri V` of rows `z_a`:

    K_ab = sum_mn z_am z_bn A_mn        A_11 = 2 T_11 r_1 r_1' + g r_2 r_2' + S_1 I        A_12 = 2 T_12 r_1 r_2' + g r_2 r_1'
    T_ij = dS_i/dm_j        g = (S_1 - S_2)/(m_1 - m_2)

A segment has one value, and its stored numbers contain no Poisson's ratio. The other value is zero.

Source: Pipkin, "The relaxed energy density for isotropic elastic membranes" (1986).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy import uint64

from .compiled import Reals, by_type, inlined
from .discrete_gradient import response_to_strain
from .lanes import LANES, six, times, vector
from .laws import FORMULAS, base_vector_stiffness, combination, law_size, respond, scale_tensions, state_size, strain


class TensionLaw(NamedTuple):
    """Law of tension fields: `Ri`, then `w lam/2` and `w mu` within a sheet in plane stress."""

    D: Reals


@by_type(law_size, TensionLaw, FORMULAS)
def _numbers(law):
    return 8


@by_type(state_size, TensionLaw, FORMULAS)
def _numbers_of_two_axes(law):
    return 14


@inlined
def _axes(a, b, g, one, tiny):
    """Return `m_1 >= m_2` of the matrix `a, g; g, b`, and the first axis."""
    half = one / (one + one)
    size = abs(a) + abs(b) + abs(g) + tiny
    d, e, mean = half * (a - b) / size, g / size, half * (a + b)
    h = np.sqrt(d * d + e * e)
    x, y = (d + h if d >= 0 else e), (e if d >= 0 else h - d)
    n = np.sqrt(x * x + y * y)
    there = n > 0
    x, y, n = (x if there else one), (y if there else one - one), (n if there else one)
    return mean + size * h, mean - size * h, x / n, y / n


@inlined
def _relaxed(lam, mu, m1, m2, one):
    """Return `S_1, S_2`, Poisson's ratio, and whether there is tension along the first axis, and along both axes."""
    both = lam + mu
    nu, zero = lam / (both if both > 0 else one), one - one
    tense = m1 >= 0
    n1 = m1 if tense else zero
    taut = tense & (m2 >= -nu * n1)
    n2 = m2 if taut else -nu * n1
    S1 = both * n1 + lam * n2
    S2 = both * n2 + lam * n1
    return S1, (S2 if taut else zero), nu, tense, taut


@by_type(respond, TensionLaw, FORMULAS)
def _response_of_tension(law, at, weight, Q, h, q):
    """Return `4 w W`, the state, and the forces on the axes.

    The state is `r_1`, `r_2`, the first axis, `T_11`, `T_22`, `T_12`, `g`, `S_1`, `S_2`.
    """
    D = law.D
    one, tiny = D.dtype.type(1), D.dtype.type(np.finfo(D.dtype).tiny)
    zero = one - one
    lam, mu = weight * D[at + uint64(6 * LANES)], weight * D[at + uint64(7 * LANES)]
    M = strain(h[0], h[1], h[2], Q[0], Q[1], Q[2], q[0], q[1], q[2])
    m1, m2, c, s = _axes(M[0], M[1], M[3], one, tiny)
    S1, S2, nu, tense, taut = _relaxed(lam, mu, m1, m2, one)
    r1 = combination(c, q[0], s, q[1], zero, q[2])
    r2 = combination(-s, q[0], c, q[1], zero, q[2])
    T11 = lam + mu if taut else mu + nu * mu
    slope = mu if taut else (S1 - S2) / (m1 - m2 if m1 > m2 else one)
    slopes = ((T11 if tense else zero), (lam + mu if taut else zero), (lam if taut else zero), (slope if tense else zero))
    state = (*r1, *r2, *(c, s), *slopes, *(S1, S2))
    x1, x2 = times(S1, r1), times(S2, r2)
    return (
        S1 * m1 + S2 * m2,
        state,
        combination(c, x1, -s, x2, zero, x2),
        combination(s, x1, c, x2, zero, x2),
        (zero, zero, zero),
    )


@by_type(response_to_strain, TensionLaw, FORMULAS)
def _relaxed_response_to_strain(law, at, weight, M, rest, orientation, second, third, one):
    """Return `4 w W` and `S` without a frame, because elements that have collapsed to a line or a point have none."""
    D = law.D
    lam, mu = weight * D[at + uint64(6 * LANES)], weight * D[at + uint64(7 * LANES)]
    m1, m2, c, s = _axes(M[0], M[1], M[3], one, D.dtype.type(np.finfo(D.dtype).tiny))
    S1, S2, _, _, _ = _relaxed(lam, mu, m1, m2, one)
    zero = one - one
    S = (c * c * S1 + s * s * S2, s * s * S1 + c * c * S2, zero, c * s * (S1 - S2), zero, zero)
    return S1 * m1 + S2 * m2, S


@by_type(scale_tensions, TensionLaw, FORMULAS)
def _scale_tension_fields(law, points, states, positive, negative):
    """Multiply the tensions by `positive`, because none is negative."""
    states[12 * LANES :] *= states.dtype.type(positive)


@inlined
def _dyad_coefficients(k, z, y):
    """Return the coefficients of `r_1 r_1'`, `r_2 r_2'`, `r_1 r_2'`, `r_2 r_1'` and `I` in `sum_mn z_m y_n A_mn`.

    Here `z = z_a` and `y = z_b`.
    """
    T11, T22, T12, g, S1, S2 = k
    first, second, mixed, other = z[0] * y[0], z[1] * y[1], z[0] * y[1], z[1] * y[0]
    return (
        (T11 + T11) * first + g * second,
        (T22 + T22) * second + g * first,
        (T12 + T12) * mixed + g * other,
        (T12 + T12) * other + g * mixed,
        S1 * first + S2 * second,
    )


@inlined
def _block(n, r1, r2):
    """Return the nine numbers of a block with the coefficients `n` of `_dyad_coefficients`, row by row."""
    a = (n[0] * r1[0] + n[2] * r2[0], n[0] * r1[1] + n[2] * r2[1], n[0] * r1[2] + n[2] * r2[2])
    b = (n[3] * r1[0] + n[1] * r2[0], n[3] * r1[1] + n[1] * r2[1], n[3] * r1[2] + n[1] * r2[2])
    return (
        r1[0] * a[0] + r2[0] * b[0] + n[4],
        r1[0] * a[1] + r2[0] * b[1],
        r1[0] * a[2] + r2[0] * b[2],
        r1[1] * a[0] + r2[1] * b[0],
        r1[1] * a[1] + r2[1] * b[1] + n[4],
        r1[1] * a[2] + r2[1] * b[2],
        r1[2] * a[0] + r2[2] * b[0],
        r1[2] * a[1] + r2[2] * b[1],
        r1[2] * a[2] + r2[2] * b[2] + n[4],
    )


@by_type(base_vector_stiffness, TensionLaw, FORMULAS)
def _stiffness_of_tension(law, at, weight, R, states, lane):
    r1, r2, k = vector(states, lane), vector(states, lane + uint64(3 * LANES)), six(states, lane + uint64(8 * LANES))
    c, s = states[lane + uint64(6 * LANES)], states[lane + uint64(7 * LANES)]
    z1, z2 = (R[0] * c + R[1] * s, R[1] * c - R[0] * s), (R[3] * s, R[3] * c)
    K11, K22 = _block(_dyad_coefficients(k, z1, z1), r1, r2), _block(_dyad_coefficients(k, z2, z2), r1, r2)
    o = c - c
    none = (o, o, o, o, o, o)
    nine = (o, o, o, o, o, o, o, o, o)
    return (
        *(K11[0], K11[4], K11[8], K11[1], K11[2], K11[5]),
        *(K22[0], K22[4], K22[8], K22[1], K22[2], K22[5]),
        *none,
        *_block(_dyad_coefficients(k, z1, z2), r1, r2),
        *nine,
        *nine,
    )
