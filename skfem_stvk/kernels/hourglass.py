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
from numpy import uint64

from .compiled import by_type, kernel
from .lanes import ELEMENT, LANES, MeanPoints, Points


def add_hourglass_forces(points: Any, block: Any, x: Any, y: Any, U: Any, factor: Any, forces: Any, total: Any) -> Any:
    """Add `factor` times the hourglass forces of displacements to base vectors and to nodes, and return four times the energy.

    `x`, `y` are the nodal differences from `gather` at rest and of displacements; `U` are the displacements of the base vectors.
    """
    return ELEMENT["add_hourglass_forces", type(points)](points, block, x, y, U, factor, forces, total)


def hourglass_energy_along(points: Any, block: Any, x: Any, y: Any, U: Any, z: Any, V: Any) -> Any:
    """Return `4 c sum r_k . r_k`, `4 c sum r_k . s_k` and `4 c sum s_k . s_k` of a block.

    `r` are the modes of the displacements `y`, and `s` those of `z`.
    """
    return ELEMENT["hourglass_energy_along", type(points)](points, block, x, y, U, z, V)


def add_hourglass_magnitudes(points: Any, block: Any, x: Any, z: Any, U: Any, forces: Any, total: Any) -> None:
    """Add the absolute values of the terms of the hourglass forces, for magnitudes `z` of displacements and `U` of base vectors."""
    ELEMENT["add_hourglass_magnitudes", type(points)](points, block, x, z, U, forces, total)


@by_type(add_hourglass_forces, type(None), ELEMENT)
def _no_forces_of_simplices(points, block, x, y, U, factor, forces, total):
    return 0


@by_type(add_hourglass_forces, Points, ELEMENT)
def _no_forces_of_tables(points, block, x, y, U, factor, forces, total):
    return 0


@by_type(hourglass_energy_along, type(None), ELEMENT)
def _no_energy_of_simplices(points, block, x, y, U, z, V):
    return 0, 0, 0


@by_type(hourglass_energy_along, Points, ELEMENT)
def _no_energy_of_tables(points, block, x, y, U, z, V):
    return 0, 0, 0


@by_type(add_hourglass_magnitudes, type(None), ELEMENT)
def _no_magnitudes_of_simplices(points, block, x, z, U, forces, total):
    pass


@by_type(add_hourglass_magnitudes, Points, ELEMENT)
def _no_magnitudes_of_tables(points, block, x, z, U, forces, total):
    pass


@kernel
def _sums(modes, k, x, out):
    """Write `sum_a h_ka x_a` (3 LANES,) of a mode."""
    out[:] = 0
    for group in range(modes.shape[1] // 3):
        h1, h2, h3 = modes[k, 3 * group], modes[k, 3 * group + 1], modes[k, 3 * group + 2]
        first = uint64(9 * group * LANES)
        for i in range(3 * LANES):
            at = first + uint64(i)
            out[uint64(i)] += h1 * x[at] + h2 * x[at + uint64(3 * LANES)] + h3 * x[at + uint64(6 * LANES)]


@kernel
def _amplitude(points, k, x, y, U, shape, r):
    """Write `h_k' X` (3 LANES,) of a mode, and its `r_k`."""
    _sums(points.modes, k, x, shape)
    _sums(points.modes, k, y, r)
    for c in range(3):
        for i in range(LANES):
            lane = uint64(i)
            at = uint64(c * LANES) + lane
            along = (
                shape[lane] * U[at]
                + shape[lane + uint64(LANES)] * U[at + uint64(3 * LANES)]
                + shape[lane + uint64(2 * LANES)] * U[at + uint64(6 * LANES)]
            )
            r[at] -= along


@by_type(add_hourglass_forces, MeanPoints, ELEMENT)
def _hourglass_forces(points, block, x, y, U, factor, forces, total):
    shape, r = np.empty(3 * LANES, x.dtype), np.empty(3 * LANES, x.dtype)
    four = x.dtype.type(0)
    both = x.dtype.type(2 * factor)
    for k in range(len(points.modes)):
        _amplitude(points, k, x, y, U, shape, r)
        for c in range(3):
            for i in range(LANES):
                at = uint64(c * LANES + i)
                hourglass_stiffness = points.hourglass_stiffness[block, uint64(i)]
                four += 4 * hourglass_stiffness * r[at] * r[at]
                r[at] *= both * hourglass_stiffness
        for group in range(points.modes.shape[1] // 3):
            h1, h2, h3 = points.modes[k, 3 * group], points.modes[k, 3 * group + 1], points.modes[k, 3 * group + 2]
            first = uint64(9 * group * LANES)
            for i in range(3 * LANES):
                at, ri = first + uint64(i), r[uint64(i)]
                total[at] += h1 * ri
                total[at + uint64(3 * LANES)] += h2 * ri
                total[at + uint64(6 * LANES)] += h3 * ri
        for j in range(3):
            for c in range(3):
                for i in range(LANES):
                    forces[uint64((3 * j + c) * LANES + i)] -= shape[uint64(j * LANES + i)] * r[uint64(c * LANES + i)]
    return four


@by_type(hourglass_energy_along, MeanPoints, ELEMENT)
def _hourglass_energy(points, block, x, y, U, z, V):
    shape, r, s = np.empty(3 * LANES, x.dtype), np.empty(3 * LANES, x.dtype), np.empty(3 * LANES, x.dtype)
    zero = x.dtype.type(0)
    rr, rs, ss = zero, zero, zero
    for k in range(len(points.modes)):
        _amplitude(points, k, x, y, U, shape, r)
        _amplitude(points, k, x, z, V, shape, s)
        for c in range(3):
            for i in range(LANES):
                at = uint64(c * LANES + i)
                hourglass_stiffness = 4 * points.hourglass_stiffness[block, uint64(i)]
                rr += hourglass_stiffness * r[at] * r[at]
                rs += hourglass_stiffness * r[at] * s[at]
                ss += hourglass_stiffness * s[at] * s[at]
    return rr, rs, ss


@by_type(add_hourglass_magnitudes, MeanPoints, ELEMENT)
def _hourglass_magnitudes(points, block, x, z, U, forces, total):
    shape, r = np.empty(3 * LANES, x.dtype), np.empty(3 * LANES, x.dtype)
    for k in range(len(points.modes)):
        _sums(points.modes, k, x, shape)
        _sums(np.abs(points.modes), k, z, r)
        for c in range(3):
            for i in range(LANES):
                lane = uint64(i)
                at = uint64(c * LANES) + lane
                along = (
                    abs(shape[lane]) * U[at]
                    + abs(shape[lane + uint64(LANES)]) * U[at + uint64(3 * LANES)]
                    + abs(shape[lane + uint64(2 * LANES)]) * U[at + uint64(6 * LANES)]
                )
                r[at] = 2 * points.hourglass_stiffness[block, lane] * (r[at] + along)
        for a in range(points.modes.shape[1]):
            h = abs(points.modes[k, a])
            for i in range(3 * LANES):
                total[uint64(3 * a * LANES + i)] += h * r[uint64(i)]
        for j in range(3):
            for c in range(3):
                for i in range(LANES):
                    forces[uint64((3 * j + c) * LANES + i)] += abs(shape[uint64(j * LANES + i)]) * r[uint64(c * LANES + i)]


@kernel
def put_pairs_of_means(points, block, nodes, K, x, factor, T, out):
    """Write the blocks of all node pairs `(a, b)`, a < b, of a block of boxes.

    `K` is the stiffness between base vectors. `x` are the nodal differences at rest. The hourglass stiffness is multiplied by
    `factor`.
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
                of = uint64((9 * j + e) * LANES)
                for i in range(LANES):
                    at = of + uint64(i)
                    T[at] = (
                        B[block, a, 0, i] * K[at]
                        + B[block, a, 1, i] * K[at + uint64(3 * NINE)]
                        + B[block, a, 2, i] * K[at + uint64(6 * NINE)]
                    )
        for b in range(a, n):
            for e in range(9):
                of = uint64(e * LANES)
                for i in range(LANES):
                    at = of + uint64(i)
                    row[at] = (
                        B[block, b, 0, i] * T[at]
                        + B[block, b, 1, i] * T[at + uint64(NINE)]
                        + B[block, b, 2, i] * T[at + uint64(2 * NINE)]
                    )
            for k in range(len(modes)):
                for i in range(LANES):
                    value = 2 * factor * points.hourglass_stiffness[block, i] * gamma[k, a, i] * gamma[k, b, i]
                    row[uint64(i)] += value
                    row[uint64(4 * LANES + i)] += value
                    row[uint64(8 * LANES + i)] += value
            for i in range(NINE):
                out[uint64(b * NINE + i)] -= row[uint64(i)]
            if b > a:
                for i in range(NINE):
                    out[uint64(pair * NINE + i)] = row[uint64(i)]
                for e in range(9):
                    transposed = 3 * (e % 3) + e // 3
                    for i in range(LANES):
                        out[uint64(a * NINE + e * LANES + i)] -= row[uint64(transposed * LANES + i)]
                pair += 1
