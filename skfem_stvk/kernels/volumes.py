"""How the volumes of simplices change, with their sign: whether one is turned inside out."""

from __future__ import annotations

import numpy as np

from .compiled import Ids, Reals, inlined, kernel
from .simplices import LANES

I = np.uint64


@inlined
def _spoke(a, at):
    return a[at], a[at + I(LANES)], a[at + I(2 * LANES)]


@inlined
def _sum(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@inlined
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def _gather(t, block, X, u, P, U):
    """Spokes of a block at rest and their displacements: stored apart, for the compiler may turn `(X_b - X_a) + (u_b - u_a)` round."""
    first = I(block * 4 * LANES)
    for lane in range(LANES):
        at = first + I(lane)
        a, b = I(3) * I(t[at]), I(3) * I(t[at + I(LANES)])
        c, d = I(3) * I(t[at + I(2 * LANES)]), I(3) * I(t[at + I(3 * LANES)])
        for i in range(3):
            x, y, to = X[a + I(i)], u[a + I(i)], I(i * LANES + lane)
            P[to], U[to] = X[b + I(i)] - x, u[b + I(i)] - y
            P[to + I(3 * LANES)], U[to + I(3 * LANES)] = X[c + I(i)] - x, u[c + I(i)] - y
            P[to + I(6 * LANES)], U[to + I(6 * LANES)] = X[d + I(i)] - x, u[d + I(i)] - y


@inlined
def _measure(a, b, c, k, d):
    """`k!` times the volume, area or length, signed where there are as many spokes as components."""
    n = _cross(a, b)
    if k == 3:
        return _dot(n, c)
    if k == 2:
        return n[2] if d == 2 else np.sqrt(_dot(n, n))
    return a[0] if d == 1 else np.sqrt(_dot(a, a))


@kernel
def volume_ratios(begin: int, end: int, t: Ids, X: Reals, u: Reals, k: int, d: int, out: Reals) -> float:
    """The smallest ratio of volumes, now to at rest, of the blocks `begin` to `end`; all of them in `out`, unless that is empty."""
    P, U, J, least = np.empty(9 * LANES), np.empty(9 * LANES), np.empty(LANES), np.full(LANES, np.inf)
    for block in range(begin, end):
        _gather(t, block, X, u, P, U)
        for i in range(LANES):
            lane = I(i)
            P1, P2, P3 = _spoke(P, lane), _spoke(P, lane + I(3 * LANES)), _spoke(P, lane + I(6 * LANES))
            U1, U2, U3 = _spoke(U, lane), _spoke(U, lane + I(3 * LANES)), _spoke(U, lane + I(6 * LANES))
            now = _measure(_sum(P1, U1), _sum(P2, U2), _sum(P3, U3), k, d)
            J[lane] = now / _measure(P1, P2, P3, k, d)
            least[lane] = min(J[lane], least[lane])
        if len(out) > 0:
            out[block * LANES : (block + 1) * LANES] = J
    return least.min()
