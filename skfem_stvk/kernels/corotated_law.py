"""Corotated linear elasticity: frames that rotate with elements, user-supplied frames, and K at rest rotated with elements."""

from __future__ import annotations

from typing import Any, NamedTuple

from numpy import uint64

from .compiled import Reals, by_type, inlined
from .lanes import LANES, add, dot, times, vectors
from .laws import (
    FORMULAS,
    axis_forces,
    base_vector_stiffness,
    combination,
    contracted,
    law_size,
    respond,
    scale_tensions,
    state_size,
    strain,
    stress,
)
from .principal import lame, of_stretches, stretch_response
from .st_venant_kirchhoff import IsotropicLaw
from .svd import decompose, present


class CorotatedLaw(NamedTuple):
    """Corotated law: `Ri`, then `w lam/2` and `w mu`, with `w = mu sum (s_i - 1)^2 + lam/2 (sum (s_i - 1))^2`."""

    D: Reals
    flat: Any


of_stretches(CorotatedLaw)


@by_type(stretch_response, CorotatedLaw, FORMULAS)
def _corotated(law, at, weight, s, e):
    (lam, mu), (_, y, z) = lame(law, at, weight), present(law.flat, law.D)
    two, half = mu + mu, law.D.dtype.type(0.5)
    trace = e[0] + e[1] + e[2]
    pressure = lam * trace
    w = mu * dot(e, e) + half * pressure * trace
    p = (two * e[0] + pressure, y * (two * e[1] + pressure), z * (two * e[2] + pressure))
    return w, p, (lam + two, y * (lam + two), z * (lam + two), y * lam, z * lam, z * lam), (two, two, two)


class WarpedLaw(NamedTuple):
    """St. Venant-Kirchhoff law `of` whose tangent is K(0) rotated by the rotation nearest to F.

    The tangent uses the rotated frame at rest in place of the deformed frame, and no stress.
    """

    D: Reals
    of: Any
    flat: Any


@by_type(law_size, WarpedLaw, FORMULAS)
def _size_of_the_warped_law(law):
    return law_size(law.of)


@by_type(respond, WarpedLaw, FORMULAS)
def _response_and_rotation(law, at, weight, Q, h, q):
    D = law.D
    energy, _, s1, s2, s3 = respond(law.of, at, weight, Q, h, q)
    M = strain(h[0], h[1], h[2], Q[0], Q[1], Q[2], q[0], q[1], q[2])
    u1, u2, u3, v1, v2, v3, _, _ = decompose(law.flat, D, Q, q, M)
    _, y, z = present(law.flat, D)
    r1 = combination(v1[0], u1, v2[0], u2, v3[0], u3)
    r2 = times(y, combination(v1[1], u1, v2[1], u2, v3[1], u3))
    r3 = times(z, combination(v1[2], u1, v2[2], u2, v3[2], u3))
    o = D.dtype.type(0)
    return energy, (*r1, *r2, *r3, *(o, o, o, o, o, o)), s1, s2, s3


@by_type(base_vector_stiffness, WarpedLaw, FORMULAS)
def _rotated_stiffness(law, at, weight, R, states, lane):
    return base_vector_stiffness(law.of, at, weight, R, states, lane)


class FramedLaw(NamedTuple):
    """Linear elasticity in a user-supplied frame `r_j = R Q_j`: `Ri`, `w lam/2`, `w mu`, and nine numbers of a rotation `R`.

    The formulas are `M_ij = r_i . q_j + q_i . r_j - 2 d_ij` and `s_j = sum_k S_jk r_k`.
    """

    D: Reals


@by_type(law_size, FramedLaw, FORMULAS)
def _numbers_with_a_rotation(law):
    return 17


@by_type(state_size, WarpedLaw, FORMULAS)
@by_type(state_size, FramedLaw, FORMULAS)
def _state_of_a_rotated_frame(law):
    return 15


@by_type(scale_tensions, WarpedLaw, FORMULAS)
@by_type(scale_tensions, FramedLaw, FORMULAS)
def _weigh_nothing(law, points, states, positive, negative):
    """Leave the state unchanged, because the tangent contains no tensions."""


@inlined
def _rotated_by(R, v):
    return dot(R[0], v), dot(R[1], v), dot(R[2], v)


@by_type(respond, FramedLaw, FORMULAS)
def _pull_in_a_given_frame(law, at, weight, Q, h, q):
    D = law.D
    # the rows of the rotation, stored like three vectors
    R = vectors(D, at + uint64(8 * LANES))
    r1, r2, r3 = _rotated_by(R, Q[0]), _rotated_by(R, Q[1]), _rotated_by(R, Q[2])
    minus = D.dtype.type(-1)
    g1, g2, g3 = add(r1, times(minus, Q[0])), add(r2, times(minus, Q[1])), add(r3, times(minus, Q[2]))
    # without cancellation where R is close to the identity: r_i . h_j + h_i . r_j + g_i . Q_j + g_j . Q_i
    M = (
        dot(r1, h[0]) + dot(h[0], r1) + dot(g1, Q[0]) + dot(Q[0], g1),
        dot(r2, h[1]) + dot(h[1], r2) + dot(g2, Q[1]) + dot(Q[1], g2),
        dot(r3, h[2]) + dot(h[2], r3) + dot(g3, Q[2]) + dot(Q[2], g3),
        dot(r1, h[1]) + dot(h[0], r2) + dot(g1, Q[1]) + dot(Q[0], g2),
        dot(r1, h[2]) + dot(h[0], r3) + dot(g1, Q[2]) + dot(Q[0], g3),
        dot(r2, h[2]) + dot(h[1], r3) + dot(g2, Q[2]) + dot(Q[1], g3),
    )
    S = stress(IsotropicLaw(D), at, weight, M)
    s1, s2, s3 = axis_forces(S, r1, r2, r3)
    o = D.dtype.type(0)
    return contracted(S, M), (*r1, *r2, *r3, *(o, o, o, o, o, o)), s1, s2, s3


@by_type(base_vector_stiffness, FramedLaw, FORMULAS)
def _stiffness_in_a_user_frame(law, at, weight, R, states, lane):
    return base_vector_stiffness(IsotropicLaw(law.D), at, weight, R, states, lane)
