"""Homogeneous states at finite strain. Displacements, stresses and reactions have closed forms, which every mesh reproduces.

With `e = (s^2 - 1)/2`, Lame constants `lam`, `mu` and `E`, `nu` in the dimension of the simplex, `F` the deformation gradient and
`P` the nominal (first Piola-Kirchhoff) stress:

    uniaxial strain   F = diag(s, 1, 1)        P_11 = (lam + 2 mu) s e,  P_22 = P_33 = lam e
    uniaxial stress   F = diag(s, r, r)        P_11 = E s e,  r^2 = 1 - 2 nu e
    equibiaxial       F = diag(s, s, r)        P_11 = P_22 = E/(1 - nu) s e,  r^2 = 1 - 4 nu/(1 - nu) e
    hydrostatic       F = s I                  P_ii = (3 lam + 2 mu) s e
    simple shear g    F = I + g e_1 (x) e_2    P_12 = mu g + (lam/2 + mu) g^3, P_21 = mu g, P_11 = (lam/2 + mu) g^2,
                                               P_22 = (lam + 2 mu)/2 g^2, P_33 = lam/2 g^2
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from skfem_stvk.arguments import Array

#: Stretch and shear at t = 1.
STRETCH, SHEAR = 1.2, 0.4


def uniaxial_strain(k: int, lam: float, mu: float, t: float) -> tuple[Array, Array]:
    s, e = _stretch(t)
    F, P = np.eye(k), np.eye(k) * lam * e
    F[0, 0], P[0, 0] = s, (lam + 2 * mu) * s * e
    return F, P


def uniaxial_stress(k: int, lam: float, mu: float, t: float) -> tuple[Array, Array]:
    s, e = _stretch(t)
    E, nu = _young_and_poisson(k, lam, mu)
    F, P = np.eye(k) * np.sqrt(1 - 2 * nu * e), np.zeros((k, k))
    F[0, 0], P[0, 0] = s, E * s * e
    return F, P


def equibiaxial(k: int, lam: float, mu: float, t: float) -> tuple[Array, Array]:
    s, e = _stretch(t)
    E, nu = _young_and_poisson(k, lam, mu)
    F, P = np.eye(k) * np.sqrt(1 - 4 * nu / (1 - nu) * e), np.zeros((k, k))
    F[range(2), range(2)], P[range(2), range(2)] = s, E / (1 - nu) * s * e
    return F, P


def hydrostatic(k: int, lam: float, mu: float, t: float) -> tuple[Array, Array]:
    s, e = _stretch(t)
    return s * np.eye(k), (3 * lam + 2 * mu) * s * e * np.eye(k)


def simple_shear(k: int, lam: float, mu: float, t: float) -> tuple[Array, Array]:
    g = SHEAR * t
    F, P = np.eye(k), np.diag([(lam / 2 + mu) * g**2, (lam / 2 + mu) * g**2, lam / 2 * g**2][:k])
    F[0, 1], P[0, 1], P[1, 0] = g, mu * g + (lam / 2 + mu) * g**3, mu * g
    return F, P


ClosedForm = Callable[[int, float, float, float], tuple[Array, Array]]
#: Closed form by name, with the dimensions of simplices in which the state differs from all others.
STATES: dict[str, tuple[ClosedForm, tuple[int, ...]]] = {
    "uniaxial strain": (uniaxial_strain, (2, 3)),
    "uniaxial stress": (uniaxial_stress, (1, 2, 3)),
    "equibiaxial": (equibiaxial, (2, 3)),
    "hydrostatic": (hydrostatic, (3,)),
    "simple shear": (simple_shear, (2, 3)),
}


def _stretch(t: float) -> tuple[float, float]:
    s = 1 + (STRETCH - 1) * t
    return s, (s * s - 1) / 2


def _young_and_poisson(k: int, lam: float, mu: float) -> tuple[float, float]:
    """Return `E` and `nu` of an isotropic law in `k` dimensions. On a line, `lam + 2 mu` is `E`."""
    if k == 1:
        return lam + 2 * mu, 0.0
    nu = lam / (2 * (lam + mu)) if k == 3 else lam / (lam + 2 * mu)
    return 2 * mu * (1 + nu), nu
