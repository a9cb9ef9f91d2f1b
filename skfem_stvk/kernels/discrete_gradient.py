"""A force between two states whose work is the difference of their energies, for any law whose energy is one of the strain.

At a point, with `q_m` the frame in the middle, strains `M = 2 E` of the beginning, `dM` of the change, and S from the energy at
them:

    s_j = sum_k S_jk q_mk        S = (w0 + w1) (S(M + dM/2) + a dM) + (w1 - w0) b dM
    a = (W1 - W0 - 1/2 S(M + dM/2) : dM) / (1/2 dM : dM)        b = max(0, 1/4 (S1 - S0) : dM) / (1/2 dM : dM)

The work of S is `1/2 S : dM`, and S is symmetric: with `w0 = w1 = 1/2` energy and both momenta are conserved. A body that turns
as a whole has the stress of where it is, `dM = 0`. What `W1 - W0` differs by from the work of the middle is of third order, and
where it is no more than rounding of the energies it is left out: `a` would be noise over `dM : dM`. For the same reason it is taken
to be no more than `4 |dM| (|S0 - S| + |S1 - S|)`, of which the integral of `1/2 (S(t) - S) : dM` is a small part.

Laws see frames, not strains: of `1 + M` the triangular one is taken, `L L' = 1 + M` (Cholesky, without cancellation), handed as
the frame of the body is. From its `s_j` follows S (`by_frames`). A law that knows S for strains registers that (`by_strain`).

Source: Gonzalez (2000), with the stress of the mean strain.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .compiled import Ids, Reals, inlined, kernel
from .hourglass import resist
from .lanes import (
    LANES,
    I,
    Points,
    add,
    at_point,
    cross,
    dot,
    find_spokes,
    gather,
    points_of,
    put,
    room,
    scatter,
    six,
    spokes,
    spread,
    times,
    vectors,
    weight_of,
)
from .laws import FORMULAS, contracted, in_frame, numbers_in, on_spokes, pulled, respond, strain

#: Of the energies: what their difference is known to.
ROUNDING = 32


@inlined
def _hand(a, b, c, third, one):
    """1 or -1: whether three vectors, or two in the plane, are right-handed."""
    volume = dot(cross(a, b), (c[0], c[1], c[2] + (one - third)))
    return -one if volume < 0 else one


@inlined
def _more(x, one):
    """`sqrt(1 + x) - 1` without cancellation."""
    return x / (one + np.sqrt(one + x))


def by_strain(law: Any, at: Any, weight: Any, M: Any, rest: Any, hand: Any, second: Any, third: Any, one: Any) -> Any:
    """`4 w W` and `S` of a law for strains, of elements of a hand at rest and now; second and third say which axes there are."""
    return FORMULAS["by_strain", type(law)](law, at, weight, M, rest, hand, second, third, one)


def by_frames(law, at, weight, M, rest, hand, second, third, one):
    """By the triangular frame of `1 + M`: what laws that see frames register as `by_strain`."""
    a1 = _more(M[0], one)
    l1 = one + a1
    l21, l31 = M[3] / l1, M[4] / l1
    a2 = _more(M[1] - l21 * l21, one)
    l2 = one + a2
    l32 = (M[5] - l31 * l21) / l2
    a3 = _more(M[2] - l31 * l31 - l32 * l32, one)
    l3, zero = one + a3, one - one
    # of equal hands the change is a2 times it
    turned = hand * a2 + (hand - rest)
    Q = (one, zero, zero), (zero, second * rest, zero), (zero, zero, third)
    h = (a1, zero, zero), (l21, second * turned, zero), (l31, hand * l32, third * a3)
    q = (l1, zero, zero), (l21, second * hand * l2, zero), (l31, hand * l32, third * l3)
    energy, _, s1, s2, s3 = respond(law, at, weight, Q, h, q)
    S33, S23, S13 = s3[2] / l3, s2[2] / l3, s1[2] / l3
    S22, S12 = (hand * s2[1] - S23 * l32) / l2, (hand * s1[1] - S13 * l32) / l2
    return energy, ((s1[0] - S12 * l21 - S13 * l31) / l1, S22, S33, S12, S13, S23)


@inlined
def _sum(x, a, y, b):
    """`x a + y b` of six numbers each."""
    return (
        x * a[0] + y * b[0],
        x * a[1] + y * b[1],
        x * a[2] + y * b[2],
        x * a[3] + y * b[3],
        x * a[4] + y * b[4],
        x * a[5] + y * b[5],
    )


@kernel
def discrete_mean_force(
    begin: int,
    end: int,
    t: Ids,
    slots: Ids,
    points: Points | None,
    law: Any,
    X: Reals,
    u: Reals,
    v: Reals,
    oriented: bool,
    w0: float,
    w1: float,
    theta: float,
    f: Reals,
) -> float:
    """Add to the slots `f` the forces of the stresses between `u` and `u + v`, along the frames at `u + theta v`.

    Returns what the work is more by for weights that are `w1 - w0 = 1` apart. `oriented`: whether elements fill their space.
    """
    D, count = law.D, numbers_in(law)
    x, y, z, total = room(points, D.dtype), room(points, D.dtype), room(points, D.dtype), room(points, D.dtype)
    P, U, V, forces = at_point(points, x), at_point(points, y), at_point(points, z), at_point(points, total)
    both, apart, part = D.dtype.type(w0 + w1), D.dtype.type(w1 - w0), D.dtype.type(theta)
    one, half, rounding = D.dtype.type(1), D.dtype.type(0.5), D.dtype.type(ROUNDING * np.finfo(D.dtype).eps)
    zero, smallest = D.dtype.type(0), np.finfo(D.dtype).tiny
    dR = 0.0
    for block in range(begin, end):
        gather(points, t, block, X, x)
        gather(points, t, block, u, y)
        gather(points, t, block, v, z)
        r = zero
        if points is not None:
            total[:] = 0
        for point in range(points_of(points)):
            first, weight = find_spokes(points, block, point, count, x, P, y, U), weight_of(points, point, D)
            spokes(points, block, point, z, V)
            for i in range(LANES):
                lane, at = I(i), I(first + i)
                R = six(D, at)
                P1, P2, P3 = vectors(P, lane)
                U1, U2, U3 = vectors(U, lane)
                V1, V2, V3 = vectors(V, lane)
                (Q1, Q2, Q3), (h1, h2, h3) = in_frame(R, P1, P2, P3), in_frame(R, U1, U2, U3)
                H1, H2, H3 = in_frame(R, V1, V2, V3)
                q1, q2, q3 = add(Q1, h1), add(Q2, h2), add(Q3, h3)
                e1, e2, e3 = add(q1, H1), add(q2, H2), add(q3, H3)
                M = strain(h1, h2, h3, Q1, Q2, Q3, q1, q2, q3)
                dM = strain(H1, H2, H3, q1, q2, q3, e1, e2, e3)
                second, third = one if R[3] != 0 else zero, one if R[5] != 0 else zero
                rest, before, after = one, one, one
                if oriented:
                    rest, before, after = (
                        _hand(Q1, Q2, Q3, third, one),
                        _hand(q1, q2, q3, third, one),
                        _hand(e1, e2, e3, third, one),
                    )
                W0, S0 = by_strain(law, at, weight, M, rest, before, second, third, one)
                W1, S1 = by_strain(law, at, weight, _sum(one, M, one, dM), rest, after, second, third, one)
                _, S = by_strain(law, at, weight, _sum(one, M, half, dM), rest, before, second, third, one)
                change = half * contracted(dM, dM)
                error = (W1 - W0) / 4 - half * contracted(S, dM)
                noise = rounding * (abs(W0) + abs(W1)) / 4
                known = error * error / (error * error + noise * noise + smallest)
                early, late = _sum(one, S, -one, S0), _sum(one, S, -one, S1)
                most = np.sqrt(contracted(dM, dM)) * (np.sqrt(contracted(early, early)) + np.sqrt(contracted(late, late)))
                error = min(max(error, -4 * most), 4 * most)
                more = max(zero, (contracted(S1, dM) - contracted(S0, dM)) / 4)
                r += more + (W1 - W1)  # what is not a number stays that
                a = D.dtype.type((both * error * known + apart * more) / change) if change > 0 else zero
                g1, g2, g3 = add(q1, times(part, H1)), add(q2, times(part, H2)), add(q3, times(part, H3))
                s1, s2, s3 = pulled(_sum(both, S, a, dM), g1, g2, g3)
                f1, f2, f3 = on_spokes(R, s1, s2, s3)
                put(f1, forces, lane)
                put(f2, forces, lane + I(3 * LANES))
                put(f3, forces, lane + I(6 * LANES))
            resist(points, block, x, y, U, both, forces, total)
            resist(points, block, x, z, V, both * part, forces, total)
            spread(points, block, point, forces, total)
        dR += r
        scatter(points, slots, block, total, f)
    return dR
