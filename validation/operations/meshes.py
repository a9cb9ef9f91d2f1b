"""Meshes from a single tetrahedron to a large box with few boundary entities."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import skfem

from skfem_stvk import ElementMesh
from skfem_stvk.mesh import embedded_mesh

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, 0, 1], [0, 1, 1], [1, 1, 1]], dtype=float).T


def several(*tetrahedra: tuple[int, int, int, int]) -> ElementMesh:
    """Return a mesh of tetrahedra between corners of a cube."""
    used, t = np.unique(np.array(tetrahedra).T, return_inverse=True)
    return ElementMesh(CORNERS[:, used], t.reshape(4, -1).astype(np.int32))


def cube_of_five() -> ElementMesh:
    """Return a cube of five tetrahedra: one in the middle, four at the corners."""
    return several((0, 4, 5, 6), (1, 0, 4, 5), (2, 0, 4, 6), (3, 0, 5, 6), (7, 4, 5, 6))


def box(cubes: int) -> ElementMesh:
    """Return a box with `cubes` cells along each side, six tetrahedra per cell."""
    return ElementMesh.of(skfem.MeshTet.init_tensor(*[np.linspace(0, 1, cubes + 1)] * 3))


def pieces() -> Iterator[ElementMesh]:
    """Yield small meshes with linearly independent numbers of entities, enough to determine the operations per entity."""
    yield several((0, 1, 2, 3))
    yield several((0, 1, 2, 3), (4, 1, 2, 3))
    yield several((0, 1, 2, 3), (2, 3, 6, 7))
    yield several((0, 1, 2, 3), (3, 4, 5, 6))
    yield cube_of_five()
    yield box(1)


def meshes(quick: bool) -> dict[str, ElementMesh]:
    """Return the meshes of the table: boxes of cubes with six tetrahedra each, and the unstructured bracket."""
    small = {"tetrahedron": several((0, 1, 2, 3)), "cube of 5": cube_of_five(), "box 2^3": box(2)}
    large = {} if quick else {"box 10^3": box(10), "box 19^3": box(19)}
    return {**small, "box 4^3": box(4), "bracket": embedded_mesh(), **large}
