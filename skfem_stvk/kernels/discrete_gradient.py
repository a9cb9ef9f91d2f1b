"""Forces between two states whose work is the difference of the energies, for any law whose energy is a function of the strain.

At a point, `q_m` is the frame at the midpoint. `M = 2 E` is the strain of the first state, `dM` its change, and S follows from the
energy:

    s_j = sum_k S_jk q_mk        S = (w0 + w1) (S(M + dM/2) + a dM) + (w1 - w0) b dM
    a = (W1 - W0 - 1/2 S(M + dM/2) : dM) / (1/2 dM : dM)        b = max(0, 1/4 (S1 - S0) : dM) / (1/2 dM : dM)

The work of S is `1/2 S : dM`, and S is symmetric. Therefore `w0 = w1 = 1/2` conserves energy and both momenta. A body in rigid
rotation has `dM = 0` and the stress of its current state.

The difference between `W1 - W0` and the work of the midpoint stress is of third order. Where it is no larger than the rounding
error of the energies it is omitted, because `a` would be noise divided by `dM : dM`. For the same reason it is limited to `4 |dM|
(|S0 - S| + |S1 - S|)`. The integral of `1/2 (S(t) - S) : dM` is a small part of this limit.

Laws are functions of frames, not of strains. For `1 + M` the triangular frame is used, `L L' = 1 + M` (Cholesky, without
cancellation), with the orientation of the frame of the body. S follows from its `s_j` (`response_through_frame`). A law that
computes S from strains directly registers its formula (`response_to_strain`).

Source: Gonzalez (2000), with the stress of the mean strain.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy import uint64

from .compiled import by_type, inlined
from .element_assembly import hourglass_share, rule_forces
from .lanes import LANES, add, cross, dot
from .laws import FORMULAS, axis_forces, between, contracted, respond, strain, weighted_sum

#: Rounding error of a difference of energies, in eps times the energies.
ROUNDING = 32


@inlined
def _orientation(a, b, c, third, one):
    """Return 1 if three vectors, or two in the plane, are right-handed, otherwise -1."""
    volume = dot(cross(a, b), (c[0], c[1], c[2] + (one - third)))
    return -one if volume < 0 else one


@inlined
def _sqrt1pm1(x, one):
    """Return `sqrt(1 + x) - 1` without cancellation."""
    return x / (one + np.sqrt(one + x))


def response_to_strain(
    law: Any, at: Any, weight: Any, M: Any, rest: Any, orientation: Any, second: Any, third: Any, one: Any
) -> Any:
    """Return `4 w W` and `S` of a law for strains `M`.

    `rest` and `orientation` are the orientations of the element at rest and in this state. `second` and `third` are 1 for an
    existing axis, otherwise 0.
    """
    return FORMULAS["response_to_strain", type(law)](law, at, weight, M, rest, orientation, second, third, one)


def response_through_frame(law, at, weight, M, rest, orientation, second, third, one):
    """Return `4 w W` and `S` from the triangular frame of `1 + M`.

    Laws that are functions of frames register this formula as `response_to_strain`.
    """
    a1 = _sqrt1pm1(M[0], one)
    l1 = one + a1
    l21, l31 = M[3] / l1, M[4] / l1
    a2 = _sqrt1pm1(M[1] - l21 * l21, one)
    l2 = one + a2
    l32 = (M[5] - l31 * l21) / l2
    a3 = _sqrt1pm1(M[2] - l31 * l31 - l32 * l32, one)
    l3, zero = one + a3, one - one
    # for equal orientations this is hand * a2
    moved = orientation * a2 + (orientation - rest)
    Q = (one, zero, zero), (zero, second * rest, zero), (zero, zero, third)
    h = (a1, zero, zero), (l21, second * moved, zero), (l31, orientation * l32, third * a3)
    q = (l1, zero, zero), (l21, second * orientation * l2, zero), (l31, orientation * l32, third * l3)
    energy, _, s1, s2, s3 = respond(law, at, weight, Q, h, q)
    S33, S23, S13 = s3[2] / l3, s2[2] / l3, s1[2] / l3
    S22, S12 = (orientation * s2[1] - S23 * l32) / l2, (orientation * s1[1] - S13 * l32) / l2
    return energy, ((s1[0] - S12 * l21 - S13 * l31) / l1, S22, S33, S12, S13, S23)


class DiscreteGradient(NamedTuple):
    """Rule of stresses whose work is the difference of the energies.

    `oriented` : whether elements have as many dimensions as space.
    """

    w0: float
    w1: float
    theta: float
    oriented: bool


@by_type(hourglass_share, DiscreteGradient, FORMULAS)
def _mean_share(rule):
    return rule.w0 + rule.w1, rule.theta


@by_type(rule_forces, DiscreteGradient, FORMULAS)
def _forces_of_gradient(rule, law, at, weight, Q, h, q, H):
    number = law.D.dtype.type
    one, zero, half = number(1), number(0), number(0.5)
    e1, e2, e3 = add(q[0], H[0]), add(q[1], H[1]), add(q[2], H[2])
    M = strain(h[0], h[1], h[2], Q[0], Q[1], Q[2], q[0], q[1], q[2])
    dM = strain(H[0], H[1], H[2], q[0], q[1], q[2], e1, e2, e3)
    second, third = one if law.D[at + uint64(3 * LANES)] != 0 else zero, one if law.D[at + uint64(5 * LANES)] != 0 else zero
    rest, before, after = one, one, one
    if rule.oriented:
        rest, before, after = (
            _orientation(Q[0], Q[1], Q[2], third, one),
            _orientation(q[0], q[1], q[2], third, one),
            _orientation(e1, e2, e3, third, one),
        )
    W0, S0 = response_to_strain(law, at, weight, M, rest, before, second, third, one)
    W1, S1 = response_to_strain(law, at, weight, weighted_sum(one, M, one, dM), rest, after, second, third, one)
    _, S = response_to_strain(law, at, weight, weighted_sum(one, M, half, dM), rest, before, second, third, one)
    change = half * contracted(dM, dM)
    error = (W1 - W0) / 4 - half * contracted(S, dM)
    noise = number(ROUNDING * np.finfo(law.D.dtype).eps) * (abs(W0) + abs(W1)) / 4
    known = error * error / (error * error + noise * noise + np.finfo(law.D.dtype).tiny)
    early, late = weighted_sum(one, S, -one, S0), weighted_sum(one, S, -one, S1)
    most = np.sqrt(contracted(dM, dM)) * (np.sqrt(contracted(early, early)) + np.sqrt(contracted(late, late)))
    error = min(max(error, -4 * most), 4 * most)
    more = max(zero, (contracted(S1, dM) - contracted(S0, dM)) / 4)
    both, apart = number(rule.w0 + rule.w1), number(rule.w1 - rule.w0)
    a = number((both * error * known + apart * more) / change) if change > 0 else zero
    S = weighted_sum(both, S, a, dM)
    return more + (W1 - W1), axis_forces(S, *between(q, number(rule.theta), H))  # NaN is propagated
