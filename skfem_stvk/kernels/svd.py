"""Singular value decomposition of deformation gradients, with a sign.

With `q_j = F e_j` in the frame at rest `Q`, the decomposition is `F = U diag(s) V'`. `V` is a rotation, and `U` a frame with the
orientation of `Q`. Therefore `U V' Q'` is a rotation in space also where F is singular or mirrored. The smallest singular value has
the sign of det F.

    M V = V diag(m)         `M = F'F - I` near rest, `F'F` elsewhere; Jacobi's method, a fixed number of rotations without branches
    s_i - 1 = m_i/(1 + sqrt(1 + m_i))        near rest, without cancellation; elsewhere `s_i = u_i . F v_i`
    u_1, u_2        F v_1, F v_2 made orthonormal, or any such vectors where those vanish; `u_3 = u_1 x u_2`, oriented as the frame

Elements of fewer dimensions have no stress along the missing axes, and the stretch there is set to zero. In a plane or on a line,
which have two sides, stretches have a sign. For membranes and cables in space they have none.

Source: Irving, Teran, Fedkiw (2004) for the sign.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .compiled import by_type, inlined
from .lanes import add, cross, dot, times
from .laws import FORMULAS, combination

#: Kinds of elements of fewer than three dimensions: segments on a line, other segments, triangles in a plane, triangles in space.
LINE, CABLE, SHEET, MEMBRANE = 0, 1, 2, 3


class Flat(NamedTuple):
    """Kind of elements of fewer than three dimensions: `LINE`, `CABLE`, `SHEET` or `MEMBRANE`."""

    kind: int


def decompose(flat: Any, D: Any, Q: Any, q: Any, M: Any) -> Any:
    """Return `u_1, u_2, u_3`, `v_1, v_2, v_3`, the stretches `s` and `s - 1`; `flat` is None for solids, otherwise a `Flat`."""
    return FORMULAS["decompose", type(flat)](flat, D, Q, q, M)


def present(flat: Any, D: Any) -> Any:
    """Return 1 for each of the three stretches that exists, and 0 for each that is lacking."""
    return FORMULAS["present", type(flat)](flat, D)


@inlined
def select(condition, a, b):
    """Return the vector `a` or `b`, without a branch."""
    return (a[0] if condition else b[0]), (a[1] if condition else b[1]), (a[2] if condition else b[2])


@inlined
def small(D):
    """Return a number that is negligible compared with 1, and whose square does not underflow."""
    return D.dtype.type(1e-18) if D.dtype.type(1e-60) == 0 else D.dtype.type(1e-150)


@inlined
def _rotation(a, b, g, one, tiny):
    """Return cosine and sine of the smaller rotation that makes `a, g; g, b` diagonal, and the resulting diagonal."""
    d, twice = b - a, g + g
    h = np.sqrt(d * d + twice * twice)
    x = abs(d) + h + tiny
    r = one / np.sqrt(x * x + twice * twice)
    half = one / (one + one)
    mean, apart = half * (a + b), half * (h if d >= 0 else -h)
    return x * r, (twice if d >= 0 else -twice) * r, mean - apart, mean + apart


@inlined
def _rotated(c, s, x, y):
    """Return `c x - s y` and `s x + c y` for vectors."""
    return (
        (c * x[0] - s * y[0], c * x[1] - s * y[1], c * x[2] - s * y[2]),
        (s * x[0] + c * y[0], s * x[1] + c * y[1], s * x[2] + c * y[2]),
    )


@inlined
def _sweep(A, v1, v2, v3, one, tiny):
    """Apply three rotations of Jacobi's method to `A` in the order 11, 22, 33, 12, 13, 23."""
    a, b, c, d, e, f = A
    co, si, a, b = _rotation(a, b, d, one, tiny)
    e, f = co * e - si * f, si * e + co * f
    v1, v2 = _rotated(co, si, v1, v2)
    co, si, a, c = _rotation(a, c, e, one, tiny)
    d, f = -si * f, co * f
    v1, v3 = _rotated(co, si, v1, v3)
    co, si, b, c = _rotation(b, c, f, one, tiny)
    d, e = co * d, si * d
    v2, v3 = _rotated(co, si, v2, v3)
    return (a, b, c, d, e, a - a), v1, v2, v3


@inlined
def eigen(A, D):
    """Return eigenvalues and eigenvectors of a symmetric matrix in the order 11, 22, 33, 12, 13, 23 with entries of order 1.

    The eigenvectors are the columns of a rotation. After four sweeps of Jacobi's method the off-diagonal entries are zero up to
    round-off.
    """
    zero, one, tiny = D.dtype.type(0), D.dtype.type(1), small(D)
    a, b, c, d, e, f = A
    p, q, a, b = _rotation(a, b, d, one, tiny)
    e, f = p * e - q * f, q * e + p * f
    r, s, a, c = _rotation(a, c, e, one, tiny)
    d, f = -s * f, r * f
    v1, v2, v3 = (r * p, -r * q, -s), (q, p, zero), (s * p, -s * q, r)
    p, q, b, c = _rotation(b, c, f, one, tiny)
    A = (a, b, c, p * d, q * d, zero)
    v2, v3 = _rotated(p, q, v2, v3)
    A, v1, v2, v3 = _sweep(A, v1, v2, v3, one, tiny)
    A, v1, v2, v3 = _sweep(A, v1, v2, v3, one, tiny)
    A, v1, v2, v3 = _sweep(A, v1, v2, v3, one, tiny)
    return (A[0], A[1], A[2]), v1, v2, v3


@inlined
def _exchanged(swap, one, v, w):
    """Return `v, w`, or `w, -v` if `swap`, which has the same orientation."""
    return select(swap, w, v), select(swap, times(-one, v), w)


@inlined
def _image(q, v):
    """Return `F v` for a vector in the frame."""
    return combination(v[0], q[0], v[1], q[1], v[2], q[2])


@inlined
def _first(b, one, tiny):
    """Return the direction of a vector, or the first axis if the vector is zero; and the square of its length."""
    n = dot(b, b)
    there = n > tiny
    r = one / np.sqrt(n if there else one)
    return select(there, times(r, b), (one, one - one, one - one)), n


@inlined
def _second(b, u1, n1, D, tiny):
    """Return the direction of the component of `b` normal to `u1`, or any direction normal to `u1` if that component is negligible.

    The component is compared with `n1`, the squared length of a vector along `u1`.
    """
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
    """Return `M` near rest, otherwise `C`, scaled so that its entries are of order 1; and the inverse of the scale."""
    a, b, c, d, e, f = (
        (M[0] if near else C[0]),
        (M[1] if near else C[1]),
        (M[2] if near else C[2]),
        (M[3] if near else C[3]),
        (M[4] if near else C[4]),
        (M[5] if near else C[5]),
    )
    size = abs(a) + abs(b) + abs(c) + abs(d) + abs(e) + abs(f) + small(D)
    r = D.dtype.type(1) / size
    return (r * a, r * b, r * c, r * d, r * e, r * f), size


@inlined
def _is_near(volume, M, D):
    """Return whether all stretches are close to 1: the strain is small, and F is not mirrored."""
    return (volume > 0) & (abs(M[0]) + abs(M[1]) + abs(M[2]) + abs(M[3]) + abs(M[4]) + abs(M[5]) < D.dtype.type(0.3))


@inlined
def _elongation(near, m, s, one):
    """Return `s - 1` and `s`, near rest from `m = s^2 - 1`, and elsewhere from `s`."""
    m = m if near else one - one
    small, large = m / (one + np.sqrt(one + m)), s - one
    e = small if near else large
    return e, (one + e if near else s)


@by_type(decompose, type(None), FORMULAS)
def _decompose_solid(flat, D, Q, q, M):
    zero, one, tiny = D.dtype.type(0), D.dtype.type(1), small(D)
    orientation = one if dot(Q[0], cross(Q[1], Q[2])) > 0 else -one
    near = _is_near(orientation * dot(q[0], cross(q[1], q[2])), M, D)
    C = (dot(q[0], q[0]), dot(q[1], q[1]), dot(q[2], q[2]), dot(q[0], q[1]), dot(q[0], q[2]), dot(q[1], q[2]))
    A, size = _scaled(near, M, C, D)
    (m1, m2, m3), v1, v2, v3 = eigen(A, D)
    swap = m1 < m2
    (m1, m2), (v1, v2) = ((m2 if swap else m1), (m1 if swap else m2)), _exchanged(swap, one, v1, v2)
    swap = m2 < m3
    (m2, m3), (v2, v3) = ((m3 if swap else m2), (m2 if swap else m3)), _exchanged(swap, one, v2, v3)
    swap = m1 < m2
    (m1, m2), (v1, v2) = ((m2 if swap else m1), (m1 if swap else m2)), _exchanged(swap, one, v1, v2)
    b1, b2, b3 = _image(q, v1), _image(q, v2), _image(q, v3)
    # where two stretches are much smaller than the first, their difference is lost in C, but not in the vectors
    n2, n3 = dot(b2, b2), dot(b3, b3)
    lost = n2 < D.dtype.type(0.01) * dot(b1, b1)
    r = one / (n2 + n3 + tiny)
    co, si, n2, n3 = _rotation(r * n2, r * n3, r * dot(b2, b3), one, tiny)
    co, si = (co if lost else one), (si if lost else zero)
    v2, v3 = _rotated(co, si, v2, v3)
    b2, b3 = _rotated(co, si, b2, b3)
    swap = lost & (n2 < n3)
    (v2, v3), (b2, b3) = _exchanged(swap, one, v2, v3), _exchanged(swap, one, b2, b3)
    u1, n1 = _first(b1, one, tiny)
    u2 = _second(b2, u1, n1, D, tiny)
    u3 = times(orientation, cross(u1, u2))
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
    zero, one, tiny = D.dtype.type(0), D.dtype.type(1), small(D)
    plane, z = flat.kind >= SHEET, (zero, zero, one)
    orientation = one if (dot(cross(Q[0], Q[1]), z) if plane else Q[0][0]) > 0 else -one
    side = dot(cross(q[0], q[1]), z) if flat.kind == SHEET else q[0][0]
    near = _is_near(orientation * side if flat.kind == SHEET or flat.kind == LINE else one, M, D)
    C = (dot(q[0], q[0]), dot(q[1], q[1]), zero, dot(q[0], q[1]), zero, zero)
    (a, b, _, g, _, _), size = _scaled(near, M, C, D)
    co, si, m1, m2 = _rotation(a, b, g, one, tiny)
    x, y = (one, zero, zero), (zero, one, zero)
    v1, v2 = _rotated(co, si, x, y)
    swap = plane & (m1 < m2)
    (m1, m2), (v1, v2) = ((m2 if swap else m1), (m1 if swap else m2)), _exchanged(swap, one, v1, v2)
    b1, b2 = _image(q, v1), _image(q, v2)
    u1, n1 = _first(b1, one, tiny)
    u1 = select(flat.kind == LINE, times(orientation, x), u1)
    u2 = select(flat.kind == SHEET, times(orientation, cross(z, u1)), _second(b2, u1, n1, D, tiny))
    u3, more = cross(u1, u2), one if plane else zero
    e1, s1 = _elongation(near, size * m1, dot(u1, b1), one)
    e2, s2 = _elongation(near, size * m2, dot(u2, b2), one)
    return u1, u2, u3, v1, v2, z, (s1, more * s2, zero), (e1, more * e2, zero)


@by_type(present, Flat, FORMULAS)
def _some_present(flat, D):
    zero, one = D.dtype.type(0), D.dtype.type(1)
    return one, (one if flat.kind >= SHEET else zero), zero
