"""Ten hyperelastic laws of textbooks, as W(F), S(F) and C(F) = dS/dE.

W is a function of the right Cauchy-Green tensor alone. S = 2 dW/dC is in closed form. C = 2 dS/dC is computed by complex steps,
which are exact to round-off.

Sources: Bonet, Wood (2008), chapter 6. Holzapfel, "Nonlinear Solid Mechanics" (2000), chapter 6. Gent (1996). Yeoh (1993). Blatz,
Ko (1962). Fung (1967). Holzapfel, Gasser, Ogden (2000). Ciarlet (1988), section 4.10. Simo, Pister (1984).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from .statics.meshes import Array

LAM, MU = 10.0, 4.0
FIBRE = np.array([0.6, 0.64, 0.48])
ONE = np.eye(3)


def invariants(C: Array) -> tuple[Any, Any, Any]:
    return np.trace(C), (np.trace(C) ** 2 - np.trace(C @ C)) / 2, np.sqrt(np.linalg.det(C))


@dataclass(frozen=True)
class Textbook:
    """W as a function of the invariants I1, I2, J and I4 = a . C a, with its derivatives by them in closed form."""

    density: Callable[..., Any]
    slopes: Callable[..., tuple[Any, Any, Any, Any]]
    isotropic: bool = True

    def W(self, F: Array) -> float:
        C = F.T @ F
        return float(np.real(self.density(*invariants(C), FIBRE @ C @ FIBRE)))

    def stress(self, C: Array) -> Array:
        I1, I2, J = invariants(C)
        w1, w2, wJ, w4 = self.slopes(I1, I2, J, FIBRE @ C @ FIBRE)
        return 2 * ((w1 + w2 * I1) * ONE - w2 * C + w4 * np.outer(FIBRE, FIBRE)) + wJ * J * np.linalg.inv(C)

    def S(self, F: Array) -> Array:
        return np.real(self.stress(F.T @ F))

    def P(self, F: Array) -> Array:
        return F @ self.S(F)

    def C(self, F: Array) -> Array:
        """Return 2 dS/dC, by complex steps along symmetric directions."""
        right, h, result = (F.T @ F).astype(complex), 1e-30, np.zeros((3, 3, 3, 3))
        for k in range(3):
            for l in range(3):
                step = np.zeros((3, 3))
                step[k, l] += 0.5
                step[l, k] += 0.5
                result[:, :, k, l] = 2 * np.imag(self.stress(right + 1j * h * step)) / h
        return result


def volume(J: Any) -> tuple[Any, Any]:
    return LAM / 2 * np.log(J) ** 2 - MU * np.log(J), LAM * np.log(J) / J - MU / J


def stvk(I1: Any, I2: Any, J: Any, I4: Any) -> Any:
    trace, square = (I1 - 3) / 2, (I1**2 - 2 * I2 - 2 * I1 + 3) / 4
    return LAM / 2 * trace**2 + MU * square


LAWS = {
    "St. Venant-Kirchhoff": Textbook(stvk, lambda I1, I2, J, I4: (LAM * (I1 - 3) / 4 + MU * (I1 - 1) / 2, -MU / 2, 0, 0)),
    "modified Kirchhoff (Ciarlet-Geymonat's ln J)": Textbook(
        lambda I1, I2, J, I4: LAM / 2 * np.log(J) ** 2 + MU * (I1**2 - 2 * I2 - 2 * I1 + 3) / 4,
        lambda I1, I2, J, I4: (MU * (I1 - 1) / 2, -MU / 2, LAM * np.log(J) / J, 0),
    ),
    "neo-Hookean (Bonet-Wood)": Textbook(
        lambda I1, I2, J, I4: MU / 2 * (I1 - 3) + volume(J)[0], lambda I1, I2, J, I4: (MU / 2, 0, volume(J)[1], 0)
    ),
    "neo-Hookean (Simo-Pister)": Textbook(
        lambda I1, I2, J, I4: MU / 2 * (I1 - 3) - MU * np.log(J) + LAM / 4 * (J**2 - 1) - LAM / 2 * np.log(J),
        lambda I1, I2, J, I4: (MU / 2, 0, -MU / J + LAM / 2 * (J - 1 / J), 0),
    ),
    "Mooney-Rivlin": Textbook(
        lambda I1, I2, J, I4: 1.2 * (I1 - 3) + 0.8 * (I2 - 3) - 5.6 * np.log(J) + 3 * (J - 1) ** 2,
        lambda I1, I2, J, I4: (1.2, 0.8, -5.6 / J + 6 * (J - 1), 0),
    ),
    "isochoric neo-Hookean": Textbook(
        lambda I1, I2, J, I4: MU / 2 * (J ** (-2 / 3) * I1 - 3) + 6 * (J - 1) ** 2,
        lambda I1, I2, J, I4: (MU / 2 * J ** (-2 / 3), 0, -MU / 3 * J ** (-5 / 3) * I1 + 12 * (J - 1), 0),
    ),
    "Yeoh": Textbook(
        lambda I1, I2, J, I4: 2 * (I1 - 3) - 0.1 * (I1 - 3) ** 2 + 0.02 * (I1 - 3) ** 3 + volume(J)[0],
        lambda I1, I2, J, I4: (2 - 0.2 * (I1 - 3) + 0.06 * (I1 - 3) ** 2, 0, volume(J)[1], 0),
    ),
    "Gent": Textbook(
        lambda I1, I2, J, I4: -MU * 30 / 2 * np.log(1 - (I1 - 3) / 30) + volume(J)[0],
        lambda I1, I2, J, I4: (MU / 2 / (1 - (I1 - 3) / 30), 0, volume(J)[1], 0),
    ),
    "Blatz-Ko": Textbook(
        lambda I1, I2, J, I4: MU / 2 * (I2 / J**2 + 2 * J - 5), lambda I1, I2, J, I4: (0, MU / 2 / J**2, MU - MU * I2 / J**3, 0)
    ),
    "Holzapfel-Gasser-Ogden": Textbook(
        lambda I1, I2, J, I4: MU / 2 * (I1 - 3) + volume(J)[0] + 3 / 2 * (np.exp((I4 - 1) ** 2) - 1),
        lambda I1, I2, J, I4: (MU / 2, 0, volume(J)[1], 3 * (I4 - 1) * np.exp((I4 - 1) ** 2)),
        isotropic=False,
    ),
}

ORDERS = {
    "23-13-12": [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)],
    "12-13-23": [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)],
    "12-23-13": [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2)],
}


def voigt(C: Array, order: str, engineering: bool = True) -> Array:
    """Return the (6, 6) matrix that acts on engineering shear strain, or on shear components E_ij."""
    pairs = ORDERS[order]
    M = np.array([[C[i, j, k, l] for k, l in pairs] for i, j in pairs])
    if not engineering:
        M[:, 3:] *= 2
    return M
