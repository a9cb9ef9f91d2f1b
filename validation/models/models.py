"""Models of the comparison, each as the terms of a system, and the bar on which all are tested."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import skfem

from skfem_stvk import (
    Corotated,
    EdgeNetwork,
    ElementMesh,
    InvertibleStVK,
    LinearElastic,
    NeoHookean,
    SpringNetwork,
    StVK,
    System,
    VolumePenalty,
)

#: Data of the bar [m, Pa, kg/m^3]: 4 x 1 x 1 m, soft enough to bend and twist by tens of degrees.
LENGTH, YOUNG, POISSON, DENSITY = 4.0, 1e5, 0.3, 1000.0
MATERIAL: dict[str, Any] = {"young": YOUNG, "poisson": POISSON, "density": DENSITY}
RULES = ("van-gelder", "lloyd", "edge-diagonal", "least-squares")

Terms = Callable[[ElementMesh], list[Any]]


class Model(NamedTuple):
    """Model with its name, its family (which has a colour), its terms on a mesh, and whether its internal torques balance."""

    name: str
    family: str
    terms: Terms
    keeps_spin: bool = True


def bar(n: int) -> ElementMesh:
    """Return the bar with `n x n` cells across, of six tetrahedra each, and the boundaries "wall" and "tip"."""
    across = np.linspace(0, 1, n + 1)
    mesh = skfem.MeshTet.init_tensor(np.linspace(0, LENGTH, round(LENGTH * n) + 1), across, across)
    return ElementMesh.of(mesh.with_boundaries({"wall": lambda x: x[0] == 0, "tip": lambda x: x[0] == LENGTH}))


def system_of(model: Model, mesh: ElementMesh, loads: Sequence[Any] = (), *supports: Any) -> System:
    """Return the system of a model. The warning that a spring rule is for another Poisson's ratio is suppressed."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return System(mesh, [*model.terms(mesh), *loads], *supports)


def _quartic(mesh: ElementMesh) -> EdgeNetwork:
    return EdgeNetwork.of(mesh, StVK(**MATERIAL)).diagonal()


def _by_rule(rule: str, *others: Any) -> Terms:
    return lambda mesh: [SpringNetwork(rule=rule, **MATERIAL), *others]


def _springs() -> list[Model]:
    """Return springs of each kind, without and with a volume term."""
    found = [
        Model("quartic springs", "springs", lambda mesh: [_quartic(mesh)]),
        Model("quartic springs + volume", "springs + volume", lambda mesh: [_quartic(mesh), _volume()]),
    ]
    for rule in RULES:
        found.append(Model(f"{rule} springs", "springs", _by_rule(rule)))
        found.append(Model(f"{rule} springs + volume", "springs + volume", _by_rule(rule, _volume())))
    return found


def _volume() -> VolumePenalty:
    return VolumePenalty(kind="quadratic")


TRUE = Model("StVK", "StVK", lambda mesh: [StVK(**MATERIAL)])
NEO_HOOKEAN = Model("neo-Hookean", "neo-Hookean", lambda mesh: [NeoHookean(**MATERIAL)])
MODELS: tuple[Model, ...] = (
    Model("linear", "linear", lambda mesh: [LinearElastic(**MATERIAL)], keeps_spin=False),
    *_springs(),
    Model("corotated by element", "corotated", lambda mesh: [Corotated(**MATERIAL)]),
    Model("corotated by vertex", "corotated", lambda mesh: [Corotated(rotation="vertex", **MATERIAL)], keeps_spin=False),
    TRUE,
    Model("StVK + volume", "StVK", lambda mesh: [StVK(**MATERIAL), VolumePenalty()]),
    Model("invertible StVK", "invertible", lambda mesh: [InvertibleStVK(**MATERIAL)]),
    NEO_HOOKEAN,
)
#: Colours of Okabe and Ito, which colour-blind readers can distinguish.
COLOURS = {
    "linear": "#000000",
    "springs": "#E69F00",
    "springs + volume": "#D55E00",
    "corotated": "#56B4E9",
    "StVK": "#0072B2",
    "invertible": "#CC79A7",
    "neo-Hookean": "#009E73",
}
