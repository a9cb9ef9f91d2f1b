"""Laws of isotropic energies of principal stretches: singular values with a sign, stress and tangent from them.

With `q_j = F e_j` in the frame at rest `Q`, `F = U diag(s) V'` there: `V` a rotation, `U` a frame of the hand of `Q`, so that `U V'
Q'` is a rotation in space also where F is singular or mirrored, and the smallest of the singular values takes the sign of det F.

    M V = V diag(m)         `M = F'F - I` near rest, `F'F` elsewhere; Jacobi's method, a fixed number of turns without branches
    s_i - 1 = m_i/(1 + sqrt(1 + m_i))        near rest, without cancellation; elsewhere `s_i = u_i . F v_i`
    u_1, u_2        F v_1, F v_2 made orthonormal, or any such vectors where those vanish; `u_3 = u_1 x u_2` with the frame's hand

    W = w(s_1, s_2, s_3)        p_i = dw/ds_i        H_ij = d2w/ds_i ds_j
    f_ij = (p_i - p_j)/(s_i - s_j)        t_ij = (p_i + p_j)/(s_i + s_j)        flips and twists
    P = U diag(p) V'
    dP = U T V'        T_ii = sum_j H_ij D_jj        T_ij = f_ij (D_ij + D_ji)/2 + t_ij (D_ij - D_ji)/2        D = U' dF V

The eigenvalues of the tangent of W are those of H, and f and t: three by three, three and three. Each is known, so that what is
negative can be left out. Of the spokes, with `Z = Ri V` of rows `z_a`,

    K_ab = U G U'        G_ii = H_ii z_ai z_bi + sum_j (f_ij + t_ij)/2 z_aj z_bj
                         G_ij = H_ij z_ai z_bj + (f_ij - t_ij)/2 z_aj z_bi

Elements of fewer dimensions have no stress along what they lack: the stretch there counts as zero, so that flip and twist with it
are both `p_i/s_i`, tension over stretch. In a plane or on a line, which have two sides, stretches have a sign; of membranes and
cables in space they have none.

Source: Smith, de Goes, Kim, "Analytic eigensystems for isotropic distortion energies" (2019); Irving, Teran, Fedkiw (2004) for the
sign.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .compiled import Reals, by_type, inlined
from .lanes import LANES, I, add, cross, dot, put, six, times, vector, vectors
from .laws import (
    FORMULAS,
    IsotropicLaw,
    combination,
    contracted,
    numbers_in,
    numbers_kept,
    pulled,
    respond,
    spoke_stiffness,
    strain,
    stress,
    weigh,
)

#: Elements of fewer dimensions, by what they lie in.
LINE, CABLE, SHEET, MEMBRANE = 0, 1, 2, 3


class Flat(NamedTuple):
    """Elements of fewer than three dimensions: `LINE`, `CABLE`, `SHEET` or `MEMBRANE`."""

    kind: int


def decompose(flat: Any, D: Any, Q: Any, q: Any, M: Any) -> Any:
    """`u_1, u_2, u_3`, `v_1, v_2, v_3`, the stretches `s` and `s - 1`; `flat` is None for solids, otherwise a `Flat`."""
    return FORMULAS["decompose", type(flat)](flat, D, Q, q, M)


def present(flat: Any, D: Any) -> Any:
    """1 for each of three stretches that there is, 0 for those that are lacking."""
    return FORMULAS["present", type(flat)](flat, D)


@inlined
def select(condition, a, b):
    """The vector `a` or `b`, without a branch."""
    return (a[0] if condition else b[0]), (a[1] if condition else b[1]), (a[2] if condition else b[2])


@inlined
def _small(D):
    """A number that is nothing beside 1, and whose square can still be told from zero."""
    return D.dtype.type(1e-18) if D.dtype.type(1e-60) == 0 else D.dtype.type(1e-150)


@inlined
def _turn(a, b, g, one, tiny):
    """Cosine and sine of the small turn that makes `a, g; g, b` diagonal, and the values on the diagonal then."""
    d, twice = b - a, g + g
    h = np.sqrt(d * d + twice * twice)
    x = abs(d) + h + tiny
    r = one / np.sqrt(x * x + twice * twice)
    half = one / (one + one)
    mean, apart = half * (a + b), half * (h if d >= 0 else -h)
    return x * r, (twice if d >= 0 else -twice) * r, mean - apart, mean + apart


@inlined
def _turned(c, s, x, y):
    """`c x - s y` and `s x + c y` of vectors."""
    return (
        (c * x[0] - s * y[0], c * x[1] - s * y[1], c * x[2] - s * y[2]),
        (s * x[0] + c * y[0], s * x[1] + c * y[1], s * x[2] + c * y[2]),
    )


@inlined
def _sweep(A, v1, v2, v3, one, tiny):
    """Three turns of Jacobi's method for `A` in the order 11, 22, 33, 12, 13, 23."""
    a, b, c, d, e, f = A
    co, si, a, b = _turn(a, b, d, one, tiny)
    e, f = co * e - si * f, si * e + co * f
    v1, v2 = _turned(co, si, v1, v2)
    co, si, a, c = _turn(a, c, e, one, tiny)
    d, f = -si * f, co * f
    v1, v3 = _turned(co, si, v1, v3)
    co, si, b, c = _turn(b, c, f, one, tiny)
    d, e = co * d, si * d
    v2, v3 = _turned(co, si, v2, v3)
    return (a, b, c, d, e, a - a), v1, v2, v3


@inlined
def eigen(A, D):
    """Eigenvalues and eigenvectors of a symmetric matrix in the order 11, 22, 33, 12, 13, 23 whose numbers are about 1.

    The eigenvectors are the columns of a rotation. Jacobi's method; four sweeps leave nothing off the diagonal.
    """
    zero, one, tiny = D.dtype.type(0), D.dtype.type(1), _small(D)
    a, b, c, d, e, f = A
    p, q, a, b = _turn(a, b, d, one, tiny)
    e, f = p * e - q * f, q * e + p * f
    r, s, a, c = _turn(a, c, e, one, tiny)
    d, f = -s * f, r * f
    v1, v2, v3 = (r * p, -r * q, -s), (q, p, zero), (s * p, -s * q, r)
    p, q, b, c = _turn(b, c, f, one, tiny)
    A = (a, b, c, p * d, q * d, zero)
    v2, v3 = _turned(p, q, v2, v3)
    A, v1, v2, v3 = _sweep(A, v1, v2, v3, one, tiny)
    A, v1, v2, v3 = _sweep(A, v1, v2, v3, one, tiny)
    A, v1, v2, v3 = _sweep(A, v1, v2, v3, one, tiny)
    return (A[0], A[1], A[2]), v1, v2, v3


@inlined
def _in_order(swap, one, v, w):
    """The two vectors, or exchanged with the same hand."""
    return select(swap, w, v), select(swap, times(-one, v), w)


@inlined
def _image(q, v):
    """`F v` of a vector in the frame."""
    return combination(v[0], q[0], v[1], q[1], v[2], q[2])


@inlined
def _first(b, one, tiny):
    """The direction of a vector, or of the first axis if it is nothing; and the square of its length."""
    n = dot(b, b)
    there = n > tiny
    r = one / np.sqrt(n if there else one)
    return select(there, times(r, b), (one, one - one, one - one)), n


@inlined
def _second(b, u1, n1, D, tiny):
    """The direction of `b` across `u1`, or any across it if `b` is nothing beside a vector along `u1` of the squared length n1."""
    one, eps = D.dtype.type(1), D.dtype.type(16 * np.finfo(D.dtype).eps)
    w = add(b, times(-dot(u1, b), u1))
    w = add(w, times(-dot(u1, w), u1))
    flat = not dot(w, w) > eps * eps * (n1 + tiny)
    along = abs(u1[0]) > abs(u1[1])
    zero = one - one
    axis = ((zero if along else one), (one if along else zero), zero)
    other = add(axis, times(-dot(u1, axis), u1))
    w = select(flat, other, w)
    return times(one / np.sqrt(dot(w, w)), w)


@inlined
def _scaled(near, M, C, D):
    """`M` near rest, otherwise `C`, times what makes their numbers about 1; and the inverse of that."""
    a, b, c, d, e, f = (
        (M[0] if near else C[0]),
        (M[1] if near else C[1]),
        (M[2] if near else C[2]),
        (M[3] if near else C[3]),
        (M[4] if near else C[4]),
        (M[5] if near else C[5]),
    )
    size = abs(a) + abs(b) + abs(c) + abs(d) + abs(e) + abs(f) + _small(D)
    r = D.dtype.type(1) / size
    return (r * a, r * b, r * c, r * d, r * e, r * f), size


@inlined
def _is_near(volume, M, D):
    """Whether no stretch is far from 1: the strain is small, and nothing is mirrored."""
    return (volume > 0) & (abs(M[0]) + abs(M[1]) + abs(M[2]) + abs(M[3]) + abs(M[4]) + abs(M[5]) < D.dtype.type(0.3))


@inlined
def _elongation(near, m, s, one):
    """`s - 1` and `s` for `s^2 - 1 = m` near rest, and for `s` elsewhere."""
    m = m if near else one - one
    small, large = m / (one + np.sqrt(one + m)), s - one
    e = small if near else large
    return e, (one + e if near else s)


@by_type(decompose, type(None), FORMULAS)
def _decompose_solid(flat, D, Q, q, M):
    zero, one, tiny = D.dtype.type(0), D.dtype.type(1), _small(D)
    hand = one if dot(Q[0], cross(Q[1], Q[2])) > 0 else -one
    near = _is_near(hand * dot(q[0], cross(q[1], q[2])), M, D)
    C = (dot(q[0], q[0]), dot(q[1], q[1]), dot(q[2], q[2]), dot(q[0], q[1]), dot(q[0], q[2]), dot(q[1], q[2]))
    A, size = _scaled(near, M, C, D)
    (m1, m2, m3), v1, v2, v3 = eigen(A, D)
    swap = m1 < m2
    (m1, m2), (v1, v2) = ((m2 if swap else m1), (m1 if swap else m2)), _in_order(swap, one, v1, v2)
    swap = m2 < m3
    (m2, m3), (v2, v3) = ((m3 if swap else m2), (m2 if swap else m3)), _in_order(swap, one, v2, v3)
    swap = m1 < m2
    (m1, m2), (v1, v2) = ((m2 if swap else m1), (m1 if swap else m2)), _in_order(swap, one, v1, v2)
    b1, b2, b3 = _image(q, v1), _image(q, v2), _image(q, v3)
    # where two stretches are small beside the first, what tells them apart is lost in C but not in the vectors
    n2, n3 = dot(b2, b2), dot(b3, b3)
    lost = n2 < D.dtype.type(0.01) * dot(b1, b1)
    r = one / (n2 + n3 + tiny)
    co, si, n2, n3 = _turn(r * n2, r * n3, r * dot(b2, b3), one, tiny)
    co, si = (co if lost else one), (si if lost else zero)
    v2, v3 = _turned(co, si, v2, v3)
    b2, b3 = _turned(co, si, b2, b3)
    swap = lost & (n2 < n3)
    (v2, v3), (b2, b3) = _in_order(swap, one, v2, v3), _in_order(swap, one, b2, b3)
    u1, n1 = _first(b1, one, tiny)
    u2 = _second(b2, u1, n1, D, tiny)
    u3 = times(hand, cross(u1, u2))
    e1, s1 = _elongation(near, size * m1, dot(u1, b1), one)
    e2, s2 = _elongation(near, size * m2, dot(u2, b2), one)
    e3, s3 = _elongation(near, size * m3, dot(u3, b3), one)
    return u1, u2, u3, v1, v2, v3, (s1, s2, s3), (e1, e2, e3)


@by_type(present, type(None), FORMULAS)
def _all_present(flat, D):
    one = D.dtype.type(1)
    return one, one, one


@by_type(decompose, Flat, FORMULAS)
def _decompose_flat(flat, D, Q, q, M):
    zero, one, tiny = D.dtype.type(0), D.dtype.type(1), _small(D)
    plane, z = flat.kind >= SHEET, (zero, zero, one)
    hand = one if (dot(cross(Q[0], Q[1]), z) if plane else Q[0][0]) > 0 else -one
    side = dot(cross(q[0], q[1]), z) if flat.kind == SHEET else q[0][0]
    near = _is_near(hand * side if flat.kind == SHEET or flat.kind == LINE else one, M, D)
    C = (dot(q[0], q[0]), dot(q[1], q[1]), zero, dot(q[0], q[1]), zero, zero)
    (a, b, _, g, _, _), size = _scaled(near, M, C, D)
    co, si, m1, m2 = _turn(a, b, g, one, tiny)
    x, y = (one, zero, zero), (zero, one, zero)
    v1, v2 = _turned(co, si, x, y)
    swap = plane & (m1 < m2)
    (m1, m2), (v1, v2) = ((m2 if swap else m1), (m1 if swap else m2)), _in_order(swap, one, v1, v2)
    b1, b2 = _image(q, v1), _image(q, v2)
    u1, n1 = _first(b1, one, tiny)
    u1 = select(flat.kind == LINE, times(hand, x), u1)
    u2 = select(flat.kind == SHEET, times(hand, cross(z, u1)), _second(b2, u1, n1, D, tiny))
    u3, more = cross(u1, u2), one if plane else zero
    e1, s1 = _elongation(near, size * m1, dot(u1, b1), one)
    e2, s2 = _elongation(near, size * m2, dot(u2, b2), one)
    return u1, u2, u3, v1, v2, z, (s1, more * s2, zero), (e1, more * e2, zero)


@by_type(present, Flat, FORMULAS)
def _some_present(flat, D):
    zero, one = D.dtype.type(0), D.dtype.type(1)
    return one, (one if flat.kind >= SHEET else zero), zero


class CorotatedLaw(NamedTuple):
    """`Ri`, then `w lam/2` and `w mu`: `w = mu sum (s_i - 1)^2 + lam/2 (sum (s_i - 1))^2`."""

    D: Reals
    flat: Any


class InvertibleLaw(NamedTuple):
    """`Ri`, then `w lam/2` and `w mu`: St. Venant-Kirchhoff's energy, continued below the stretch `threshold`.

    With `c_i = max(s_i, threshold)`, `d = s - c`, `E_i = (c_i^2 - 1)/2` and `w_i, w_ij` the derivatives of `w0(c)
    = lam/2 (sum E_i)^2 + mu sum E_i^2`:

        w = w0(c) + sum w_i d_i + sum_i<j w_ij d_i d_j + (lam + 2 mu)/2 sum d_i^2
    """

    D: Reals
    flat: Any
    threshold: float


def answer(law: Any, at: Any, weight: Any, s: Any, e: Any) -> Any:
    """`w`, `p_i`, `H` in the order 11, 22, 33, 12, 13, 23 and the flips 12, 13, 23 for stretches `s` and `e = s - 1`."""
    return FORMULAS["answer", type(law)](law, at, weight, s, e)


@inlined
def _lame(law, at, weight):
    """`w lam` and `w mu`."""
    lam = weight * law.D[at + I(6 * LANES)]
    return lam + lam, weight * law.D[at + I(7 * LANES)]


@by_type(answer, CorotatedLaw, FORMULAS)
def _corotated(law, at, weight, s, e):
    (lam, mu), (_, y, z) = _lame(law, at, weight), present(law.flat, law.D)
    two, half = mu + mu, law.D.dtype.type(0.5)
    trace = e[0] + e[1] + e[2]
    pressure = lam * trace
    w = mu * dot(e, e) + half * pressure * trace
    p = (two * e[0] + pressure, y * (two * e[1] + pressure), z * (two * e[2] + pressure))
    return w, p, (lam + two, y * (lam + two), z * (lam + two), y * lam, z * lam, z * lam), (two, two, two)


@inlined
def _clipped(s, e, a, there):
    """`c`, `d` and `E` of a stretch, zero if it is lacking, and whether it lies above the threshold `a`."""
    one = a / a
    free = s > a
    c, x = (s if free else a), (e if free else a - one)
    return there * c, there * (s - c), there * (x + x * x / (one + one)), free


@inlined
def _flip(c, b, s, t, free, T, lam, mu, one, tiny):
    """`(p_i - p_j)/(s_i - s_j)` for `c_i, c_j` and `s_i >= s_j`: a mean of what it is above the threshold and below."""
    apart = s - t
    share = (c - b) / (apart if apart > tiny else one)
    share = one if free else share
    return share * (T + mu * (c * c + c * b + b * b - one)) + (one - share) * (lam + mu + mu - lam * b * b)


@by_type(answer, InvertibleLaw, FORMULAS)
def _invertible(law, at, weight, s, e):
    (lam, mu), (x, y, z), D = _lame(law, at, weight), present(law.flat, law.D), law.D
    one, half, a, tiny = D.dtype.type(1), D.dtype.type(0.5), D.dtype.type(law.threshold), _small(D)
    k, two = lam + mu + mu, mu + mu
    c1, d1, E1, free1 = _clipped(s[0], e[0], a, x)
    c2, d2, E2, free2 = _clipped(s[1], e[1], a, y)
    c3, d3, E3, free3 = _clipped(s[2], e[2], a, z)
    g1, g2, g3 = c1 * d1, c2 * d2, c3 * d3
    trace, G = E1 + E2 + E3, g1 + g2 + g3
    bend = lam * trace
    w = half * (bend * trace + k * (d1 * d1 + d2 * d2 + d3 * d3)) + mu * (E1 * E1 + E2 * E2 + E3 * E3)
    w += bend * G + two * (E1 * g1 + E2 * g2 + E3 * g3) + lam * (g1 * g2 + g1 * g3 + g2 * g3)
    T = lam * (trace + G)
    p1 = c1 * (T - lam * g1 + two * E1) + k * d1
    p2 = c2 * (T - lam * g2 + two * E2) + k * d2
    p3 = c3 * (T - lam * g3 + two * E3) + k * d3
    H11 = T + two * E1 + k * c1 * c1 if free1 else k
    H22 = T + two * E2 + k * c2 * c2 if free2 else k
    H33 = T + two * E3 + k * c3 * c3 if free3 else k
    flips = (
        _flip(c1, c2, s[0], s[1], free2, T, lam, mu, one, tiny),
        _flip(c1, c3, s[0], s[2], free3, T, lam, mu, one, tiny),
        _flip(c2, c3, s[1], s[2], free3, T, lam, mu, one, tiny),
    )
    return w, (p1, p2, p3), (H11, y * H22, z * H33, lam * c1 * c2, lam * c1 * c3, lam * c2 * c3), flips


@inlined
def _twist(p, r, s, t, least):
    """Return `(p_i + p_j)/(s_i + s_j)`, or 0 where the sum of stretches is round-off.

    The energy is a cone around such states. The decomposition chooses one side of it, which is straight.
    """
    both = s + t
    return (p + r) / both if both > least else least - least


@by_type(numbers_in, CorotatedLaw, FORMULAS)
@by_type(numbers_in, InvertibleLaw, FORMULAS)
def _numbers_of_an_isotropic_law(law):
    return 8


@by_type(numbers_kept, CorotatedLaw, FORMULAS)
@by_type(numbers_kept, InvertibleLaw, FORMULAS)
def _numbers_of_a_decomposition(law):
    return 30


@by_type(respond, CorotatedLaw, FORMULAS)
@by_type(respond, InvertibleLaw, FORMULAS)
def _stretches_pull(law, at, weight, Q, h, q):
    """Kept are `U`, `V`, `H`, the flips 12, 13, 23 and the twists."""
    D = law.D
    M = strain(h[0], h[1], h[2], Q[0], Q[1], Q[2], q[0], q[1], q[2])
    u1, u2, u3, v1, v2, v3, s, e = decompose(law.flat, D, Q, q, M)
    w, p, H, (f12, f13, f23) = answer(law, at, weight, s, e)
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
    """A number times the factor of its sign."""
    a, b = positive * x, negative * x
    return a if x > 0 else b


@by_type(weigh, CorotatedLaw, FORMULAS)
@by_type(weigh, InvertibleLaw, FORMULAS)
def _weigh_stretches(law, points, kept, positive, negative):
    """Twists by their signs; what else is negative, in `H` and the flips, by the second factor. Without twists K is warped."""
    D = law.D
    one, plus, minus, (_, y, z) = D.dtype.type(1), D.dtype.type(positive), D.dtype.type(negative), present(law.flat, D)
    for i in range(LANES):
        lane = I(i)
        H = six(kept, lane + I(18 * LANES))
        size = abs(H[0]) + abs(H[1]) + abs(H[2]) + abs(H[3]) + abs(H[4]) + abs(H[5]) + _small(D)
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
        f, t = vector(kept, lane + I(24 * LANES)), vector(kept, lane + I(27 * LANES))
        t = (_part(t[0], plus, minus), _part(t[1], plus, minus), _part(t[2], plus, minus))
        f = (_part(f[0], one, minus), _part(f[1], one, minus), _part(f[2], one, minus))
        f = ((f[0] if y > 0 else t[0]), (f[1] if z > 0 else t[1]), (f[2] if z > 0 else t[2]))
        put(H, kept, lane + I(18 * LANES))
        put(f, kept, lane + I(24 * LANES))
        put(t, kept, lane + I(27 * LANES))


@inlined
def _products(x, y):
    """`x_i y_j`, row by row."""
    return (
        (x[0] * y[0], x[0] * y[1], x[0] * y[2]),
        (x[1] * y[0], x[1] * y[1], x[1] * y[2]),
        (x[2] * y[0], x[2] * y[1], x[2] * y[2]),
    )


@inlined
def _in_axes(H, alpha, beta, x, y):
    """`G` for the rows `x = z_a` and `y = z_b`, row by row."""
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
    """The rows of `U G U'`, as functions of its columns: `sum_ij u_i G_ij u_j'`."""
    a = combination(G[0][0], u[0], G[0][1], u[1], G[0][2], u[2])
    b = combination(G[1][0], u[0], G[1][1], u[1], G[1][2], u[2])
    c = combination(G[2][0], u[0], G[2][1], u[1], G[2][2], u[2])
    return a, b, c


@inlined
def _nine(u, G):
    """`U G U'`, row by row."""
    a, b, c = _in_space(u, G)
    return (
        *combination(u[0][0], a, u[1][0], b, u[2][0], c),
        *combination(u[0][1], a, u[1][1], b, u[2][1], c),
        *combination(u[0][2], a, u[1][2], b, u[2][2], c),
    )


@inlined
def _six_of(u, G):
    """`U G U'` of a symmetric `G`, in the order 11, 22, 33, 12, 13, 23."""
    a, b, c = _in_space(u, G)
    return (
        u[0][0] * a[0] + u[1][0] * b[0] + u[2][0] * c[0],
        u[0][1] * a[1] + u[1][1] * b[1] + u[2][1] * c[1],
        u[0][2] * a[2] + u[1][2] * b[2] + u[2][2] * c[2],
        u[0][0] * a[1] + u[1][0] * b[1] + u[2][0] * c[1],
        u[0][0] * a[2] + u[1][0] * b[2] + u[2][0] * c[2],
        u[0][1] * a[2] + u[1][1] * b[2] + u[2][1] * c[2],
    )


@by_type(spoke_stiffness, CorotatedLaw, FORMULAS)
@by_type(spoke_stiffness, InvertibleLaw, FORMULAS)
def _stiffness_of_stretches(law, at, weight, R, kept, lane):
    half = law.D.dtype.type(0.5)
    u, (v1, v2, v3) = vectors(kept, lane), vectors(kept, lane + I(9 * LANES))
    H = six(kept, lane + I(18 * LANES))
    f, t = vector(kept, lane + I(24 * LANES)), vector(kept, lane + I(27 * LANES))
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


class WarpedLaw(NamedTuple):
    """St. Venant-Kirchhoff's law `of`, whose tangent is K(0) turned by the rotation nearest to F: the frame at rest, turned, in the
    place of that now, and no stress.
    """

    D: Reals
    of: Any
    flat: Any


@by_type(numbers_in, WarpedLaw, FORMULAS)
def _numbers_of_the_law_that_is_warped(law):
    return numbers_in(law.of)


@by_type(respond, WarpedLaw, FORMULAS)
def _pull_and_turn(law, at, weight, Q, h, q):
    D = law.D
    energy, _, s1, s2, s3 = respond(law.of, at, weight, Q, h, q)
    M = strain(h[0], h[1], h[2], Q[0], Q[1], Q[2], q[0], q[1], q[2])
    u1, u2, u3, v1, v2, v3, _, _ = decompose(law.flat, D, Q, q, M)
    _, y, z = present(law.flat, D)
    r1 = combination(v1[0], u1, v2[0], u2, v3[0], u3)
    r2 = times(y, combination(v1[1], u1, v2[1], u2, v3[1], u3))
    r3 = times(z, combination(v1[2], u1, v2[2], u2, v3[2], u3))
    o = D.dtype.type(0)
    return energy, (*r1, *r2, *r3, *(o, o, o, o, o, o)), s1, s2, s3


@by_type(spoke_stiffness, WarpedLaw, FORMULAS)
def _turned_stiffness(law, at, weight, R, kept, lane):
    return spoke_stiffness(law.of, at, weight, R, kept, lane)


class FramedLaw(NamedTuple):
    """`Ri`, `w lam/2`, `w mu`, and nine numbers of a rotation `R`: linear elasticity in a frame that is given, `r_j = R Q_j`.

    M_ij = r_i . q_j + q_i . r_j - 2 d_ij        s_j = sum_k S_jk r_k
    """

    D: Reals


@by_type(numbers_in, FramedLaw, FORMULAS)
def _numbers_with_a_rotation(law):
    return 17


@by_type(numbers_kept, WarpedLaw, FORMULAS)
@by_type(numbers_kept, FramedLaw, FORMULAS)
def _numbers_of_a_turned_frame(law):
    return 15


@by_type(weigh, WarpedLaw, FORMULAS)
@by_type(weigh, FramedLaw, FORMULAS)
def _weigh_nothing(law, points, kept, positive, negative):
    """There is no tension in it."""


@inlined
def _turned_by(R, v):
    return dot(R[0], v), dot(R[1], v), dot(R[2], v)


@by_type(respond, FramedLaw, FORMULAS)
def _pull_in_a_given_frame(law, at, weight, Q, h, q):
    D = law.D
    # row by row in the numbers, which stand apart as vectors do
    R = vectors(D, at + I(8 * LANES))
    r1, r2, r3 = _turned_by(R, Q[0]), _turned_by(R, Q[1]), _turned_by(R, Q[2])
    minus = D.dtype.type(-1)
    g1, g2, g3 = add(r1, times(minus, Q[0])), add(r2, times(minus, Q[1])), add(r3, times(minus, Q[2]))
    # without cancellation where R is hardly a turn: r_i . h_j + h_i . r_j + g_i . Q_j + g_j . Q_i
    M = (
        dot(r1, h[0]) + dot(h[0], r1) + dot(g1, Q[0]) + dot(Q[0], g1),
        dot(r2, h[1]) + dot(h[1], r2) + dot(g2, Q[1]) + dot(Q[1], g2),
        dot(r3, h[2]) + dot(h[2], r3) + dot(g3, Q[2]) + dot(Q[2], g3),
        dot(r1, h[1]) + dot(h[0], r2) + dot(g1, Q[1]) + dot(Q[0], g2),
        dot(r1, h[2]) + dot(h[0], r3) + dot(g1, Q[2]) + dot(Q[0], g3),
        dot(r2, h[2]) + dot(h[1], r3) + dot(g2, Q[2]) + dot(Q[1], g3),
    )
    S = stress(IsotropicLaw(D), at, weight, M)
    s1, s2, s3 = pulled(S, r1, r2, r3)
    o = D.dtype.type(0)
    return contracted(S, M), (*r1, *r2, *r3, *(o, o, o, o, o, o)), s1, s2, s3


@by_type(spoke_stiffness, FramedLaw, FORMULAS)
def _stiffness_in_a_given_frame(law, at, weight, R, kept, lane):
    return spoke_stiffness(IsotropicLaw(law.D), at, weight, R, kept, lane)
