"""Measures of simplices from their base vectors `P_i = X_i - X_0`, one simplex at a time."""

from __future__ import annotations

import numpy as np

from .compiled import Ids, Reals, inlined, kernel
from .lanes import cross, dot


@inlined
def _base_vector(p, a, b):
    d = len(p)
    return p[0, b] - p[0, a], p[1, b] - p[1, a] if d > 1 else 0.0, p[2, b] - p[2, a] if d > 2 else 0.0


@inlined
def _difference(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inlined
def _norm(a):
    return np.sqrt(dot(a, a))


@kernel
def measures(p: Reals, t: Ids) -> Reals:
    """Return `k!` times the volume, the longest edge, and `(k - 1)!` times the largest facet (1 for a segment), as (3, nt)."""
    k, nt = len(t) - 1, t.shape[1]
    out = np.empty((3, nt))
    for e in range(nt):
        a = _base_vector(p, t[0, e], t[1, e])
        if k == 1:
            out[0, e], out[1, e], out[2, e] = _norm(a), _norm(a), 1.0
            continue
        b = _base_vector(p, t[0, e], t[2, e])
        n, ab = cross(a, b), _difference(b, a)
        longest = max(_norm(a), _norm(b), _norm(ab))
        if k == 2:
            out[0, e], out[1, e], out[2, e] = _norm(n), longest, longest
            continue
        c = _base_vector(p, t[0, e], t[3, e])
        ac = _difference(c, a)
        out[0, e] = abs(dot(n, c))
        out[1, e] = max(longest, _norm(c), _norm(ac), _norm(_difference(c, b)))
        out[2, e] = max(_norm(n), _norm(cross(b, c)), _norm(cross(c, a)), _norm(cross(ab, ac)))
    return out


# Sums and products with their rounding errors (Dekker 1971). The height of a flat element is a small difference of large products.
# Without the rounding errors its own error would be twice that of the base vectors in the frame. Reassociation would lose the
# rounding errors, so it is switched off.


def _without_fastmath(function):
    return inlined(function, fastmath=False)


@_without_fastmath
def _product_with_error(a, b):
    """Return `a b` and its rounding error."""
    p, x, y = a * b, 134217729.0 * a, 134217729.0 * b
    a1, b1 = x - (x - a), y - (y - b)
    a2, b2 = a - a1, b - b1
    return p, ((a1 * b1 - p) + a1 * b2 + a2 * b1) + a2 * b2


@_without_fastmath
def _sum_with_error(a, b):
    """Return `a + b` and its rounding error."""
    s = a + b
    t = s - a
    return s, (a - (s - t)) + (b - t)


@_without_fastmath
def _difference_of_products(a, b, c, d):
    """Return `a b - c d` as a sum of two numbers."""
    (p, e), (q, g) = _product_with_error(a, b), _product_with_error(c, d)
    s, h = _sum_with_error(p, -q)
    return _sum_with_error(s, h + (e - g))


@_without_fastmath
def _cross_with_error(a, b):
    """Return `a x b` and its rounding error."""
    x, u = _difference_of_products(a[1], b[2], a[2], b[1])
    y, v = _difference_of_products(a[2], b[0], a[0], b[2])
    z, w = _difference_of_products(a[0], b[1], a[1], b[0])
    return (x, y, z), (u, v, w)


@_without_fastmath
def _accurate_dot(a, rest, b):
    """Return `(a + rest) . b` with a single rounding error."""
    (x, u), (y, v), (z, w) = _product_with_error(a[0], b[0]), _product_with_error(a[1], b[1]), _product_with_error(a[2], b[2])
    s, g = _sum_with_error(x, y)
    s, h = _sum_with_error(s, z)
    return s + (((u + v) + w) + (g + h) + (rest[0] * b[0] + rest[1] * b[1] + rest[2] * b[2]))


@inlined
def _put_frame(a, b, c, k, e, out):
    """Write `Ri` and the determinant of `R` for the base vectors `a, b, c` of an element of dimension `k`."""
    r11 = _norm(a)
    out[0, e] = 1 / r11
    out[6, e] = r11
    if k > 1:
        n, rest = _cross_with_error(a, b)
        area = _norm(n)
        r12, r22 = dot(a, b) / r11, area / r11
        out[1, e], out[3, e] = -r12 / area, 1 / r22
        out[6, e] = area
        if k > 2:
            # q_2 = n x a over its length; the third axis of a frame points to the side of the third base vector
            height = _accurate_dot(n, rest, c) / area
            along, across = dot(a, c) / r11, dot(cross(n, a), c) / (area * r11)
            r33 = abs(height)
            out[2, e], out[4, e], out[5, e] = (r12 / r22 * across - along) / (r11 * r33), -across / (r22 * r33), 1 / r33
            out[6, e] = area * r33


@kernel
def frames(p: Reals, t: Ids) -> Reals:
    """Return `Ri` of linear simplices and `k!` times their size, (7, nt).

    The order of `Ri` is 11, 12, 13, 22, 23, 33, with zeros for missing base vectors.
    """
    k, nt = len(t) - 1, t.shape[1]
    out = np.zeros((7, nt))
    for e in range(nt):
        a = _base_vector(p, t[0, e], t[1, e])
        b = _base_vector(p, t[0, e], t[2, e]) if k > 1 else a
        c = _base_vector(p, t[0, e], t[3, e]) if k > 2 else a
        _put_frame(a, b, c, k, e, out)
    return out


@kernel
def frames_of_base_vectors(P: Reals) -> Reals:
    """Return `Ri` and the determinant of `R`, (7, n), for base vectors `P` (n, k, 3) at points of any elements.

    The order of `Ri` is that of `frames`.
    """
    n, k = P.shape[0], P.shape[1]
    out = np.zeros((7, n))
    for e in range(n):
        a = (P[e, 0, 0], P[e, 0, 1], P[e, 0, 2])
        b = (P[e, 1, 0], P[e, 1, 1], P[e, 1, 2]) if k > 1 else a
        c = (P[e, 2, 0], P[e, 2, 1], P[e, 2, 2]) if k > 2 else a
        _put_frame(a, b, c, k, e, out)
    return out
