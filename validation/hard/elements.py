"""Materials and elements that lose digits: nearly incompressible, 1e8 times as stiff, slivers, flat and graded meshes."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from scipy.optimize import brentq

from skfem_stvk import ElementMesh, System, Traction

from . import meshes, truths
from .case import Array, Body, Case

YOUNG, POISSON = 1e5, 0.3
SOFT, STIFF = 1e3, 1e11
STRETCH = 1.2
#: Limit of the relative error if stiffnesses differ by 1e6 or more, where rounding leaves 1e-5 of the displacements.
ROUNDED = 1e-4


def elements() -> list[Case]:
    slivers = partial(meshes.with_slivers, meshes.bar(3.0, 4), 1.0)
    plate = partial(meshes.box, [np.linspace(0, 1, 6), np.linspace(0, 1, 6), np.array([0, 2e-4])])
    uniaxial = truths.homogeneous(np.diag([STRETCH, *[_narrowing(STRETCH)] * 2]), "closed form: uniaxial stress")
    rounded = replace(uniaxial, limit=ROUNDED)
    layered = truths.state("closed form: layers in series", _layers_in_series)
    return [
        _followed("bend a bar, nu = 0.499", partial(_bent, partial(meshes.bar, 3.0, 3), 0.499, 2e3), 4, says=("lock",)),
        Case("pull a bar with slivers of 1°", partial(_pulled, slivers, 3.0), 1, uniaxial, uniaxial),
        replace(_followed("bend a bar with slivers of 1°", partial(_bent, slivers, POISSON, 2e3), 4), quick=False),
        Case("pull a plate of elements 1:1000", partial(_pulled, plate, 1.0), 1, rounded, rounded),
        _followed("bend a plate of elements 1:1000", partial(_bent, plate, POISSON, 1e-1, 1.0), 4, limit=ROUNDED),
        Case("pull layers of stiffness 1 : 1e8", _layered, 2, layered, layered),
        _far_sheared("shear a stiff core in a soft cube, 1 : 1e8", _cored, ROUNDED),
        _far_sheared("shear a mesh graded 1 : 1e4", _graded),
    ]


def _followed(name: str, make: truths.Make, steps: int, limit: float = truths.LIMIT, says: tuple[str, ...] = ()) -> Case:
    """Return a case whose right outcome is a path in smaller steps."""
    truth, with_volume = (truths.tiny_steps(make, 3 * steps, volume, limit, says) for volume in (False, True))
    return Case(name, make, steps, truth, with_volume)


def _far_sheared(name: str, make: truths.Make, limit: float = truths.LIMIT) -> Case:
    """Return a case in which `InvertibleStVK` has another state than `StVK`, because stretches are below its threshold."""
    return replace(_followed(name, make, 4, limit), invertible=truths.tiny_steps_of_invertible(make, 12, limit))


def _narrowing(stretch: float) -> float:
    """Return the transverse stretch under uniaxial tension: `r^2 = 1 - 2 nu e`, `e = (s^2 - 1)/2`."""
    return float(np.sqrt(1 - POISSON * (stretch**2 - 1)))


def _pulled(mesh: truths.MakeMesh, length: float) -> Body:
    """Return a body between rollers under a tensile traction."""
    nominal = YOUNG * STRETCH * (STRETCH**2 - 1) / 2
    planes = {lambda x: x[0] == 0: "x", lambda x: x[1] == 0: "y", lambda x: x[2] == 0: "z"}
    return Body(mesh(), YOUNG, POISSON, (Traction(lambda x: x[0] == length, (nominal, 0, 0)),), planes)


def _bent(mesh: truths.MakeMesh, poisson: float, traction: float, length: float = 3.0) -> Body:
    load = Traction(lambda x: x[0] == length, (0, 0, -traction))
    return Body(mesh(), YOUNG, poisson, (load,), {lambda x: x[0] == 0: "xyz"})


def _layered() -> Body:
    """Return three layers with a soft one in the middle, stretched by a third of a layer between rollers."""
    mesh = meshes.bar(3.0, 3, amount=0.0)
    young = np.where(np.abs(mesh.p[0, mesh.t].mean(axis=0) - 1.5) < 0.5, SOFT, STIFF)
    sides = {lambda x: (x[1] == 0) | (x[1] == 1): "y", lambda x: (x[2] == 0) | (x[2] == 1): "z"}
    return Body(mesh, young, POISSON, fixed={lambda x: x[0] == 0: "x"} | sides, prescribed={lambda x: x[0] == 3: {"x": 1 / 3}})


def _layers_in_series(system: System) -> Array:
    """Return displacements of uniaxial strain in each layer.

    `(lam + 2 mu)/2 (s^3 - s)` is the same in all layers, and `2 s_stiff + s_soft` is the whole length.
    """

    def stiff(soft: float) -> float:
        return 1 + SOFT / STIFF * (soft**3 - soft) / 2  # (s^3 - s)/2 = s - 1 to 1e-16 for these s

    soft = brentq(lambda s: 2 * stiff(s) + s - 3 - 1 / 3, 1.0, 2.0, xtol=1e-15)
    x, u = system.mesh.p[0], np.zeros((system.mesh.nv, 3))
    u[:, 0] = np.interp(x, [0, 1, 2, 3], np.cumsum([0, stiff(soft) - 1, soft - 1, stiff(soft) - 1]))
    return u.ravel()


def _cored() -> Body:
    """Return a cube with a stiff core."""
    mesh = meshes.bar(1.0, 5)
    young = np.where((np.abs(mesh.p[:, mesh.t].mean(axis=1) - 0.5) < 0.25).all(axis=0), STIFF, SOFT)
    return _sheared(mesh, young)


def _graded() -> Body:
    return _sheared(meshes.graded(), YOUNG)


def _sheared(mesh: ElementMesh, young: float | Array) -> Body:
    plate = {"x": 0.5, "y": 0.0, "z": 0.0}
    return Body(mesh, young, POISSON, fixed={lambda x: x[1] == 0: "xyz"}, prescribed={lambda x: x[1] == 1: plate})
