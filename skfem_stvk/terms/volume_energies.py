"""Energies of the volume ratio of elements, and the stiffness that they need."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..arguments import Array
from ..kernels.penalty import BARRIER, COMPRESSION, QUADRATIC


@dataclass(frozen=True)
class VolumeEnergy:
    """Energy density of the volume ratio for a stiffness of 1, as a function of `e = J - 1`, which is more accurate than `J`.

    Attributes
    ----------
    number
        Number of the energy in the kernels.
    density, slope, curvature
        Functions `psi`, `psi'` and `psi''` of `e`.
    least
        Smallest stiffness over `lam + 2 mu` for which confined compression has no limit point.
    usual
        The default stiffness over `lam + 2 mu`. With the least stiffness, a cube with both ends constrained still buckles in
        crushing. With this one it is stable to 60 % (except "quadratic" at nu = 0; `docs/measurements/inversion.md`).

    Notes
    -----
    In uniaxial strain `s` the nominal stress of a St. Venant-Kirchhoff material is `H/2 (s^3 - s)` with `H = lam + 2 mu`, and `J =
    s`. With the penalty it is `H/2 (s^3 - s) + k psi'(s)`, which rises with `s` for all `0 < s < 1` if::

        k/H >= least = max over s of (1 - 3 s^2) / (2 psi''(s))

        quadratic      psi'' = 1             1/2, at s = 0
        compression    psi'' = 2 (1 - s)     c = (3 - sqrt(6))/2 = 0.27526, at s = 2 c/3, a double root: 4 c^2 - 12 c + 3 = 0
        barrier        psi'' = -2 ln s + 4 (1 - s)/s + (1 - s)^2/s^2
                                             0.025802..., at s = 0.40536...: the maximum has no closed form
    """

    number: int
    density: Callable[[Array], Array]
    slope: Callable[[Array], Array]
    curvature: Callable[[Array], Array]
    least: float
    usual: float


def _barrier_density(e: Array) -> Array:
    x = np.minimum(e, 0.0)
    return -(x**2) * np.log1p(x)


def _barrier_slope(e: Array) -> Array:
    x = np.minimum(e, 0.0)
    return -(2 * x * np.log1p(x) + x**2 / (1 + x))


def _barrier_curvature(e: Array) -> Array:
    e = np.minimum(e, 0.0)
    x = e / (1 + e)
    return -2 * np.log1p(e) - 4 * x + x**2


ENERGIES = {
    "quadratic": VolumeEnergy(QUADRATIC, lambda e: e**2 / 2, lambda e: e, np.ones_like, 1 / 2, 1.0),
    "compression": VolumeEnergy(
        COMPRESSION,
        lambda e: -(np.minimum(e, 0.0) ** 3) / 3,
        lambda e: -(np.minimum(e, 0.0) ** 2),
        lambda e: -2 * np.minimum(e, 0.0),
        (3 - 6**0.5) / 2,
        0.8,
    ),
    "barrier": VolumeEnergy(BARRIER, _barrier_density, _barrier_slope, _barrier_curvature, 0.02580234686556834, 0.15),
}
