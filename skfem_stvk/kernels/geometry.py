"""Measures of simplices from their spokes `P_i = X_i - X_0`, one at a time."""

from __future__ import annotations

import numpy as np

from .compiled import Ids, Reals, inlined, kernel
from .lanes import cross, dot


@inlined
def _spoke(p, a, b):
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
    """`k!` times the volume, the longest edge, and `(k - 1)!` times the largest facet (of a segment 1), as (3, nt)."""
    k, nt = len(t) - 1, t.shape[1]
    out = np.empty((3, nt))
    for e in range(nt):
        a = _spoke(p, t[0, e], t[1, e])
        if k == 1:
            out[0, e], out[1, e], out[2, e] = _norm(a), _norm(a), 1.0
            continue
        b = _spoke(p, t[0, e], t[2, e])
        n, ab = cross(a, b), _difference(b, a)
        longest = max(_norm(a), _norm(b), _norm(ab))
        if k == 2:
            out[0, e], out[1, e], out[2, e] = _norm(n), longest, longest
            continue
        c = _spoke(p, t[0, e], t[3, e])
        ac = _difference(c, a)
        out[0, e] = abs(dot(n, c))
        out[1, e] = max(longest, _norm(c), _norm(ac), _norm(_difference(c, b)))
        out[2, e] = max(_norm(n), _norm(cross(b, c)), _norm(cross(c, a)), _norm(cross(ab, ac)))
    return out


@kernel
def scaled_gram(p: Reals, t: Ids, mu: Reals) -> Reals:
    """`sqrt(V mu) g_i . g_j` (6, nt) of the gradients of vertices 1, 2, 3 in the order 11, 22, 33, 12, 13, 23, else zero."""
    k, nt = len(t) - 1, t.shape[1]
    out = np.zeros((6, nt))
    for e in range(nt):
        a = _spoke(p, t[0, e], t[1, e])
        if k == 1:
            length = _norm(a)
            out[0, e] = np.sqrt(length * mu[e]) / (length * length)
            continue
        b = _spoke(p, t[0, e], t[2, e])
        n = cross(a, b)
        if k == 2:
            area = _norm(n)
            scale = np.sqrt(area / 2 * mu[e]) / (area * area)
            out[0, e], out[1, e], out[3, e] = scale * dot(b, b), scale * dot(a, a), -scale * dot(a, b)
            continue
        c = _spoke(p, t[0, e], t[3, e])
        x, y = cross(b, c), cross(c, a)  # g_1, g_2, g_3 = x, y, n over the determinant
        determinant = abs(dot(n, c))
        scale = np.sqrt(determinant / 6 * mu[e]) / (determinant * determinant)
        out[0, e], out[1, e], out[2, e] = scale * dot(x, x), scale * dot(y, y), scale * dot(n, n)
        out[3, e], out[4, e], out[5, e] = scale * dot(x, y), scale * dot(x, n), scale * dot(y, n)
    return out
