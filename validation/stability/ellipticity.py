"""Study of the loss of strong ellipticity: the smallest eigenvalue of the acoustic tensor vanishes at stretches in closed form.

    Q(n) = (lam + mu) f f' + mu F F' + (n . S n) I,   f = F n

The critical stretches are:

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
#: Limit of the error of the stretch. Eigenvalues vanish with a slope of about E and have errors of 1e-13 E.
LIMIT = 1e-9
#: Interval of stretches for the search.
RANGE = 0.5, 0.999


def hydrostatic(nu: float) -> float:
    """Return the stretch `s` at which the speed of transverse waves vanishes: `mu s^2 + (3 lam + 2 mu)(s^2 - 1)/2 = 0`."""
    return float(np.sqrt((1 + nu) / (2 - nu)))


def equal(nu: float) -> float:
    """Return the stretch `s` at which the speed of waves in the plane vanishes: `mu s^2 + (lam + mu)(s^2 - 1) = 0`."""
    return float(np.sqrt(1 / (2 * (1 - nu))))


def uniaxial(nu: float) -> float:
    """Return the stretch `s` at which the speed of waves in a plane of the strain's axis vanishes.

    With `x = n_1^2`, `e = (s^2 - 1)/2`, `det Q(x)` is quadratic: `a = 4 mu (lam + 2 mu) e^2`, `b = e B`, `c`. The double root of
    `det Q` has `B^2 = 16 mu (lam + 2 mu) c`. For `mu = 1`, `lam = l = 2 nu/(1 - 2 nu)`, this gives `y = s^2` as the smaller root of

        ((1 + l)(2 + l) y + 4 - l - l^2)^2 = 4 (2 + l)((2 + l) y - l)(l y + 4 + l)

    >>> round(uniaxial(0.0) - (2 - 2**0.5), 12)
    0.0
    """
    lam = 2 * nu / (1 - 2 * nu)
    B = np.poly1d([(1 + lam) * (2 + lam), 4 - lam - lam**2])
    c = 4 * (2 + lam) * np.poly1d([2 + lam, -lam]) * np.poly1d([lam, 4 + lam])
    return float(np.sqrt(min((B * B - c).roots)))


class Case(NamedTuple):
    """Homogeneous state: dimension of the simplices, principal stretches as functions of s, and the critical s by nu."""

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
    """the smallest acoustic eigenvalue vanishes at the stretches at which closed forms predict loss of strong ellipticity"""
    found = [(case.name, nu, case.critical(nu), lost(case, nu, n=2 if quick else 4)) for case in CASES for nu in POISSON]
    return Study(
        "Loss of strong ellipticity",
        f"the smallest acoustic eigenvalue of all elements vanishes at the stretches of the closed forms, to {LIMIT:g}",
        ("state", "nu", "closed form", "first element", "last element", "off"),
        tuple(
            (name, f"{nu:g}", f"{s:.10f}", *(f"{one:.10f}" for one in ends), f"{_off(s, ends):.1e}") for name, nu, s, ends in found
        ),
        tuple(
            f"{name}, nu = {nu:g}: lost at {ends}, expected {s:.10f}" for name, nu, s, ends in found if not _off(s, ends) <= LIMIT
        ),
        ("unstructured meshes, random inner vertices, half of the simplices with negative orientation, every state rotated",),
    )


def _off(s: float, ends: tuple[float, float]) -> float:
    return max(abs(end - s) for end in ends)


def lost(case: Case, nu: float, n: int) -> tuple[float, float]:
    """Return the stretches at which the first and the last element of a mesh lose strong ellipticity."""
    mesh = moved_box(case.k, n)
    fields, R = Fields(mesh, StVK(young=YOUNG, poisson=nu)), rotation(case.k)

    def eigenvalues(s: float) -> Array:
        F = R @ np.diag(case.stretches(s))
        values = fields.at(((F - np.eye(case.k)) @ mesh.p).T.ravel())["smallest_acoustic_eigenvalue"]
        return np.asarray(values) / YOUNG

    return _root(lambda s: float(eigenvalues(s).min())), _root(lambda s: float(eigenvalues(s).max()))


def _root(function: Callable[[float], float]) -> float:
    if not function(RANGE[0]) * function(RANGE[1]) < 0:
        raise NotFoundError(f"The acoustic eigenvalues do not vanish between the stretches {RANGE[0]} and {RANGE[1]}.")
    return float(brentq(function, *RANGE, xtol=1e-13))


def rotation(k: int) -> Array:
    """Return a rotation in the plane, or in space about (1, 2, 3)."""
    R: Array = Rotation.from_rotvec(np.array([0.3, 0.6, 0.9]) if k == 3 else np.array([0.0, 0.0, 0.7])).as_matrix()
    return R[:k, :k]
