"""Linear elasticity at a point: the law of small strain, in which rotations cause strain.

Notation of `laws`. Strain and stress are along the frame at rest:

    M_ij = Q_i . h_j + h_i . Q_j = 2 eps_ij        S_ij = w C_ijkl M_kl / 2        w W = 1/4 S : M        s_j = sum_k S_jk Q_k
    A_mn = w sum_kl C_mknl Q_k Q_l', the same at all displacements

The numbers and formulas are those of St. Venant-Kirchhoff's law with `Q` in place of `q`, and without tensions.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from .compiled import Reals, by_type
from .laws import (
    FORMULAS,
    axis_forces,
    base_vector_stiffness,
    contracted,
    law_size,
    respond,
    scale_tensions,
    state_size,
    strain,
    stress,
    stress_magnitudes,
)
from .st_venant_kirchhoff import GeneralLaw, IsotropicLaw


class LinearIsotropicLaw(NamedTuple):
    """Isotropic linear law, with the numbers of `IsotropicLaw`."""

    D: Reals


class LinearGeneralLaw(NamedTuple):
    """General linear law, with the numbers of `GeneralLaw`."""

    D: Reals


#: Linear law for each St. Venant-Kirchhoff law, with the same numbers.
LINEAR: dict[Any, Any] = {IsotropicLaw: LinearIsotropicLaw, GeneralLaw: LinearGeneralLaw}

for _law, _linear in LINEAR.items():
    for _stub in (law_size, state_size, stress, stress_magnitudes, base_vector_stiffness):
        by_type(_stub, _linear, FORMULAS)(FORMULAS[_stub.__name__, _law])


@by_type(respond, LinearIsotropicLaw, FORMULAS)
@by_type(respond, LinearGeneralLaw, FORMULAS)
def _response_along_the_frame_at_rest(law, at, weight, Q, h, q):
    Q1, Q2, Q3 = Q
    M = strain(h[0], h[1], h[2], Q1, Q2, Q3, Q1, Q2, Q3)
    S = stress(law, at, weight, M)
    s1, s2, s3 = axis_forces(S, Q1, Q2, Q3)
    none = weight - weight
    return contracted(S, M), (*Q1, *Q2, *Q3, none, none, none, none, none, none), s1, s2, s3


@by_type(scale_tensions, LinearIsotropicLaw, FORMULAS)
@by_type(scale_tensions, LinearGeneralLaw, FORMULAS)
def _no_tensions(law, points, states, positive, negative):
    """Leave the state unchanged, because it contains no tensions."""
