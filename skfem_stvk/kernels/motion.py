"""What a time loop does at each vertex, in one pass: momenta, and steps of explicit integrators."""

from __future__ import annotations

import numpy as np

from .compiled import Ids, Reals, kernel

I = np.uint64


@kernel
def momenta(p: Reals, u: Reals, v: Reals, Mv: Reals, out: Reals) -> None:
    """`v . M v`, then `sum M v` (3), then `sum x (x) M v` about the origin, `x = X + u`, as an axial vector (3), written to `out` (7,).

    `p` (d, nv) at rest; `u`, `v`, `Mv` (nv, d). Components that the space does not have are zero.
    """
    d, n = p.shape
    square = 0.0
    q0, q1, q2 = 0.0, 0.0, 0.0
    l0, l1, l2 = 0.0, 0.0, 0.0
    for i in range(n):
        a, x, y, z, mx, my, mz = I(i), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        x, mx = p[I(0), a] + u[a, I(0)], Mv[a, I(0)]
        square += v[a, I(0)] * mx
        if d > 1:
            y, my = p[I(1), a] + u[a, I(1)], Mv[a, I(1)]
            square += v[a, I(1)] * my
        if d > 2:
            z, mz = p[I(2), a] + u[a, I(2)], Mv[a, I(2)]
            square += v[a, I(2)] * mz
        q0, q1, q2 = q0 + mx, q1 + my, q2 + mz
        l0, l1, l2 = l0 + y * mz - z * my, l1 + z * mx - x * mz, l2 + x * my - y * mx
    out[0], out[1], out[2], out[3], out[4], out[5], out[6] = square, q0, q1, q2, l0, l1, l2


@kernel
def push(inverse: Reals, force: Reals, h: float, v: Reals) -> None:
    """`v += h M^-1 force` with the lumped masses' inverses, zero where a degree of freedom is held; all (ndofs,)."""
    for i in range(len(v)):
        v[I(i)] += h * inverse[I(i)] * force[I(i)]


@kernel
def drift(is_free: Ids, v: Reals, h: float, u: Reals) -> None:
    """`u += h v` where a degree of freedom is free; all (ndofs,)."""
    for i in range(len(v)):
        if is_free[I(i)]:
            u[I(i)] += h * v[I(i)]
