"""Where strong ellipticity is lost: the smallest eigenvalue of the acoustic tensor vanishes at the closed stretches.

Q(n) = (lam + mu) f f' + mu F F' + (n . S n) I,   f = F n

hydrostatic              F = s I           s^2 = (1 + nu)/(2 - nu)
plane strain, equal      F = diag(s, s)    s^2 = 1/(2 (1 - nu))
uniaxial strain          F = diag(s, 1)    see `uniaxial`
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from skfem_stvk import StVK
from skfem_stvk.arguments import Array
from skfem_stvk.results import Fields

from ..statics.meshes import moved_box
from ..statics.study import Study
from .not_found import NotFoundError

YOUNG, POISSON = 1.0e5, (0.0, 0.3, 0.45)
#: Of the stretch: eigenvalues vanish with a slope of about E, and are good to 1e-13 of it.
LIMIT = 1e-9
#: Of stretches in which it is looked for.
RANGE = 0.5, 0.999


def hydrostatic(nu: float) -> float:
    """`s` at which waves across every direction stop: `mu s^2 + (3 lam + 2 mu)(s^2 - 1)/2 = 0`."""
    return float(np.sqrt((1 + nu) / (2 - nu)))


def equal(nu: float) -> float:
    """`s` at which waves in the plane stop: `mu s^2 + (lam + mu)(s^2 - 1) = 0`."""
    return float(np.sqrt(1 / (2 * (1 - nu))))


def uniaxial(nu: float) -> float:
    """`s` at which waves in the plane of the strain's axis stop.

    With `x = n_1^2`, `e = (s^2 - 1)/2`, `det Q(x)` is quadratic: `a = 4 mu (lam + 2 mu) e^2`, `b = e B`, `c`. It touches zero where
    `B^2 = 16 mu (lam + 2 mu) c`, for `mu = 1`, `lam = l = 2 nu/(1 - 2 nu)` and `y = s^2` the smaller root of

        ((1 + l)(2 + l) y + 4 - l - l^2)^2 = 4 (2 + l)((2 + l) y - l)(l y + 4 + l)

    >>> round(uniaxial(0.0) - (2 - 2**0.5), 12)
    0.0
    """
    lam = 2 * nu / (1 - 2 * nu)
    B = np.poly1d([(1 + lam) * (2 + lam), 4 - lam - lam**2])
    c = 4 * (2 + lam) * np.poly1d([2 + lam, -lam]) * np.poly1d([lam, 4 + lam])
    return float(np.sqrt(min((B * B - c).roots)))


class Case(NamedTuple):
    """Homogeneous states by the dimension of simplices and their stretches, and where ellipticity is lost, by nu."""

    name: str
    k: int
    stretches: Callable[[float], tuple[float, ...]]
    critical: Callable[[float], float]


CASES = (
    Case("hydrostatic, tetrahedra", 3, lambda s: (s, s, s), hydrostatic),
    Case("equal in plane strain, triangles", 2, lambda s: (s, s), equal),
    Case("uniaxial strain, triangles", 2, lambda s: (s, 1.0), uniaxial),
    Case("uniaxial strain, tetrahedra", 3, lambda s: (s, 1.0, 1.0), uniaxial),
)


def ellipticity(quick: bool = False) -> Study:
    """the smallest acoustic eigenvalue vanishes where strong ellipticity is lost in closed form"""
    found = [(case.name, nu, case.critical(nu), lost(case, nu, n=2 if quick else 4)) for case in CASES for nu in POISSON]
    return Study(
        "Loss of strong ellipticity",
        f"the smallest acoustic eigenvalue of all elements vanishes at the closed stretches to {LIMIT:g}",
        ("state", "nu", "closed form", "first element", "last element", "off"),
        tuple(
            (name, f"{nu:g}", f"{s:.10f}", *(f"{one:.10f}" for one in ends), f"{_off(s, ends):.1e}") for name, nu, s, ends in found
        ),
        tuple(
            f"{name}, nu = {nu:g}: lost at {ends}, expected {s:.10f}" for name, nu, s, ends in found if not _off(s, ends) <= LIMIT
        ),
        ("unstructured meshes, inner vertices moved at random, half of the simplices turned round, every state rotated",),
    )


def _off(s: float, ends: tuple[float, float]) -> float:
    return max(abs(end - s) for end in ends)


def lost(case: Case, nu: float, n: int) -> tuple[float, float]:
    """The stretches at which the first and the last element of a mesh lose it."""
    mesh = moved_box(case.k, n)
    fields, turn = Fields(mesh, StVK(young=YOUNG, poisson=nu)), rotation(case.k)

    def eigenvalues(s: float) -> Array:
        F = turn @ np.diag(case.stretches(s))
        values = fields.at(((F - np.eye(case.k)) @ mesh.p).T.ravel())["smallest_acoustic_eigenvalue"]
        return np.asarray(values) / YOUNG

    return _root(lambda s: float(eigenvalues(s).min())), _root(lambda s: float(eigenvalues(s).max()))


def _root(function: Callable[[float], float]) -> float:
    if not function(RANGE[0]) * function(RANGE[1]) < 0:
        raise NotFoundError(f"The acoustic eigenvalues do not vanish between the stretches {RANGE[0]} and {RANGE[1]}.")
    return float(brentq(function, *RANGE, xtol=1e-13))


def rotation(k: int) -> Array:
    """Some rotation of a plane, or of space about (1, 2, 3)."""
    turned: Array = Rotation.from_rotvec(np.array([0.3, 0.6, 0.9]) if k == 3 else np.array([0.0, 0.0, 0.7])).as_matrix()
    return turned[:k, :k]
