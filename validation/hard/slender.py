"""Slender bodies in large bending, by every linear solver: stable, but K is nearly singular relative to the axial stiffness."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
import skfem

from skfem_stvk import ElementMesh, Traction
from skfem_stvk.linear import SOLVERS
from skfem_stvk.linear.pardiso import pardiso_is_installed

from . import meshes, truths
from .case import Body, Case

YOUNG, THICKNESS = 1.2e6, 0.1
#: Load as a multiple of `E I/L^2`.
LOAD = 2.0
#: Limit of the relative error; for a length of a thousand thicknesses, rounding leaves 1e-6 of the displacements.
ROUNDED = 1e-4


def slender() -> list[Case]:
    strips = [partial(_strip, ratio, cells, 2) for ratio, cells in ((100, 100), (1000, 200))]
    bars = [partial(_bar, ratio, cells) for ratio, cells in ((100, 60), (1000, 120))]
    cases = [case for make in (*strips, *bars) for case in _by_every_solver(make, quick=make in (strips[0], bars[1]))]
    fine = partial(_strip, 100, 800, 8, load=4.0, poisson=0.0)
    return [*cases, replace(_case(fine, "strip, 800 x 8 cells, 100 : 1, by amg-cg", "amg-cg"), quick=False)]


def _by_every_solver(make: partial[Body], quick: bool) -> Iterator[Case]:
    """Yield the case for all methods with the solver "auto", and for the default method with each other solver."""
    ratio, shape = make.args[0], "strip" if make.func is _strip else "bar"
    yield replace(_case(make, f"{shape}, {ratio} : 1"), methods=None, quick=quick)
    for solver in SOLVERS[1:]:
        if solver.name != "pardiso" or pardiso_is_installed():
            yield replace(
                _case(make, f"{shape}, {ratio} : 1, by {solver.name}", solver.name), quick=quick and solver.name == "amg-cg"
            )


def _case(make: truths.Make, what: str, solver: str = "auto") -> Case:
    truth, with_volume = (truths.tiny_steps(make, 20, volume, ROUNDED) for volume in (False, True))
    return Case(f"bend a {what}", make, 10, truth, with_volume, methods=("default",), solver=solver)


def _strip(ratio: int, cells: int, across: int, load: float = LOAD, poisson: float = 0.3) -> Body:
    """Return a strip of triangles in plane strain."""
    mesh = skfem.MeshTri.init_tensor(np.linspace(0, ratio * THICKNESS, cells + 1), np.linspace(0, THICKNESS, across + 1))
    return _bent(ElementMesh(mesh.p, mesh.t), ratio, load, poisson, 0.0)


def _bar(ratio: int, cells: int) -> Body:
    """Return a bar of tetrahedra, one cell across."""
    lines = np.linspace(0, ratio * THICKNESS, cells + 1), *[np.linspace(0, THICKNESS, 2)] * 2
    return _bent(meshes.box(lines), ratio, LOAD, 0.3, 0.0, 0.0)


def _bent(mesh: ElementMesh, ratio: int, load: float, poisson: float, *others: float) -> Body:
    """Return a body clamped at one end. The traction at the other end is `load E I/(A L^2)`."""
    traction = load * YOUNG / (12 * ratio**2)
    pulled = Traction(lambda x: x[0] == mesh.p[0].max(), (*others, -traction))
    return Body(mesh, YOUNG, poisson, (pulled,), {lambda x: x[0] == 0: "xyz"[: mesh.d]})
