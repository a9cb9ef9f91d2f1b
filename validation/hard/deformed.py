"""Large deformations in few steps: torsion, stretch and shear."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from scipy.optimize import brentq

from . import meshes, truths
from .case import Array, Body, Case

YOUNG, POISSON = 1e5, 0.3
LENGTH, LONG, SHORT = 3.0, 10.0, 5.0
ALONG_X = np.array([[1.0], [0.0], [0.0]])


def deformed() -> list[Case]:
    by_180 = replace(_twist(180, 2), quick=False)
    return [_twist(90, 1), by_180, _twist(360, 4), _twist_too_far(), *_stretch(), *_shear()]


def _twist(degrees: float, steps: int) -> Case:
    make = partial(_twisted, LONG, degrees)
    return Case(
        f"twist a bar of 10 x 1 x 1 by {degrees}°",
        make,
        steps,
        truths.tiny_steps(make, 10 * steps),
        truths.tiny_steps(make, 10 * steps, volume=True),
    )


def _twist_too_far() -> Case:
    make = partial(_twisted, SHORT, 360)
    return Case(
        "twist a bar of 5 x 1 x 1 by 360°",
        make,
        4,
        truths.none("in tiny steps, by scikit-fem, the branch ends at 242°", *truths.ENDS),
        truths.tiny_steps(make, 40, volume=True),
        invertible=truths.tiny_steps_of_invertible(make, 40),
    )


def _twisted(length: float, degrees: float) -> Body:
    return Body(
        meshes.bar(length, 2),
        YOUNG,
        POISSON,
        fixed={lambda x: x[0] == 0: "xyz"},
        prescribed={lambda x: x[0] == length: partial(_rotation, np.radians(degrees))},
    )


def _rotation(angle: float, x: Array, t: float) -> Array:
    """Return the displacements of a rotation about the bar's axis."""
    y, z = x[1] - 0.5, x[2] - 0.5
    c, s = np.cos(angle * t), np.sin(angle * t)
    return np.stack([0 * y, (c - 1) * y - s * z, s * y + (c - 1) * z])


def _stretch() -> list[Case]:
    rollers, held, free = partial(_on_rollers, 3.0), partial(_between_clamps, 0.05), partial(_pulled, POISSON)
    closed = truths.homogeneous(np.diag([4.0, 1, 1]), "closed form: uniaxial strain")
    return [
        Case("stretch by 300 %, sides on rollers", rollers, 1, closed, closed),
        Case(
            "stretch by 300 % between clamps, nu = 0.05",
            held,
            3,
            truths.tiny_steps(held, 30),
            truths.tiny_steps(held, 30, volume=True),
        ),
        Case(
            "stretch by 300 %, sides free, nu = 0.3",
            free,
            3,
            truths.none("closed form: no cross-section is left at stretch 2.08"),
            truths.homogeneous(np.diag([4.0, *[_side_left(4.0)] * 2]), "closed form: the volume term leaves a cross-section"),
        ),
    ]


def _on_rollers(stretch: float) -> Body:
    sides = {lambda x: (x[1] == 0) | (x[1] == 1): "y", lambda x: (x[2] == 0) | (x[2] == 1): "z"}
    return Body(
        meshes.bar(LENGTH),
        YOUNG,
        POISSON,
        fixed={lambda x: x[0] == 0: "x"} | sides,
        prescribed={lambda x: x[0] == LENGTH: {"x": stretch * LENGTH}},
    )


def _between_clamps(poisson: float) -> Body:
    ends = {"x": 3 * LENGTH, "y": 0.0, "z": 0.0}
    return Body(meshes.bar(LENGTH), YOUNG, poisson, fixed={lambda x: x[0] == 0: "xyz"}, prescribed={lambda x: x[0] == LENGTH: ends})


def _pulled(poisson: float) -> Body:
    planes = {lambda x: x[0] == 0: "x", lambda x: x[1] == 0: "y", lambda x: x[2] == 0: "z"}
    return Body(meshes.bar(LENGTH), YOUNG, poisson, fixed=planes, prescribed={lambda x: x[0] == LENGTH: {"x": 3 * LENGTH}})


def _side_left(stretch: float) -> float:
    """Return the deformed side of a unit cross-section under uniaxial stress, with the default barrier against loss of volume.

    lam tr E + 2 mu E_22 + k psi'(J) stretch = 0        psi' = -(2 (J - 1) ln J + (J - 1)^2/J),  J = stretch r^2
    """
    lam, mu = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON)), YOUNG / (2 * (1 + POISSON))

    def force(r: float) -> float:
        across, along, J = (r**2 - 1) / 2, (stretch**2 - 1) / 2, stretch * r**2
        slope = -(2 * (J - 1) * np.log(J) + (J - 1) ** 2 / J)
        return lam * (along + 2 * across) + 2 * mu * across + 0.15 * (lam + 2 * mu) * slope * stretch

    return float(brentq(force, 1e-6, stretch**-0.5, xtol=1e-14))


def _shear() -> list[Case]:
    closed = truths.homogeneous(np.eye(3) + 2 * np.outer([1, 0, 0], [0, 1, 0]), "closed form: simple shear")
    plates, invertible = _between_plates, truths.tiny_steps_of_invertible(_between_plates, 20)
    with_volume = truths.tiny_steps(plates, 20, volume=True)
    return [
        Case("shear by 200 %, whole boundary", _sheared_boundary, 1, closed, closed),
        Case("shear by 200 % between plates", plates, 4, truths.tiny_steps(plates, 20), with_volume, invertible=invertible),
    ]


def _sheared_boundary() -> Body:
    return Body(
        meshes.bar(1.0, 5),
        YOUNG,
        POISSON,
        prescribed={lambda x: ((x == 0) | (x == 1)).any(axis=0): lambda x, t: 2 * t * x[[1]] * ALONG_X},
    )


def _between_plates() -> Body:
    plate = {"x": 2.0, "y": 0.0, "z": 0.0}
    return Body(meshes.bar(1.0, 5), YOUNG, POISSON, fixed={lambda x: x[1] == 0: "xyz"}, prescribed={lambda x: x[1] == 1: plate})
