"""Buckling, and mechanisms: a thin sheet, an arch, columns, hinges, and parts joined by one node."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import skfem
from numpy.typing import NDArray

from skfem_stvk import ElasticFoundation, ElementMesh, Pressure, System, Traction

from . import meshes, truths
from .case import Array, Body, Case, Truth

YOUNG, POISSON = 1e5, 0.3
THICKNESS = 0.02
#: Methods for loads that follow the body. The clamped tangent is omitted, because its step length needs a potential.
FOLLOWED = ("plain Newton", "default", "default + volume", "default, invertible")


def unstable() -> list[Case]:
    stable, perfect = truths.any_stable(), truths.any_stable("imperfection")
    straight = Truth("by symmetry: it stays straight, and no other state exists", _off_axis, 1e-6, ("flutter not checked",))
    block, edge, node = meshes.cube(2), _joined((1.0, 0.0, 1.0)), _joined((1.0, 1.0, 1.0))
    return [
        Case("crush a thin sheet by 10 %", partial(_sheet, 0.1), 10, perfect, perfect),
        Case("press a column whose head is held across", partial(_column, True), 4, perfect, perfect, methods=FOLLOWED),
        Case("press a column whose load follows its free head", partial(_column, False), 4, straight, straight, methods=FOLLOWED),
        Case("press an arch from outside", _arch, 10, perfect, perfect, methods=FOLLOWED),
        Case("crush a thin sheet on a soft bed by 15 %, pushed", partial(_sheet, 0.15, bed=1e4, push=20.0), 10, stable, stable),
        _loose("a block held by one edge", block, lambda x: (x[0] == 0) & (x[2] == 0), "rotation"),
        _loose("two parts joined by one edge", edge, lambda x: x[0] == 0, "can rotate about the line", r"elements \(\d"),
        _loose("two parts joined by one node", node, lambda x: x[0] == 0, "can rotate about 1 vertex", r"elements \(\d"),
    ]


def _column(held_head: bool) -> Body:
    """Return a column under a pressure on its head. With a laterally supported head, the pressure exceeds the buckling load.

    With a free head, the load follows the head: Beck's column, whose only equilibrium is the straight one.
    """
    mesh = skfem.MeshQuad.init_tensor(np.linspace(0, 20, 41), np.linspace(-0.5, 0.5, 3)).to_meshtri(style="x")
    fixed = {lambda x: x[0] < 0.01: "xy"} | ({_head: "y"} if held_head else {})
    return Body(ElementMesh(mesh.p, mesh.t), 1e4, POISSON, (Pressure(_head, 117.0),), fixed)


def _head(x: Array) -> NDArray[np.bool_]:
    return x[0] > 19.9


def _off_axis(system: System, u: Array) -> float:
    """Return the transverse displacement of a column's axis, relative to the largest displacement."""
    axis = np.flatnonzero(system.mesh.p[1] == 0)
    return float(np.abs(u.reshape(-1, 2)[axis, 1]).max() / np.abs(u).max())


def _arch() -> Body:
    """Return a deep arch of 215 degrees with clamped ends; it buckles at three quarters of the pressure."""
    mesh = skfem.MeshTri.init_tensor(np.linspace(0, 1, 81), np.linspace(-0.5, 0.5, 3))
    angle, radius = (mesh.p[0] - 0.5) * 2 * np.radians(107.5), 1 + THICKNESS * mesh.p[1]
    outside = mesh.facets[:, mesh.facets_satisfying(lambda x: np.isclose(x[1], 0.5))]
    ends = mesh.facets[:, mesh.facets_satisfying(lambda x: np.isclose(x[0] * (1 - x[0]), 0))]
    p = radius * np.stack([np.sin(angle), np.cos(angle)])
    return Body(
        ElementMesh(p, mesh.t, boundaries={"outside": outside, "ends": ends}),
        1e7,
        0.0,
        (Pressure("outside", 480.0),),
        {"ends": "xy"},
    )


def _loose(name: str, mesh: ElementMesh, fixed: truths.Where, *says: str) -> Case:
    truth = truths.none("a part can move without strain", *says)
    return Case(name, partial(_pushed, mesh, fixed), 4, truth, truth)


def _pushed(mesh: ElementMesh, fixed: truths.Where) -> Body:
    end = mesh.p[0].max()
    return Body(mesh, YOUNG, POISSON, (Traction(lambda x: x[0] == end, (1e2, 0, -1e3)),), {fixed: "xyz"})


def _joined(offset: tuple[float, float, float]) -> ElementMesh:
    """Return a block and its copy, moved by `offset`, that share the vertices where they touch."""
    one = meshes.cube(2)
    p = np.hstack([one.p, one.p + np.array(offset)[:, None]])
    p, number = np.unique(p.round(9), axis=1, return_inverse=True)
    return ElementMesh(p, number.ravel()[np.hstack([one.t, one.t + one.nv])].astype(np.int32))


def _sheet(squeeze: float, bed: float = 0.0, push: float = 0.0) -> Body:
    """Return a sheet of 1 x 0.2 m on a bed [N/m^3]. Its short sides move together, and a small load acts normal to it [Pa]."""
    lines: list[Array] = [np.linspace(0, 1, 41), np.linspace(0, 0.2, 4), np.linspace(0, THICKNESS, 2)]
    loads: tuple[Any, ...] = ()
    if bed:
        loads = ElasticFoundation(lambda x: x[2] == 0, (0, 0, bed)), Traction(lambda x: x[2] == THICKNESS, partial(_uneven, push))
    end = {"x": -squeeze, "y": 0.0, "z": 0.0}
    return Body(meshes.box(lines), YOUNG, POISSON, loads, {lambda x: x[0] == 0: "xyz"}, {lambda x: x[0] == 1: end})


def _uneven(push: float, x: Array, t: float) -> Array:
    return np.stack([0 * x[0], 0 * x[0], push * t * np.sin(7 * x[0]) * np.cos(31 * x[0])])
