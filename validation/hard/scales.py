"""The same body far from the origin, in other units, and under loads of any size."""

from __future__ import annotations

from functools import partial

import numpy as np

from skfem_stvk import ElementMesh, System, Traction

from . import meshes, truths
from .case import Array, Body, Case, Truth, made
from .tiny_steps import by_scikit_fem, followed

YOUNG, POISSON = 1e5, 0.3
LENGTH = 2.0
FAR = np.array([[1e6], [-1e6], [1e6]])


def scales() -> list[Case]:
    near = partial(_bent, 1.0, 0.0)
    far = partial(_bent, 1.0, 1.0)
    in_mm = partial(_bent, 1e3, 0.0)
    tiny = partial(_bent, 1.0, 0.0, 1e-9)
    huge = truths.state("closed form: uniaxial strain", _pulled_far)
    return [
        Case("1e6 m from the origin", far, 4, _as(near, 1.0, False), _as(near, 1.0, True)),
        Case("the same in mm and MPa", in_mm, 4, _as(near, 1e3, False), _as(near, 1e3, True)),
        Case("a load of 1e-9 of the natural one", tiny, 2, _linear(tiny), _linear(tiny)),
        Case("pull with 1e9 of the natural load", partial(_on_rollers, 1e9), 10, huge, huge),
        Case(
            "press with 1e9 of the natural load",
            partial(_on_rollers, -1e9),
            10,
            truths.none("closed form: uniaxial strain has a largest pressure of 0.19 (lam + 2 mu)", r"t = ", r"load|give"),
            truths.none("closed form: with the volume term the volume ratio would be 1e-10", r"t = ", r"load|give"),
        ),
    ]


def _bent(unit: float, away: float, load: float = 0.03) -> Body:
    """Return a short cantilever on a binary grid, in units of 1/unit m. The traction is `load` times Young's modulus."""
    mesh = meshes.bar(LENGTH, 3)
    p = np.round(mesh.p * 2**16) / 2**16
    end = unit * p[0].max() + away * FAR[0, 0]
    young = YOUNG / unit**2
    start = away * FAR[0, 0]
    return Body(
        ElementMesh(unit * p + away * FAR, mesh.t),
        young,
        POISSON,
        (Traction(lambda x: x[0] == end, (0, 0, -load * young)),),
        {lambda x: x[0] == start: "xyz"},
    )


def _as(make: truths.Make, unit: float, volume: bool) -> Truth:
    """Return the solution at the origin, in m, by tiny steps."""
    source = "20 steps of Newton" + (", own assembly" if volume else ", scikit-fem") + ", at the origin in m"
    return truths.state(source, lambda system: unit * followed(make, volume, 20, system.mesh.element.degree))


def _linear(make: truths.Make) -> Truth:
    """Return the solution of linear elasticity with scikit-fem's tangent at rest."""

    def expected(system: System) -> Array:
        u = np.zeros(system.ndofs)
        K = by_scikit_fem(made(make, system.mesh.element.degree))[1](u)
        free = np.setdiff1d(np.arange(system.ndofs), system.supports.held)
        u[free] = np.linalg.solve(K[free][:, free].toarray(), system.external_force(u)[free])
        return u

    return truths.state("linear elasticity, scikit-fem", expected)


def _on_rollers(load: float) -> Body:
    """Return a bar between rollers on all sides. The traction is `load` times Young's modulus."""
    sides = {lambda x: (x[1] == 0) | (x[1] == 1): "y", lambda x: (x[2] == 0) | (x[2] == 1): "z"}
    traction = Traction(lambda x: x[0] == LENGTH, (load * YOUNG, 0, 0))
    return Body(meshes.bar(LENGTH, 3), YOUNG, POISSON, (traction,), {lambda x: x[0] == 0: "x"} | sides)


def _pulled_far(system: System) -> Array:
    """Return the displacements of uniaxial strain with `(lam + 2 mu)/2 (s^3 - s) = P`."""
    H = YOUNG * (1 - POISSON) / ((1 + POISSON) * (1 - 2 * POISSON))
    roots = np.roots([1, 0, -1, -2 * 1e9 * YOUNG / H])
    stretch = float(roots[np.abs(roots.imag) < 1e-9 * np.abs(roots)].real.max())
    return (system.mesh.p * [[stretch - 1], [0], [0]]).ravel("F")
