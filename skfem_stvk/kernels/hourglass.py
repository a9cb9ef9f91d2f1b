"""Hourglass stiffness of boxes with one point: it resists the displacements that have no mean gradient.

With the signs `h_ka = +-1` of an hourglass mode at the nodes, products of two or three of the reference coordinates' signs:

    gamma_ka = h_ka - sum_i (sum_b h_kb X_b)_i g_ai        gamma_k' X = 0: r_k = gamma_k' u is zero for affine displacements
    W_h = c sum_k |r_k|^2        F_a = 2 c sum_k gamma_ka r_k        K_ab = 2 c sum_k gamma_ka gamma_kb I

W_h is quadratic, and invariant under rotations, because the modes are those of the rest shape. The `gamma_ka` are not stored.
Instead, `r_k = h_k' u - (h_k' X)_i U_i` with `U_i` the displacements of the base vectors. Therefore the force of a mode acts on
nodes and on base vectors.

A mode is a spring with rest length zero. `|r_k|^2` is its squared elongation, and `2 c` its constant tension. The mean tensions of
two states act along the mean of their `r_k`. Their work is then the difference of the energies, and their total torque is zero. The
rate of tension is zero, so damping by rates of tension does not act. K without tensions does not contain the modes. A force along
the change of `r_k` would exert a torque on the body.

Source: Flanagan, Belytschko (1981), who also use signs +-1; Joldes, Wittek, Miller (2008), in total Lagrangian form. The TLED
program NiftySim has the same factor `c`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .compiled import by_type, kernel
from .lanes import ELEMENT, LANES, I, MeanPoints, Points


def resist(points: Any, block: Any, x: Any, y: Any, U: Any, factor: Any, forces: Any, total: Any) -> Any:
    """Add `factor` times the hourglass forces of displacements to base vectors and to nodes, and return four times the energy.

    `x`, `y` are the nodal differences from `gather` at rest and of displacements; `U` are the displacements of the base vectors.
    """
    return ELEMENT["resist", type(points)](points, block, x, y, U, factor, forces, total)


def resistance_along(points: Any, block: Any, x: Any, y: Any, U: Any, z: Any, V: Any) -> Any:
    """Return `4 c sum r_k . r_k`, `4 c sum r_k . s_k` and `4 c sum s_k . s_k` of a block.

    `r` are the modes of the displacements `y`, and `s` those of `z`.
    """
    return ELEMENT["resistance_along", type(points)](points, block, x, y, U, z, V)


def add_sizes_of_resistance(points: Any, block: Any, x: Any, z: Any, U: Any, forces: Any, total: Any) -> None:
    """Add the absolute values of the terms of the hourglass forces, for magnitudes `z` of displacements and `U` of base vectors."""
    ELEMENT["add_sizes_of_resistance", type(points)](points, block, x, z, U, forces, total)


@by_type(resist, type(None), ELEMENT)
def _simplices_resist(points, block, x, y, U, factor, forces, total):
    return 0


@by_type(resist, Points, ELEMENT)
def _tables_resist(points, block, x, y, U, factor, forces, total):
    return 0


@by_type(resistance_along, type(None), ELEMENT)
def _simplices_along(points, block, x, y, U, z, V):
    return 0, 0, 0


@by_type(resistance_along, Points, ELEMENT)
def _tables_along(points, block, x, y, U, z, V):
    return 0, 0, 0


@by_type(add_sizes_of_resistance, type(None), ELEMENT)
def _simplices_sizes(points, block, x, z, U, forces, total):
    pass


@by_type(add_sizes_of_resistance, Points, ELEMENT)
def _tables_sizes(points, block, x, z, U, forces, total):
    pass


@kernel
def _sums(modes, k, x, out):
    """Write `sum_a h_ka x_a` (3 LANES,) of a mode."""
    out[:] = 0
    for group in range(modes.shape[1] // 3):
        h1, h2, h3 = modes[k, 3 * group], modes[k, 3 * group + 1], modes[k, 3 * group + 2]
        first = I(9 * group * LANES)
        for i in range(3 * LANES):
            at = first + I(i)
            out[I(i)] += h1 * x[at] + h2 * x[at + I(3 * LANES)] + h3 * x[at + I(6 * LANES)]


@kernel
def _amplitude(points, k, x, y, U, shape, r):
    """Write `h_k' X` (3 LANES,) of a mode, and its `r_k`."""
    _sums(points.modes, k, x, shape)
    _sums(points.modes, k, y, r)
    for c in range(3):
        for i in range(LANES):
            lane = I(i)
            at = I(c * LANES) + lane
            along = (
                shape[lane] * U[at]
                + shape[lane + I(LANES)] * U[at + I(3 * LANES)]
                + shape[lane + I(2 * LANES)] * U[at + I(6 * LANES)]
            )
            r[at] -= along


@by_type(resist, MeanPoints, ELEMENT)
def _means_resist(points, block, x, y, U, factor, forces, total):
    shape, r = np.empty(3 * LANES, x.dtype), np.empty(3 * LANES, x.dtype)
    four = x.dtype.type(0)
    both = x.dtype.type(2 * factor)
    for k in range(len(points.modes)):
        _amplitude(points, k, x, y, U, shape, r)
        for c in range(3):
            for i in range(LANES):
                at = I(c * LANES + i)
                resistance = points.resistance[block, I(i)]
                four += 4 * resistance * r[at] * r[at]
                r[at] *= both * resistance
        for group in range(points.modes.shape[1] // 3):
            h1, h2, h3 = points.modes[k, 3 * group], points.modes[k, 3 * group + 1], points.modes[k, 3 * group + 2]
            first = I(9 * group * LANES)
            for i in range(3 * LANES):
                at, ri = first + I(i), r[I(i)]
                total[at] += h1 * ri
                total[at + I(3 * LANES)] += h2 * ri
                total[at + I(6 * LANES)] += h3 * ri
        for j in range(3):
            for c in range(3):
                for i in range(LANES):
                    forces[I((3 * j + c) * LANES + i)] -= shape[I(j * LANES + i)] * r[I(c * LANES + i)]
    return four


@by_type(resistance_along, MeanPoints, ELEMENT)
def _means_along(points, block, x, y, U, z, V):
    shape, r, s = np.empty(3 * LANES, x.dtype), np.empty(3 * LANES, x.dtype), np.empty(3 * LANES, x.dtype)
    zero = x.dtype.type(0)
    rr, rs, ss = zero, zero, zero
    for k in range(len(points.modes)):
        _amplitude(points, k, x, y, U, shape, r)
        _amplitude(points, k, x, z, V, shape, s)
        for c in range(3):
            for i in range(LANES):
                at = I(c * LANES + i)
                resistance = 4 * points.resistance[block, I(i)]
                rr += resistance * r[at] * r[at]
                rs += resistance * r[at] * s[at]
                ss += resistance * s[at] * s[at]
    return rr, rs, ss


@by_type(add_sizes_of_resistance, MeanPoints, ELEMENT)
def _means_sizes(points, block, x, z, U, forces, total):
    shape, r = np.empty(3 * LANES, x.dtype), np.empty(3 * LANES, x.dtype)
    for k in range(len(points.modes)):
        _sums(points.modes, k, x, shape)
        _sums(np.abs(points.modes), k, z, r)
        for c in range(3):
            for i in range(LANES):
                lane = I(i)
                at = I(c * LANES) + lane
                along = (
                    abs(shape[lane]) * U[at]
                    + abs(shape[lane + I(LANES)]) * U[at + I(3 * LANES)]
                    + abs(shape[lane + I(2 * LANES)]) * U[at + I(6 * LANES)]
                )
                r[at] = 2 * points.resistance[block, lane] * (r[at] + along)
        for a in range(points.modes.shape[1]):
            h = abs(points.modes[k, a])
            for i in range(3 * LANES):
                total[I(3 * a * LANES + i)] += h * r[I(i)]
        for j in range(3):
            for c in range(3):
                for i in range(LANES):
                    forces[I((3 * j + c) * LANES + i)] += abs(shape[I(j * LANES + i)]) * r[I(c * LANES + i)]


@kernel
def put_pairs_of_means(points, block, nodes, K, x, kept, T, out):
    """Write the blocks of all node pairs `(a, b)`, a < b, of a block of boxes.

    `K` is the stiffness between base vectors. `x` are the nodal differences at rest. The hourglass stiffness is multiplied by
    `kept`.
    """
    B, modes, n = points.B, points.modes, nodes - 1
    NINE = 9 * LANES
    out[: n * NINE] = 0
    gamma, shape = np.empty((len(modes), n, LANES), x.dtype), np.empty(3 * LANES, x.dtype)
    for k in range(len(modes)):
        _sums(modes, k, x, shape)
        for a in range(n):
            for i in range(LANES):
                along = (
                    shape[i] * B[block, a, 0, i] + shape[i + LANES] * B[block, a, 1, i] + shape[i + 2 * LANES] * B[block, a, 2, i]
                )
                gamma[k, a, i] = modes[k, a] - along
    row = np.empty(NINE, x.dtype)
    pair = n
    for a in range(n):
        for j in range(3):
            for e in range(9):
                of = I((9 * j + e) * LANES)
                for i in range(LANES):
                    at = of + I(i)
                    T[at] = (
                        B[block, a, 0, i] * K[at]
                        + B[block, a, 1, i] * K[at + I(3 * NINE)]
                        + B[block, a, 2, i] * K[at + I(6 * NINE)]
                    )
        for b in range(a, n):
            for e in range(9):
                of = I(e * LANES)
                for i in range(LANES):
                    at = of + I(i)
                    row[at] = (
                        B[block, b, 0, i] * T[at] + B[block, b, 1, i] * T[at + I(NINE)] + B[block, b, 2, i] * T[at + I(2 * NINE)]
                    )
            for k in range(len(modes)):
                for i in range(LANES):
                    value = 2 * kept * points.resistance[block, i] * gamma[k, a, i] * gamma[k, b, i]
                    row[I(i)] += value
                    row[I(4 * LANES + i)] += value
                    row[I(8 * LANES + i)] += value
            for i in range(NINE):
                out[I(b * NINE + i)] -= row[I(i)]
            if b > a:
                for i in range(NINE):
                    out[I(pair * NINE + i)] = row[I(i)]
                for e in range(9):
                    turned = 3 * (e % 3) + e // 3
                    for i in range(LANES):
                        out[I(a * NINE + e * LANES + i)] -= row[I(turned * LANES + i)]
                pair += 1
