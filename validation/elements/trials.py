"""Bodies on which precision and cost of elements are compared: bent, twisted, and sheared while nearly incompressible.

All are bars along x of section 1 x 1 m, clamped at x = 0; what happens at the other end is a traction or a displacement.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import skfem

from skfem_stvk.arguments import Array

from ..statics.cantilever import LENGTH, TRACTION, YOUNG

#: Angle by which the end of the twisted bar is turned, and how far that of the sheared block is moved across [m].
ANGLE, ACROSS = np.pi / 2, 0.4

Moved = Callable[[Array, float], Array]


class Trial(NamedTuple):
    """A body and what is measured of it.

    Attributes
    ----------
    name : in words, of what is measured too.
    length : of the body along x [m].
    poisson : ratio.
    traction : at the end [Pa]; None where displacements are prescribed there.
    moved : displacements (3, n) of the end's points (3, n) at a load factor; None where a traction acts.
    measured : the result, from coordinates (n, 3), displacements (n, 3) and internal forces (n, 3) of the end's nodes.
    """

    name: str
    length: float
    poisson: float
    traction: tuple[float, float, float] | None
    moved: Moved | None
    measured: Callable[[Array, Array, Array], Array]

    def mesh(self, n: int, boxes: bool = False) -> Any:
        """`n x n` cubic cells across, of six tetrahedra or one hexahedron, with the boundaries "wall" and "tip"."""
        across = np.linspace(0, 1, n + 1)
        kind = skfem.MeshHex if boxes else skfem.MeshTet
        mesh = kind.init_tensor(np.linspace(0, self.length, round(self.length * n) + 1), across, across)
        return mesh.with_boundaries({"wall": lambda x: x[0] == 0, "tip": lambda x: x[0] == self.length})


def of_the_centre(p: Array, u: Array, _: Array) -> Array:
    """Displacement of the node next to the end's centre."""
    nearest = np.argmin(np.linalg.norm(p[:, 1:] - 0.5, axis=1))
    return u[nearest]


def torque(p: Array, u: Array, F: Array) -> Array:
    """About the bar's axis."""
    y, z = ((p + u)[:, 1:] - 0.5).T
    return np.atleast_1d((y * F[:, 2] - z * F[:, 1]).sum())


def push(p: Array, u: Array, F: Array) -> Array:
    """Force across the bar."""
    return F[:, 2:].sum(axis=0)


def turned(x: Array, t: float) -> Array:
    """Displacements by a rotation about the bar's axis."""
    y, z = x[1] - 0.5, x[2] - 0.5
    c, s = np.cos(ANGLE * t), np.sin(ANGLE * t)
    return np.stack([0 * y, (c - 1) * y - s * z, s * y + (c - 1) * z])


def moved_across(x: Array, t: float) -> Array:
    """Displacements across the bar."""
    return np.stack([0 * x[0], 0 * x[0], -ACROSS * t + 0 * x[0]])


BENT = Trial("bent cantilever, displacement of its end", LENGTH, 0.3, TRACTION, None, of_the_centre)
TWISTED = Trial("bar twisted by 90°, torque", LENGTH, 0.3, None, turned, torque)
SHEARED = Trial("block sheared between plates, nu = 0.499, force", 2.0, 0.499, None, moved_across, push)
TRIALS = (BENT, TWISTED, SHEARED)
MODULUS = YOUNG
