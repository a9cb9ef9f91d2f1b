"""Meshes of the studies: boxes whose inner vertices are moved at random, and strips of triangles."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import skfem

from skfem_stvk import ElementMesh
from skfem_stvk.arguments import Array


def moved_box(d: int, n: int, amount: float = 0.2, seed: int = 1) -> ElementMesh:
    """The unit cube, square or line in `n^d` cells, inner vertices moved by up to `amount` of a cell, half of all turned round."""
    lines, rng = [np.linspace(0, 1, n + 1)] * d, np.random.default_rng(seed)
    mesh = skfem.MeshLine(lines[0]) if d == 1 else {2: skfem.MeshTri, 3: skfem.MeshTet}[d].init_tensor(*lines)
    inner = ((mesh.p > 0) & (mesh.p < 1)).all(axis=0)
    p, t = mesh.p + amount / n * inner * rng.uniform(-1, 1, mesh.p.shape), mesh.t.copy()
    half = rng.random(t.shape[1]) < 0.5
    t[:2, half] = t[1::-1, half]
    return ElementMesh(p, t)


def strip(nx: int, ny: int, place: Callable[[Array, Array], Sequence[Array]]) -> ElementMesh:
    """`nx x ny` cells of two triangles with alternating diagonals; `place` takes the unit square's coordinates to (x, y).

    >>> strip(2, 2, lambda a, b: (4 * a, b))
    ElementMesh: 8 triangles in 2D, 9 vertices
    """
    a, b = np.meshgrid(np.linspace(0, 1, nx + 1), np.linspace(0, 1, ny + 1), indexing="ij")
    i, j = (index.ravel() for index in np.meshgrid(np.arange(nx), np.arange(ny), indexing="ij"))
    v00 = i * (ny + 1) + j
    v10, v01, v11 = v00 + ny + 1, v00 + 1, v00 + ny + 2
    rising, falling = [[v00, v10, v11], [v00, v11, v01]], [[v00, v10, v01], [v10, v11, v01]]
    triangles = np.where((i + j) % 2 == 0, rising, falling)
    return ElementMesh(np.stack(place(a.ravel(), b.ravel())), triangles.transpose(1, 2, 0).reshape(3, -1))
