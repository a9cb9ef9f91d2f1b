"""Meshes of the studies: boxes with inner vertices moved at random, shared with the referee, and strips of triangles."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from skfem_stvk import ElementMesh
from skfem_stvk.arguments import Array
from skfem_stvk.referee.manufactured import moved_box

__all__ = ["Array", "moved_box", "strip"]


def strip(nx: int, ny: int, mapping: Callable[[Array, Array], Sequence[Array]]) -> ElementMesh:
    """Return `nx x ny` cells of two triangles with alternating diagonals; `mapping` maps the unit square to (x, y).

    >>> strip(2, 2, lambda a, b: (4 * a, b))
    ElementMesh: 8 triangles in 2D, 9 vertices
    """
    a, b = np.meshgrid(np.linspace(0, 1, nx + 1), np.linspace(0, 1, ny + 1), indexing="ij")
    i, j = (index.ravel() for index in np.meshgrid(np.arange(nx), np.arange(ny), indexing="ij"))
    v00 = i * (ny + 1) + j
    v10, v01, v11 = v00 + ny + 1, v00 + 1, v00 + ny + 2
    rising, falling = [[v00, v10, v11], [v00, v11, v01]], [[v00, v10, v01], [v10, v11, v01]]
    triangles = np.where((i + j) % 2 == 0, rising, falling)
    return ElementMesh(np.stack(mapping(a.ravel(), b.ravel())), triangles.transpose(1, 2, 0).reshape(3, -1))
