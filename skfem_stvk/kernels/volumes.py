"""Signed volume ratios of elements, which are negative for inverted elements, and the step length at which an element inverts.

A linear simplex has one ratio of deformed volume to volume at rest. Other elements have one at each point of a table, and the
smallest counts. Along `u + s v` the signed volume form `C = p_1 . (p_2 x p_3)` of the base vectors is exactly a cubic in `s`. With
`p_i + s V_i` for `p_i`

    C(s) = p_1 . p_2 x p_3    +    s (V_1 . p_2 x p_3 + p_1 . V_2 x p_3 + p_1 . p_2 x V_3)
         + s^2 (p_1 . V_2 x V_3 + V_1 . p_2 x V_3 + V_1 . V_2 x p_3)    +    s^3 V_1 . V_2 x V_3

A triangle in the plane has the third base vector (0, 0, 1). A segment on the line has (0, 1, 0) and (0, 0, 1). These are constant.
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
