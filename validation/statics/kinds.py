"""Kinds of simplices: meshes of unit cubes, squares and lines, with materials, cross-sections and supports."""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import numpy as np

from skfem_stvk import ElementMesh, StVK

from .meshes import Array, moved_box

YOUNG, POISSON = 3.0e5, 0.3
#: Statically determinate supports: vertices and components. Each kind takes those within its own dimension.
POINTS = (((0.0, 0.0, 0.0), "xyz"), ((1.0, 0.0, 0.0), "yz"), ((0.0, 0.0, 1.0), "y"))


class Kind(NamedTuple):
    """Simplices of dimension `k` in a space of dimension `d`, with `options` of their term."""

    k: int
    d: int
    options: dict[str, Any]

    def mesh(self, n: int) -> ElementMesh:
        """Return the unit cube, square or line with `n^k` cells."""
        flat = moved_box(self.k, n)
        return ElementMesh(np.pad(flat.p, ((0, self.d - self.k), (0, 0))), flat.t)

    def term(self) -> StVK:
        return StVK(young=YOUNG, poisson=POISSON, **self.options)

    @property
    def lame(self) -> tuple[float, float]:
        """Lame constants in the dimension of the simplices; on a line `(E, 0)`."""
        if self.k == 1:
            return YOUNG, 0.0
        plane_stress = self.d > self.k or "plane" in self.options
        lam = YOUNG * POISSON / ((1 + POISSON) * (1 - POISSON if plane_stress else 1 - 2 * POISSON))
        return lam, YOUNG / (2 * (1 + POISSON))

    @property
    def section(self) -> float:
        """Thickness, area or 1."""
        return float(self.options.get("thickness", self.options.get("area", 1.0)))

    @property
    def across(self) -> dict[Any, str]:
        """Supports normal to a flat membrane or a straight cable, which has no transverse stiffness without tension."""
        return {_everywhere: "xyz"[self.k : self.d]} if self.d > self.k else {}

    @property
    def statically_determinate(self) -> dict[Any, str]:
        """Supports that constrain rigid motions only."""
        own = [
            (np.array(x[: self.d]), "".join(c for c in letters if c in "xyz"[: self.k]))
            for x, letters in POINTS
            if not any(x[self.k :])
        ]
        return {partial(_at_point, x): letters for x, letters in own if letters} | self.across


KINDS = {
    "tetrahedra": Kind(3, 3, {}),
    "triangles, plane strain": Kind(2, 2, {}),
    "triangles, plane stress": Kind(2, 2, {"plane": "stress", "thickness": 0.1}),
    "membrane in space": Kind(2, 3, {"thickness": 0.1}),
    "segments": Kind(1, 1, {"area": 0.01}),
    "cable in space": Kind(1, 3, {"area": 0.01}),
}


def _at_point(point: Array, x: Array) -> Any:
    return (x == point[:, None]).all(axis=0)


def _everywhere(x: Array) -> Any:
    return np.full(x.shape[1], True)
