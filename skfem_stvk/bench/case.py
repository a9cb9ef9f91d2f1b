"""A mesh of tetrahedra, structured or of a part, and the state that W, F and K are timed at."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import skfem

from ..arguments import Array
from ..errors import StvkError
from ..mesh import SimplexMesh
from ..terms import StVK
from .checkout import from_checkout

YOUNG, POISSON = 1e5, 0.3  # [Pa, -]; lambda = 1.5 mu
EDGE_OF_PART = {5_000: 5.8e-3, 40_000: 2.15e-3, 250_000: 1.1e-3}  # [m] edges that give about as many tetrahedra


@dataclass
class Case:
    """A mesh of about `size` tetrahedra, half of them turned round; `kind` is 'box' or 'part'."""

    kind: str
    size: int

    @property
    def name(self) -> str:
        """
        >>> Case("box", 40_000).name, Case("part", 2_000_000).name, Case("box", 300).name
        ('box 40 k', 'part 2 M', 'box 300')
        """
        for unit, letter in ((1_000_000, "M"), (1_000, "k")):
            if self.size >= unit:
                return f"{self.kind} {self.size / unit:g} {letter}"
        return f"{self.kind} {self.size}"

    @cached_property
    def mesh(self) -> SimplexMesh:
        """The mesh, made when it is first asked for.

        Raises
        ------
        StvkError
            if it is of a part, and there is no checkout, no Gmsh or no such size.
        """
        return box(self.size) if self.kind == "box" else part(self.size)

    @cached_property
    def u(self) -> Array:
        """(ndofs,) a smooth deformation with strains of about 0.6 [m]."""
        p = self.mesh.p
        size = np.ptp(p, axis=1).max()
        waves = np.sin(2 * np.pi * p[[1, 2, 0]] / size)
        return (0.1 * size * waves * np.array([[1.0], [0.7], [0.5]])).ravel("F")

    @cached_property
    def v(self) -> Array:
        """(ndofs,) a vector to multiply K with."""
        return np.random.default_rng(1).standard_normal(self.mesh.p.size)

    @property
    def term(self) -> StVK:
        return StVK(young=YOUNG, poisson=POISSON)


def box(size: int) -> SimplexMesh:
    """A grid of boxes of six tetrahedra each, in scikit-fem's own order, with about `size` of them.

    >>> [box(size).nt for size in (5_000, 40_000)]
    [4860, 38988]
    """
    n = max(round((size / 6) ** (1 / 3)), 1)
    sides = n, n, max(round(size / (6 * n * n)), 1)
    mesh = skfem.MeshTet.init_tensor(*(np.linspace(0, side / n, side + 1) for side in sides))
    t = mesh.t.astype(np.int32)
    half = np.random.default_rng(0).permutation(t.shape[1])[: t.shape[1] // 2]
    t[:2, half] = t[1::-1, half]
    return SimplexMesh(mesh.p, t)


def part(size: int) -> SimplexMesh:
    """An angle bracket that Gmsh meshes, with about `size` tetrahedra."""
    if size not in EDGE_OF_PART:
        raise StvkError(f"A part of {size} tetrahedra was asked for; there are {', '.join(map(str, EDGE_OF_PART))}.")
    bracket = from_checkout("meshes").bracket
    try:
        mesh: SimplexMesh = bracket(EDGE_OF_PART[size])
    except (ImportError, OSError) as error:
        raise StvkError(str(error)) from error
    return mesh
