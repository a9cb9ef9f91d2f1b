"""Membranes and cables without transverse stiffness until they are in tension: K is singular at rest."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from skfem_stvk import ElementMesh, Gravity, NodalLoad, Pressure, System, VolumePenalty
from skfem_stvk.arguments import Array

from ..reduced import cables
from . import truths
from .case import Body, Case, Truth

METHODS = ("plain Newton", "Newton, clamped", "default", "default, invertible")
#: Stiffness `E A` of the cable over its weight: load steps find the first state; the second needs a dynamic solve.
SOFT, STIFF = 1e4, 1e8


@dataclass(frozen=True)
class Woven(Body):
    """Body of membranes with a thickness, or of cables with a cross-sectional area."""

    thickness: float | None = None
    area: float | Array | None = None

    def system(self, volume: bool) -> System:
        own = self.law(young=self.young, poisson=self.poisson, thickness=self.thickness, area=self.area, density=self.density)
        return System(self.mesh, [own, *[VolumePenalty()] * volume, *self.loads], self.fixed, self.prescribed)


def slack() -> list[Case]:
    chain = _case("hang a slack cable", partial(_chain, SOFT), _chain_by_itself(SOFT))
    refused = replace(_chain_by_itself(STIFF), says=("no transverse stiffness", "BackwardEuler"), refused=True)
    sphere = _case("inflate a sphere by a half", _sphere, truths.state("closed form: p = 2 h S/(s r)", _sphere_grown, 0.02))
    return [
        chain,
        _case("hang a slack cable 1e4 times as stiff", partial(_chain, STIFF), refused),
        _case("load a flat net of cables", _net, truths.state("the net's own equations", _net_by_itself)),
        replace(sphere, methods=("plain Newton", "default", "default, invertible")),  # the other method needs a potential
    ]


def _case(name: str, make: truths.Make, truth: Truth) -> Case:
    return Case(name, make, 10, truth, truth, methods=METHODS)


def _chain(ratio: float) -> Body:
    body = cables.chain(ratio * cables.WEIGHT * cables.REST)
    stiffness = ratio * cables.WEIGHT * cables.REST
    density = cables.WEIGHT / cables.G / 1e-4
    fixed = {(0, cables.SEGMENTS): "xy"}
    return Woven(body.mesh, stiffness / 1e-4, 0.0, (Gravity(g=(0, -cables.G)),), fixed, density=density, area=1e-4)


def _chain_by_itself(ratio: float) -> Truth:
    def expected(system: System) -> Array:
        return (cables.own_chain(system.mesh.p, ratio * cables.WEIGHT * cables.REST) - system.mesh.p).ravel("F")

    return truths.state("the chain's own equations", expected)


def _net() -> Body:
    points, edges, rim, loads = cables.net((8, 6))
    inside = np.setdiff1d(np.arange(points.shape[1]), rim)
    mesh = ElementMesh(points, edges.astype(np.int32))
    area = np.linspace(1e-6, 3e-6, edges.shape[1])
    return Woven(mesh, 1e9, 0.0, (NodalLoad(inside, loads[:, inside]),), {tuple(rim): "xyz"}, area=area)


def _net_by_itself(system: System) -> Array:
    points, edges, rim, loads = cables.net((8, 6))
    inside, area = np.setdiff1d(np.arange(points.shape[1]), rim), np.linspace(1e-6, 3e-6, edges.shape[1])
    return (cables.own_net(points, edges, 1e9 * area, loads, inside) - points).ravel("F")


def _sphere() -> Body:
    mesh = cables.eighth(8, 2)
    fixed = [(np.flatnonzero(mesh.p[axis] < 1e-9), "xyz"[axis]) for axis in range(3)]
    load = Pressure(None, -cables.pressure_at(cables.STRETCH))
    return Woven(mesh, cables.YOUNG, cables.POISSON, (load,), fixed, thickness=cables.THICKNESS)


def _sphere_grown(system: System) -> Array:
    return ((cables.STRETCH - 1) * system.mesh.p).ravel("F")
