"""Bodies for the comparison of precision and cost of elements: in bending, in torsion, and nearly incompressible in shear.

All bodies are bars along x with a cross-section of 1 x 1 m, clamped at x = 0. A traction or a displacement acts at the other end.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import skfem

from skfem_stvk.arguments import Array

from ..statics.cantilever import LENGTH, TRACTION, YOUNG

#: Rotation of the twisted bar's end, and transverse displacement of the sheared block's end [m].
ANGLE, ACROSS = np.pi / 2, 0.4

Moved = Callable[[Array, float], Array]


class Trial(NamedTuple):
    """Body with its load and its measured result.

    Attributes
    ----------
    name
        Of body and measured result, in words.
    length
        Length of the body along x [m].
    poisson
        Poisson's ratio.
    traction
        Traction at the end [Pa]; None if displacements are prescribed there.
    moved
        Displacements (3, n) of the end's points (3, n) at a load factor; None if a traction acts.
    measured
        Function that returns the result from coordinates, displacements and internal forces (n, 3) of the end's nodes.
    """

    name: str
    length: float
    poisson: float
    traction: tuple[float, float, float] | None
    moved: Moved | None
    measured: Callable[[Array, Array, Array], Array]

    def mesh(self, n: int, boxes: bool = False) -> Any:
        """Return `n x n` cubic cells across, of six tetrahedra or one hexahedron, with the boundaries "wall" and "tip"."""
        across = np.linspace(0, 1, n + 1)
        kind = skfem.MeshHex if boxes else skfem.MeshTet
        mesh = kind.init_tensor(np.linspace(0, self.length, round(self.length * n) + 1), across, across)
        return mesh.with_boundaries({"wall": lambda x: x[0] == 0, "tip": lambda x: x[0] == self.length})


def of_the_centre(p: Array, u: Array, _: Array) -> Array:
    """Return the displacement of the node closest to the end's centre."""
    nearest = np.argmin(np.linalg.norm(p[:, 1:] - 0.5, axis=1))
    return u[nearest]


def torque(p: Array, u: Array, F: Array) -> Array:
    """Return the torque about the bar's axis."""
    y, z = ((p + u)[:, 1:] - 0.5).T
    return np.atleast_1d((y * F[:, 2] - z * F[:, 1]).sum())


def push(p: Array, u: Array, F: Array) -> Array:
    """Return the transverse force."""
    return F[:, 2:].sum(axis=0)


def rotated(x: Array, t: float) -> Array:
    """Return the displacements of a rotation about the bar's axis."""
    y, z = x[1] - 0.5, x[2] - 0.5
    c, s = np.cos(ANGLE * t), np.sin(ANGLE * t)
    return np.stack([0 * y, (c - 1) * y - s * z, s * y + (c - 1) * z])


def moved_across(x: Array, t: float) -> Array:
    """Return the transverse displacements."""
    return np.stack([0 * x[0], 0 * x[0], -ACROSS * t + 0 * x[0]])


BENT = Trial("bent cantilever, displacement of its end", LENGTH, 0.3, TRACTION, None, of_the_centre)
TWISTED = Trial("bar twisted by 90°, torque", LENGTH, 0.3, None, rotated, torque)
SHEARED = Trial("block sheared between plates, nu = 0.499, force", 2.0, 0.499, None, moved_across, push)
TRIALS = (BENT, TWISTED, SHEARED)
MODULUS = YOUNG
