"""Shape of deformed elements: signed volume ratios, the step length at which an element inverts, and the smallest stretches.

Ratios are negative for inverted elements. A linear simplex has one ratio of deformed volume to volume at rest. Other elements have
one at each point of a table, and the smallest counts. Along `u + s v` the signed volume form `C = p_1 . (p_2 x p_3)` of the base
vectors is exactly a cubic in `s`. With `p_i + s V_i` for `p_i`

    C(s) = p_1 . p_2 x p_3    +    s (V_1 . p_2 x p_3 + p_1 . V_2 x p_3 + p_1 . p_2 x V_3)
         + s^2 (p_1 . V_2 x V_3 + V_1 . p_2 x V_3 + V_1 . V_2 x p_3)    +    s^3 V_1 . V_2 x V_3

A triangle in the plane has the third base vector (0, 0, 1). A segment on the line has (0, 1, 0) and (0, 0, 1). These are constant.

The smallest principal stretch measures compression; of several points of an element the smallest counts.

With the base vectors at rest `P = Q R`, `Q` orthonormal and `R` upper triangular, and their displacements `U`:

    H = U R^-1        C = I + 2 E        2 E = Q'H + H'Q + H'H        smallest stretch s = sqrt(smallest eigenvalue of C)

`E` has no cancellation at small strain. It has three dimensions for a tetrahedron, two for a triangle, and one for a segment. The
smallest eigenvalue of C of a tetrahedron has a closed form, with the same accuracy for repeated eigenvalues:

    q = tr C/3    B = (C - q I)/p with tr B^2 = 6    r = det B/2    1 - r = |B^2 - 2 I - r B|^2 / (6 (1 + r))
    smallest eigenvalue = q - p (1 + z)              z^2 (3 + z) = 2 (1 - r), the root with 0 <= z <= 1

At rest it is bitwise 1. Its error is a few eps times the largest eigenvalue of C, or times 1 if that is larger. The error of the
stretch is a few eps times the same value divided by the stretch. If a state overflows, the stretch is 0.
"""

from __future__ import annotations

import numpy as np
from numpy import uint64

from .compiled import Ids, Reals, inlined, kernel
from .lanes import (
    LANES,
    Points,
    absolute,
    add,
    base_vectors,
    complete_base_vectors,
    cross,
    dot,
    find_base_vectors,
    gather,
    gather_both,
    gather_magnitudes,
    nodal_zeros,
    point_count,
    point_vectors,
    times,
    vectors,
)

EPS = 2.0**-52


@inlined
def _measure(a, b, c, k, d):
    """Return `k!` times the volume, area or length, signed if there are as many base vectors as components."""
    n = cross(a, b)
    if k == 3:
        return dot(n, c)
    if k == 2:
        return n[2] if d == 2 else np.sqrt(dot(n, n))
    return a[0] if d == 1 else np.sqrt(dot(a, a))


@kernel
def volume_ratios(begin: int, end: int, t: Ids, points: Points | None, X: Reals, u: Reals, k: int, d: int, out: Reals) -> float:
    """Return the smallest ratio of deformed volume to volume at rest of the blocks `begin` to `end`.

    The ratio of each element is written to `out`, unless `out` is empty.
    """
    x, y = nodal_zeros(points, X.dtype), nodal_zeros(points, X.dtype)
    P, U = point_vectors(points, x), point_vectors(points, y)
    J, least = np.empty(LANES), np.full(LANES, np.inf)
    for block in range(begin, end):
        gather_both(points, t, block, X, u, x, y)
        for point in range(point_count(points)):
            find_base_vectors(points, block, point, 1, x, P, y, U)
            for i in range(LANES):
                lane = uint64(i)
                P1, P2, P3 = vectors(P, lane)
                U1, U2, U3 = vectors(U, lane)
                now = _measure(add(P1, U1), add(P2, U2), add(P3, U3), k, d)
                ratio = now / _measure(P1, P2, P3, k, d)
                J[lane] = ratio if point == 0 else min(ratio, J[lane])
                least[lane] = min(J[lane], least[lane])
        if len(out) > 0:
            out[block * LANES : (block + 1) * LANES] = J
    return least.min()


@inlined
def _triple(a, b, c):
    """Return `a . (b x c)`."""
    return dot(a, cross(b, c))


@inlined
def _magnitude(a, b, c):
    """Return the sum of the absolute values of all terms of `a . (b x c)`."""
    return (
        abs(a[0]) * (abs(b[1] * c[2]) + abs(b[2] * c[1]))
        + abs(a[1]) * (abs(b[2] * c[0]) + abs(b[0] * c[2]))
        + abs(a[2]) * (abs(b[0] * c[1]) + abs(b[1] * c[0]))
    )


@inlined
def _value(c0, c1, c2, c3, s):
    return c0 + s * (c1 + s * (c2 + s * c3))


@kernel
def _zero_between(c0, c1, c2, c3, a, b):
    """Return the zero of a cubic between `a`, where it is positive, and `b`, where it is zero or negative.

    The method is Newton's, safeguarded by bisection.
    """
    s = (a + b) / 2
    for _ in range(200):
        value, slope = _value(c0, c1, c2, c3, s), c1 + s * (2 * c2 + 3 * s * c3)
        if value > 0:
            a = s
        else:
            b = s
        following = s - value / slope if slope < 0 else a
        if not a < following < b:
            following = a + (b - a) / 2
        if abs(following - s) <= EPS * b or not a < following < b:
            return following
        s = following
    return s


@kernel
def _first_zero(c0, c1, c2, c3, end):
    """Return the smallest positive zero before `end` of a cubic with `c0 > 0`, or `end` if there is none; `end` may be infinite.

    Between its extrema the cubic is monotone. A minimum that is zero up to round-off counts as a zero.
    """
    begin = 0.0
    # zeros of the slope c1 + 2 c2 s + 3 c3 s^2, without cancellation
    discriminant = c2 * c2 - 3 * c1 * c3
    if discriminant >= 0:
        q = -(c2 + np.copysign(np.sqrt(discriminant), c2))
        x = q / (3 * c3) if c3 != 0 else -1.0
        y = c1 / q if q != 0 else -1.0
        for extremum in (min(x, y), max(x, y)):
            if not begin < extremum < end:
                continue
            sizes = c0 + extremum * (abs(c1) + extremum * (abs(c2) + extremum * abs(c3)))
            value = _value(c0, c1, c2, c3, extremum)
            if value <= 0:
                return _zero_between(c0, c1, c2, c3, begin, extremum)
            if value <= 8 * EPS * sizes:
                return extremum
            begin = extremum
    # beyond the last extremum the cubic is monotone
    last = end
    if last == np.inf:
        leading, degree = (c3, 3) if c3 != 0 else (c2, 2) if c2 != 0 else (c1, 1)
        if leading >= 0:
            return end
        last = 0.0  # twice the bound of Fujiwara: no zero is larger
        for power, c in ((degree, c0), (degree - 1, c1), (degree - 2, c2)):
            if power > 0:
                last = max(last, 4 * (abs(c) / abs(leading)) ** (1 / power))
        last = max(last, 2 * begin)
    if _value(c0, c1, c2, c3, last) > 0:
        return end
    return _zero_between(c0, c1, c2, c3, begin, last)


@inlined
def _significant(c, size):
    """Return a coefficient, or zero if it is round-off."""
    return c if abs(c) > 8 * EPS * size else 0.0


@kernel
def _limit(p1, p2, p3, V1, V2, V3, B1, B2, B3, sign, end):
    """Return the smallest `s` before `end` at which the base vectors span no volume, or `end` if there is none.

    `B` are the magnitudes of the terms of `V`.
    """
    c1 = _triple(V1, p2, p3) + _triple(p1, V2, p3) + _triple(p1, p2, V3)
    c2 = _triple(p1, V2, V3) + _triple(V1, p2, V3) + _triple(V1, V2, p3)
    c1 = _significant(c1, _magnitude(B1, p2, p3) + _magnitude(p1, B2, p3) + _magnitude(p1, p2, B3))
    c2 = _significant(c2, _magnitude(p1, B2, B3) + _magnitude(B1, p2, B3) + _magnitude(B1, B2, p3))
    c3 = _significant(_triple(V1, V2, V3), _magnitude(B1, B2, B3))
    return _first_zero(sign * _triple(p1, p2, p3), sign * c1, sign * c2, sign * c3, end)


@kernel
def step_limit(begin: int, end: int, t: Ids, points: Points | None, X: Reals, u: Reals, v: Reals, k: int) -> float:
    """Return the smallest `s > 0` at which `J = 0` for an element of the blocks at `u + s v`, or infinity.

    Only points with `J > 0` at `u` count. The search for a zero is skipped if `C(s) >= c0 - |c1| s - |c2| s^2 - |c3| s^3 > 0` up to
    the smallest `s` so far, or if no coefficient is negative.
    """
    x, y, z, size = (
        nodal_zeros(points, X.dtype),
        nodal_zeros(points, X.dtype),
        nodal_zeros(points, X.dtype),
        nodal_zeros(points, X.dtype),
    )
    P, U, V, B = point_vectors(points, x), point_vectors(points, y), point_vectors(points, z), point_vectors(points, size)
    sizes = absolute(points)
    least, searched = np.inf, np.empty(LANES, dtype=np.bool_)
    for block in range(begin, end):
        gather_both(points, t, block, X, u, x, y)
        gather(points, t, block, v, z)
        for point in range(point_count(points)):
            find_base_vectors(points, block, point, 1, x, P, y, U)
            complete_base_vectors(k, P)
            base_vectors(points, block, point, z, V)
            s = min(least, 1e100)  # infinity times zero is not zero
            for i in range(LANES):
                lane = uint64(i)
                P1, P2, P3 = vectors(P, lane)
                U1, U2, U3 = vectors(U, lane)
                V1, V2, V3 = vectors(V, lane)
                p1, p2, p3 = add(P1, U1), add(P2, U2), add(P3, U3)
                n1, n2, n3, m1, m2, m3 = cross(p2, p3), cross(p3, p1), cross(p1, p2), cross(V2, V3), cross(V3, V1), cross(V1, V2)
                rest = _triple(P1, P2, P3)
                c0 = rest * dot(p1, n1)  # times `rest`, so that the signs are those of J and its derivatives
                c1 = rest * (dot(V1, n1) + dot(V2, n2) + dot(V3, n3))
                c2 = rest * (dot(p1, m1) + dot(p2, m2) + dot(p3, m3))
                c3 = rest * dot(V1, m1)
                bound = c0 - s * (abs(c1) + s * (abs(c2) + s * abs(c3)))
                searched[lane] = (c0 > 0) & ~(bound > 0) & (min(c1, c2, c3) < 0)
            if searched.any():
                gather_magnitudes(points, t, block, v, size)
                base_vectors(sizes, block, point, size, B)
            for i in range(LANES):
                lane = uint64(i)
                if searched[lane]:
                    P1, P2, P3 = vectors(P, lane)
                    U1, U2, U3 = vectors(U, lane)
                    V1, V2, V3 = vectors(V, lane)
                    B1, B2, B3 = vectors(B, lane)
                    sign = np.copysign(1.0, _triple(P1, P2, P3))
                    least = _limit(add(P1, U1), add(P2, U2), add(P3, U3), V1, V2, V3, B1, B2, B3, sign, least)
    return least


@inlined
def _minus(a, s, b):
    return a[0] - s * b[0], a[1] - s * b[1], a[2] - s * b[2]


@inlined
def _strain(q1, h1, q2, h2):
    """Return `q1 . h2 + h1 . q2 + h1 . h2`."""
    return dot((q1[0] + h1[0], q1[1] + h1[1], q1[2] + h1[2]), h2) + dot(h1, q2)


@inlined
def _of_segment(P1, U1):
    size = 1 / np.sqrt(dot(P1, P1))
    q1, h1 = times(size, P1), times(size, U1)
    return 1 + _strain(q1, h1, q1, h1)


@inlined
def _of_triangle(P1, P2, U1, U2):
    size, normal = 1 / np.sqrt(dot(P1, P1)), cross(P1, P2)
    q1, h1 = times(size, P1), times(size, U1)
    q2 = cross(times(1 / np.sqrt(dot(normal, normal)), normal), q1)
    h2 = times(1 / dot(q2, P2), _minus(U2, dot(q1, P2), h1))
    e11, e22, e12 = _strain(q1, h1, q1, h1), _strain(q2, h2, q2, h2), _strain(q1, h1, q2, h2)
    half = (e11 - e22) / 2
    return 1 + (e11 + e22) / 2 - np.sqrt(half * half + e12 * e12)


@inlined
def _of_tetrahedron(P1, P2, P3, U1, U2, U3):
    size, normal = 1 / np.sqrt(dot(P1, P1)), cross(P1, P2)
    q1, h1 = times(size, P1), times(size, U1)
    q3 = times(1 / np.sqrt(dot(normal, normal)), normal)
    q2 = cross(q3, q1)
    h2 = times(1 / dot(q2, P2), _minus(U2, dot(q1, P2), h1))
    h3 = times(1 / dot(q3, P3), _minus(_minus(U3, dot(q1, P3), h1), dot(q2, P3), h2))
    e11, e22, e33 = _strain(q1, h1, q1, h1), _strain(q2, h2, q2, h2), _strain(q3, h3, q3, h3)
    mean = (e11 + e22 + e33) / 3
    return (
        1
        + mean
        + _smallest_eigenvalue(
            e11 - mean, e22 - mean, e33 - mean, _strain(q1, h1, q2, h2), _strain(q1, h1, q3, h3), _strain(q2, h2, q3, h3)
        )
    )


@inlined
def _smallest_eigenvalue(a, b, c, d, e, f):
    """Return the smallest eigenvalue of a traceless matrix with the diagonal `a, b, c`, and `d, e, f` at 12, 13, 23."""
    p = np.sqrt((a * a + b * b + c * c + 2 * (d * d + e * e + f * f)) / 6)
    scale = 1 / (p + 1e-150)  # where there is no deviator, B = 0
    a, b, c, d, e, f = a * scale, b * scale, c * scale, d * scale, e * scale, f * scale
    r = (a * (b * c - f * f) - d * (d * c - e * f) + e * (d * f - b * e)) / 2
    aa, bb, cc = a * a + d * d + e * e - 2 - r * a, d * d + b * b + f * f - 2 - r * b, e * e + f * f + c * c - 2 - r * c
    dd, ee, ff = d * (a + b) + e * f - r * d, e * (a + c) + d * f - r * e, f * (b + c) + d * e - r * f
    rest = aa * aa + bb * bb + cc * cc + 2 * (dd * dd + ee * ee + ff * ff)
    t = np.sqrt(rest / (3 + 3 * r) if r > 0 else 2 - 2 * r)
    x = 0.57730059 + t * (-0.05469077 + t * (0.01086255 - 0.00142594 * t))  # z = t x, x^2 (3 + t x) = 1: to 5e-5
    for _ in range(2):
        x -= (x * x * (3 + t * x) - 1) / (3 * x * (2 + t * x))
    return -p * (1 + t * x)


@kernel
def smallest_stretches(begin: int, end: int, t: Ids, points: Points | None, X: Reals, u: Reals, k: int, out: Reals) -> float:
    """Return the smallest principal stretch of the blocks `begin` to `end`.

    The smallest stretch of each element is written to `out`, unless `out` is empty.
    """
    x, y = nodal_zeros(points, X.dtype), nodal_zeros(points, X.dtype)
    P, U = point_vectors(points, x), point_vectors(points, y)
    s, least = np.empty(LANES), np.full(LANES, np.inf)
    for block in range(begin, end):
        gather_both(points, t, block, X, u, x, y)
        for point in range(point_count(points)):
            find_base_vectors(points, block, point, 1, x, P, y, U)
            for i in range(LANES):
                lane = uint64(i)
                P1, P2, P3 = vectors(P, lane)
                U1, U2, U3 = vectors(U, lane)
                if k == 3:
                    square = _of_tetrahedron(P1, P2, P3, U1, U2, U3)
                elif k == 2:
                    square = _of_triangle(P1, P2, U1, U2)
                else:
                    square = _of_segment(P1, U1)
                stretch = np.sqrt(square if square > 0 else 0.0)
                s[lane] = stretch if point == 0 else min(stretch, s[lane])
                least[lane] = min(s[lane], least[lane])
        if len(out) > 0:
            out[block * LANES : (block + 1) * LANES] = s
    return least.min()
