"""Contact of points with a rigid shape by a penalty: gaps, forces, blocks of K, mean forces and step limits.

The surface of a body has facets with `nq` points each. Point q of a facet is at `x = sum_a N_qa x_a`, with the nodes a of the
facet. Its gap `g` to the shape is positive outside, its depth is `p = max(-g, 0)`, and `n = dg/dx` is the normal. With the penalty

    psi(p) = k p^2/2                                                       onset e = 0
    psi(p) = k p^3/(6 e) for p <= e, k (p^2/2 - e p/2 + e^2/6) above       0 < e: psi'' = k min(p/e, 1)

energy, force and stiffness are sums over points of the area `w` at rest:

    W = sum w psi        f_a = sum w psi_g N_a n        K_ab = sum w N_a N_b (psi_gg n n' + psi_g dn/dx)        psi_g = -psi'(p)

Between two states with gaps `g0` and `g1`, the mean force `s N_a n` has the slope `s = (psi(g1) - psi(g0))/(g1 - g0)`. Its mean
normal has `n . (dx - dx_shape) = g1 - g0`, so that its work is exact. The slope is the mean of `psi_g` over the depths between
them. It is computed on each branch of psi, without cancellation.

The numbers of a shape are a position (3), a direction or half sizes (3), the radius and the sign (-1 if the body is inside). The
shape is displaced by `shift` (3,). Arrays: `weights` (n, nq) areas times `k`, `u` (nv, d), at most 3 components. Forces are added
to `f` (nv, d).
"""

from __future__ import annotations

from math import inf, sqrt
from typing import NamedTuple

import numpy as np

from .compiled import Ids, Reals, inlined, kernel


class Surface(NamedTuple):
    """Points of a surface: `N` (nq, m) shape functions at the points, `t` (n, m) nodes of facets, `X` (nv, d) nodes at rest [m]."""

    N: Reals
    t: Ids
    X: Reals


class Blocks(NamedTuple):
    """Blocks of the nodes `own` (nodes, d, d) and of `pairs` (pairs, d, d) [N/m].

    Nodes `first` and `second` (p,) of facet i are the pairs `sides` (p, n).
    """

    sides: Ids
    first: Ids
    second: Ids
    pairs: Reals
    own: Reals


class ShapeNumbers(NamedTuple):
    """A rigid shape: its kind and its numbers (8,)."""

    kind: int
    numbers: Reals


#: Kinds of shapes.
PLANE, SPHERE, CYLINDER, BOX = range(4)
#: Indices in the numbers of a shape.
DIRECTION, RADIUS, SIGN, COUNT = 3, 6, 7, 8


@inlined
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def _times(c, a):
    return c * a[0], c * a[1], c * a[2]


@inlined
def _sum(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@inlined
def _difference(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inlined
def _direction(numbers):
    return numbers[DIRECTION], numbers[DIRECTION + 1], numbers[DIRECTION + 2]


@inlined
def _arm(kind, numbers, x):
    """Return the vector from the shape's position to a point; for a cylinder, its part across the axis."""
    if kind == CYLINDER:
        axis = _direction(numbers)
        return _difference(x, _times(_dot(x, axis), axis))
    return x


@inlined
def _gap(kind, numbers, x):
    """Return the gap of a point `x`, relative to the position of the shape, and the normal."""
    if kind == PLANE:
        n = _direction(numbers)
        return _dot(x, n), n
    if kind == BOX:
        return _gap_of_box(numbers, x)
    arm = _arm(kind, numbers, x)
    length = sqrt(_dot(arm, arm))
    sign = numbers[SIGN]
    over = sign / length if length > 0 else 0.0
    return sign * (length - numbers[RADIUS]), _times(over, arm)


@inlined
def _gap_of_box(numbers, x):
    """Return gap and normal of a box whose edges are rounded by its radius. Within the box, the nearest face counts."""
    h, r = _direction(numbers), numbers[RADIUS]
    q0, q1, q2 = abs(x[0]) - h[0] + r, abs(x[1]) - h[1] + r, abs(x[2]) - h[2] + r
    outside = max(q0, 0.0), max(q1, 0.0), max(q2, 0.0)
    length = sqrt(_dot(outside, outside))
    s0, s1, s2 = np.copysign(1.0, x[0]), np.copysign(1.0, x[1]), np.copysign(1.0, x[2])
    if length > 0:
        return length - r, (s0 * outside[0] / length, s1 * outside[1] / length, s2 * outside[2] / length)
    if q0 >= q1 and q0 >= q2:
        return q0 - r, (s0, 0.0, 0.0)
    if q1 >= q2:
        return q1 - r, (0.0, s1, 0.0)
    return q2 - r, (0.0, 0.0, s2)


@inlined
def _curvature(kind, numbers, x, n):
    """Return the entries 00, 01, 02, 11, 12, 22 of `dn/dx`."""
    if kind == PLANE:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if kind == BOX:
        h, r = _direction(numbers), numbers[RADIUS]
        q0, q1, q2 = abs(x[0]) - h[0] + r, abs(x[1]) - h[1] + r, abs(x[2]) - h[2] + r
        outside = max(q0, 0.0), max(q1, 0.0), max(q2, 0.0)
        length, over = sqrt(_dot(outside, outside)), 0.0
        if length > 0:
            over = 1 / length
        d0, d1, d2 = 1.0 if q0 > 0 else 0.0, 1.0 if q1 > 0 else 0.0, 1.0 if q2 > 0 else 0.0
    else:
        arm = _arm(kind, numbers, x)
        length, over = sqrt(_dot(arm, arm)), 0.0
        if length > 0:
            over = numbers[SIGN] / length
        d0, d1, d2 = 1.0, 1.0, 1.0
    if kind == CYLINDER:
        a = _direction(numbers)
        return (
            over * (1.0 - a[0] * a[0] - n[0] * n[0]),
            over * (-a[0] * a[1] - n[0] * n[1]),
            over * (-a[0] * a[2] - n[0] * n[2]),
            over * (1.0 - a[1] * a[1] - n[1] * n[1]),
            over * (-a[1] * a[2] - n[1] * n[2]),
            over * (1.0 - a[2] * a[2] - n[2] * n[2]),
        )
    return (
        over * (d0 - n[0] * n[0]),
        over * -n[0] * n[1],
        over * -n[0] * n[2],
        over * (d1 - n[1] * n[1]),
        over * -n[1] * n[2],
        over * (d2 - n[2] * n[2]),
    )


@inlined
def _mean_normal(kind, numbers, x0, x1, g0, g1):
    """Return a normal `n` with `n . (x1 - x0) = g1 - g0`, for points relative to the position of the shape at both ends."""
    if kind == PLANE:
        return _direction(numbers)
    change = _difference(x1, x0)
    if kind == BOX:  # the normal at the middle, corrected along the change (Gonzalez 1996)
        n, square = _gap_of_box(numbers, _times(0.5, _sum(x0, x1)))[1], _dot(change, change)
        missing = (g1 - g0 - _dot(n, change)) / square if square > 0 else 0.0
        return _sum(n, _times(missing, change))
    arm0, arm1 = _arm(kind, numbers, x0), _arm(kind, numbers, x1)
    lengths = sqrt(_dot(arm0, arm0)) + sqrt(_dot(arm1, arm1))
    return _times(numbers[SIGN] / lengths if lengths > 0 else 0.0, _sum(arm0, arm1))


@inlined
def _penalty(p, e):
    """Return `psi, psi', psi''` for k = 1 at the depth `p > 0`."""
    if p < e:
        return p * p * p / (6 * e), p * p / (2 * e), p / e
    return p * p / 2 - e * p / 2 + e * e / 6, p - e / 2, 1.0


@inlined
def _mean_slope(q0, q1, e):
    """Return the mean of `psi'` for k = 1 over depths from `q0` to `q1`, which are negative outside."""
    low, high = min(q0, q1), max(q0, q1)
    if high <= 0:
        return 0.0
    if low >= e:
        return (low + high - e) / 2
    if low >= 0 and high <= e:
        return (low * low + low * high + high * high) / (6 * e)
    a, b = max(low, 0.0), min(high, e)
    total = (b - a) * (a * a + a * b + b * b) / (6 * e) if e > 0 else 0.0
    if high > e:
        total += (high - e) * high / 2
    return total / (high - low)


@inlined
def _mean_stiffness(q0, q1, e):
    """Return `2 integral of s psi''(q0 + s (q1 - q0)) ds` for k = 1 over s from 0 to 1.

    It is twice the derivative of the mean slope by `q1`, because the mean force enters the equation of a step twice.
    """
    change = q1 - q0
    if change == 0:
        return 0.0 if q0 <= 0 else (q0 / e if q0 < e else 1.0)
    at0, at_e = min(max(-q0 / change, 0.0), 1.0), min(max((e - q0) / change, 0.0), 1.0)  # where the depth is 0 and e
    if change > 0:
        begin, middle, end = at0, at_e, 1.0
        stiff = end * end - middle * middle
    else:
        begin, middle, end = at_e, at0, 0.0
        stiff = begin * begin - end * end
    ramp = 0.0
    if e > 0:
        squares, cubes = middle * middle - begin * begin, middle**3 - begin**3
        ramp = (q0 * squares + 2 * change * cubes / 3) / e
    return ramp + stiff


@inlined
def _point(N, t, i, q, X, u, shift, numbers):
    """Return a point, relative to the position of the shape."""
    x0, x1, x2 = -numbers[0] - shift[0], -numbers[1] - shift[1], -numbers[2] - shift[2]
    d = X.shape[1]
    for a in range(t.shape[1]):
        node, share = t[i, a], N[q, a]
        x0 += share * (X[node, 0] + u[node, 0])
        if d > 1:
            x1 += share * (X[node, 1] + u[node, 1])
        if d > 2:
            x2 += share * (X[node, 2] + u[node, 2])
    return x0, x1, x2


@inlined
def _spread(c, n, N, t, i, q, f):
    """Compute `f_a += c N_a n`."""
    for a in range(t.shape[1]):
        for j in range(f.shape[1]):
            f[t[i, a], j] += c * N[q, a] * n[j]


@kernel
def energy_and_force(surface: Surface, weights: Reals, shape: ShapeNumbers, shift: Reals, e: float, u: Reals, f: Reals) -> float:
    """Return the energy [J]; add the internal force [N] to `f`, unless that is empty."""
    N, t, X = surface
    kind, numbers = shape
    W = 0.0
    for i in range(len(t)):
        for q in range(len(N)):
            g, n = _gap(kind, numbers, _point(N, t, i, q, X, u, shift, numbers))
            if g < 0:
                psi, slope, _ = _penalty(-g, e)
                W += weights[i, q] * psi
                if len(f):
                    _spread(-weights[i, q] * slope, n, N, t, i, q, f)
    return W


@inlined
def _put(c, B, N, t, i, q, blocks):
    """Add `c N_a N_b B`, a symmetric matrix, to the blocks of the nodes and pairs of a facet."""
    sides, firsts, seconds, pairs, own = blocks
    d = own.shape[1]
    for j in range(d):
        for k in range(d):
            low, high = min(j, k), max(j, k)
            value = c * B[high + (low * (5 - low)) // 2]
            for a in range(t.shape[1]):
                own[t[i, a], j, k] += value * N[q, a] * N[q, a]
            for p in range(len(firsts)):
                pairs[sides[p, i], j, k] += value * N[q, firsts[p]] * N[q, seconds[p]]


@inlined
def _stiffness(normal, curved, n, B):
    """Return the entries 00, 01, 02, 11, 12, 22 of `normal n n' + curved B`."""
    return (
        normal * n[0] * n[0] + curved * B[0],
        normal * n[0] * n[1] + curved * B[1],
        normal * n[0] * n[2] + curved * B[2],
        normal * n[1] * n[1] + curved * B[3],
        normal * n[1] * n[2] + curved * B[4],
        normal * n[2] * n[2] + curved * B[5],
    )


@kernel
def add_blocks(
    surface: Surface,
    weights: Reals,
    shape: ShapeNumbers,
    shift: Reals,
    e: float,
    u: Reals,
    kept: float,
    everywhere: bool,
    blocks: Blocks,
) -> None:
    """Add the blocks of K [N/m]; `kept` is the factor of `psi_g dn/dx`.

    `everywhere`: with `psi'' = k`, as if all points touched.
    """
    N, t, X = surface
    kind, numbers = shape
    for i in range(len(t)):
        for q in range(len(N)):
            x = _point(N, t, i, q, X, u, shift, numbers)
            g, n = _gap(kind, numbers, x)
            if everywhere:
                B = _stiffness(1.0, 0.0, n, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
                _put(weights[i, q], B, N, t, i, q, blocks)
            elif g < 0:
                _, slope, stiffness = _penalty(-g, e)
                B = _stiffness(stiffness, -kept * slope, n, _curvature(kind, numbers, x, n))
                _put(weights[i, q], B, N, t, i, q, blocks)


@kernel
def add_mean_force(
    surface: Surface,
    weights: Reals,
    shape: ShapeNumbers,
    shift0: Reals,
    shift1: Reals,
    e: float,
    u0: Reals,
    u1: Reals,
    factor: float,
    f: Reals,
) -> None:
    """Add `factor` times the mean force [N] between two states to `f`."""
    N, t, X = surface
    kind, numbers = shape
    for i in range(len(t)):
        for q in range(len(N)):
            x0, x1 = _point(N, t, i, q, X, u0, shift0, numbers), _point(N, t, i, q, X, u1, shift1, numbers)
            g0, g1 = _gap(kind, numbers, x0)[0], _gap(kind, numbers, x1)[0]
            if g0 < 0 or g1 < 0:
                n = _mean_normal(kind, numbers, x0, x1, g0, g1)
                _spread(-factor * weights[i, q] * _mean_slope(-g0, -g1, e), n, N, t, i, q, f)


@kernel
def add_mean_blocks(
    surface: Surface,
    weights: Reals,
    shape: ShapeNumbers,
    shift0: Reals,
    shift1: Reals,
    e: float,
    u0: Reals,
    u1: Reals,
    blocks: Blocks,
) -> None:
    """Add the blocks of twice the derivative of the mean force by `u1`, without the change of the mean normal."""
    N, t, X = surface
    kind, numbers = shape
    for i in range(len(t)):
        for q in range(len(N)):
            x0, x1 = _point(N, t, i, q, X, u0, shift0, numbers), _point(N, t, i, q, X, u1, shift1, numbers)
            g0, g1 = _gap(kind, numbers, x0)[0], _gap(kind, numbers, x1)[0]
            if g0 < 0 or g1 < 0:
                n = _mean_normal(kind, numbers, x0, x1, g0, g1)
                B = _stiffness(_mean_stiffness(-g0, -g1, e), 0.0, n, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
                _put(weights[i, q], B, N, t, i, q, blocks)


@kernel
def find_gaps(
    surface: Surface,
    weights: Reals,
    shape: ShapeNumbers,
    shift: Reals,
    e: float,
    u: Reals,
    gaps: Reals,
    forces: Reals,
    normals: Reals,
) -> None:
    """Write the gaps (n, nq) [m] of all points, the normal forces on them (n, nq) [N] and the normals (n, nq, d)."""
    N, t, X = surface
    kind, numbers = shape
    for i in range(len(t)):
        for q in range(len(N)):
            g, n = _gap(kind, numbers, _point(N, t, i, q, X, u, shift, numbers))
            gaps[i, q] = g
            forces[i, q] = weights[i, q] * _penalty(-g, e)[1] if g < 0 else 0.0
            for j in range(normals.shape[2]):
                normals[i, q, j] = n[j]


@kernel
def smallest_gap(surface: Surface, shape: ShapeNumbers, shift: Reals, u: Reals) -> float:
    """Return the smallest gap of all points [m]."""
    N, t, X = surface
    kind, numbers = shape
    least = inf
    for i in range(len(t)):
        for q in range(len(N)):
            least = min(least, _gap(kind, numbers, _point(N, t, i, q, X, u, shift, numbers))[0])
    return least


@inlined
def _way_through(kind, numbers, x, v):
    """Return the parameters `s` at which the line `x + s v` enters and leaves the shape; an empty interval if it does not pass.

    A line passes if the normals where it enters and leaves are at more than a right angle. Others graze the shape, and the penalty
    pushes points back to where they came from.
    """
    if kind == BOX:  # slabs of the box, without the rounding of its edges: lines pass from a face to the opposite one
        low, high, first, last = -inf, inf, 0, 0
        for j in range(3):
            h = numbers[DIRECTION + j]
            if v[j] != 0:
                a, b = (-h - x[j]) / v[j], (h - x[j]) / v[j]
                if min(a, b) > low:
                    low, first = min(a, b), j
                if max(a, b) < high:
                    high, last = max(a, b), j
            elif abs(x[j]) >= h:
                return 1.0, 0.0
        return (low, high) if first == last else (1.0, 0.0)
    arm, along = _arm(kind, numbers, x), _arm(kind, numbers, v)
    speed, radius = _dot(along, along), numbers[RADIUS]
    if speed == 0:
        return 1.0, 0.0
    middle = -_dot(arm, along) / speed
    nearest = _sum(arm, _times(middle, along))
    square = radius * radius - _dot(nearest, nearest)  # of half the length within the shape
    if 2 * square <= radius * radius:
        return 1.0, 0.0
    half = sqrt(square / speed)
    return middle - half, middle + half


@kernel
def step_limit(surface: Surface, shape: ShapeNumbers, shift: Reals, moved: Reals, u: Reals, v: Reals) -> float:
    """Return the smallest `s > 0` at which a point is halfway on its way `u + s v` through the shape, or infinity.

    The shape moves from `shift` by `s` times `moved` (3,). Halfway through a sphere or a cylinder, a point is deepest. Beyond
    it, the penalty would push it out on the other side. A plane, and a shape around the body, have no other side.
    """
    N, t, X = surface
    kind, numbers = shape
    least, nothing, origin = inf, np.zeros_like(X), np.zeros(COUNT)
    if kind == PLANE or numbers[SIGN] < 0:
        return least
    for i in range(len(t)):
        for q in range(len(N)):
            x = _point(N, t, i, q, X, u, shift, numbers)
            low, high = _way_through(kind, numbers, x, _point(N, t, i, q, nothing, v, moved, origin))
            if low < high and 0 < low + high < 2 * least:
                least = (low + high) / 2
    return least


@inlined
def _displacement(N, t, i, q, u, shift):
    """Return the displacement of a point, relative to that of the shape."""
    x0, x1, x2 = -shift[0], -shift[1], -shift[2]
    d = u.shape[1]
    for a in range(t.shape[1]):
        node, share = t[i, a], N[q, a]
        x0 += share * u[node, 0]
        if d > 1:
            x1 += share * u[node, 1]
        if d > 2:
            x2 += share * u[node, 2]
    return x0, x1, x2


@inlined
def _slip(N, t, i, q, u, shift, past):
    """Return the slip `d` of a point, relative to the shape, since the last accepted state.

    It is a difference of displacements: positions far from the origin would leave their rounding in it.
    """
    x = _displacement(N, t, i, q, u, shift)
    change = x[0] - past[i, q, 0], x[1] - past[i, q, 1], x[2] - past[i, q, 2]
    n = past[i, q, 4], past[i, q, 5], past[i, q, 6]
    return _difference(change, _times(_dot(change, n), n)), n


@inlined
def _friction(y, width):
    """Return the force per slip for a unit load, `f1(y/width)/y`, and its derivative by `y`, for `f1(r) = r (2 - r)` up to 1."""
    if y < width:
        return (2 - y / width) / width, -1 / (width * width)
    return 1 / y, -1 / (y * y)


@kernel
def add_friction(
    surface: Surface,
    shift: Reals,
    past: Reals,
    width: float,
    secants: Reals,
    u: Reals,
    factor: float,
    f: Reals,
) -> float:
    """Add `factor` times the force against the slip to `f`, unless that is empty; return the work against it [J].

    `past` (n, nq, 7) are displacement, largest friction [N] and normal of each point in the last accepted state. `secants` (n, nq),
    if not empty, are forces per slip [N/m] in place of those of the slip.
    """
    N, t, _ = surface
    work = 0.0
    for i in range(len(t)):
        for q in range(len(N)):
            load = past[i, q, 3]
            if load > 0:
                d, _ = _slip(N, t, i, q, u, shift, past)
                y = sqrt(_dot(d, d))
                c = secants[i, q] if len(secants) else load * _friction(y, width)[0]
                work += c * y * y
                if len(f):
                    _spread(factor * c, d, N, t, i, q, f)
    return work


@kernel
def find_secants(surface: Surface, shift: Reals, past: Reals, width: float, u: Reals, out: Reals) -> None:
    """Write the force per slip (n, nq) [N/m] at `u`."""
    N, t, _ = surface
    for i in range(len(t)):
        for q in range(len(N)):
            out[i, q] = 0.0
            if past[i, q, 3] > 0:
                d, _ = _slip(N, t, i, q, u, shift, past)
                out[i, q] = past[i, q, 3] * _friction(sqrt(_dot(d, d)), width)[0]


@kernel
def add_friction_blocks(
    surface: Surface,
    shift: Reals,
    past: Reals,
    width: float,
    secants: Reals,
    u: Reals,
    factor: float,
    blocks: Blocks,
) -> None:
    """Add `factor` times the derivative of the force of `add_friction`, which is symmetric and positive semi-definite."""
    N, t, _ = surface
    for i in range(len(t)):
        for q in range(len(N)):
            load = past[i, q, 3]
            if load > 0:
                d, n = _slip(N, t, i, q, u, shift, past)
                y = sqrt(_dot(d, d))
                c, along = 0.0, 0.0
                if len(secants):
                    c = secants[i, q]
                else:
                    c, slope = _friction(y, width)
                    c *= load
                    along = load * slope / y if y > 0 else 0.0
                B = (
                    c * (1 - n[0] * n[0]) + along * d[0] * d[0],
                    -c * n[0] * n[1] + along * d[0] * d[1],
                    -c * n[0] * n[2] + along * d[0] * d[2],
                    c * (1 - n[1] * n[1]) + along * d[1] * d[1],
                    -c * n[1] * n[2] + along * d[1] * d[2],
                    c * (1 - n[2] * n[2]) + along * d[2] * d[2],
                )
                _put(factor, B, N, t, i, q, blocks)


@kernel
def remember(
    surface: Surface, weights: Reals, shape: ShapeNumbers, shift: Reals, e: float, u: Reals, coefficient: float, past: Reals
) -> None:
    """Write displacement, largest friction `coefficient w psi'` [N] and normal of each point at an accepted state to `past`."""
    N, t, X = surface
    kind, numbers = shape
    for i in range(len(t)):
        for q in range(len(N)):
            x = _point(N, t, i, q, X, u, shift, numbers)
            g, n = _gap(kind, numbers, x)
            load = coefficient * weights[i, q] * _penalty(-g, e)[1] if g < 0 else 0.0
            past[i, q, 0], past[i, q, 1], past[i, q, 2] = _displacement(N, t, i, q, u, shift)
            past[i, q, 3] = load
            past[i, q, 4], past[i, q, 5], past[i, q, 6] = n
