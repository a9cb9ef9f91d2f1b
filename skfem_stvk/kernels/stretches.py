"""Smallest principal stretch of elements, a measure of their compression; of several points of an element the smallest counts.

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
    cross,
    dot,
    find_base_vectors,
    gather_both,
    nodal_zeros,
    point_count,
    point_vectors,
    times,
    vectors,
)


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
