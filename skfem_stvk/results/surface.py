"""What one sees of a body: its surface, and the lines where that bends sharply."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..mesh import SimplexMesh
from ..mesh.facets import facet_ids

Ids = NDArray[np.int64]
SHARP = np.cos(np.radians(30))


def visible_cells(mesh: SimplexMesh) -> tuple[Ids, Ids]:
    """(m, n) corners and (n,) elements of what is drawn: the boundary facets of tetrahedra, other simplices as they are.

    `mesh.t[corners, elements]` are the vertices; facets are counterclockwise when seen from outside.
    """
    if mesh.k < 3:
        return np.repeat(np.arange(mesh.k + 1)[:, None], mesh.nt, axis=1), np.arange(mesh.nt)
    ids = facet_ids(mesh)
    opposite, elements = np.nonzero(np.bincount(ids.ravel())[ids] == 1)
    corners = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])[opposite].T
    a, b, c, inside = mesh.p.T[mesh.t[np.vstack([corners, opposite]), elements]]
    inwards = (np.cross(b - a, c - a) * (inside - a)).sum(axis=1) > 0
    corners[:2, inwards] = corners[1::-1, inwards]
    return corners, elements


def outline(points: Array, cells: NDArray[np.integer]) -> NDArray[np.integer]:
    """(2, n) edges of triangles (3, nt) that one triangle or more than two have, or two that meet at more than 30 degrees; segments as they are.

    `points` are (nv, 3).
    """
    if len(cells) == 2:
        return cells
    a, b, c = points[cells]
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    edges = np.sort(np.concatenate([cells[[0, 1]], cells[[1, 2]], cells[[0, 2]]], axis=1), axis=0)
    unique, place, count = np.unique(edges, axis=1, return_inverse=True, return_counts=True)
    by_edge = np.argsort(place.reshape(-1), kind="stable") % cells.shape[1]  # the triangles of each edge in turn
    start = np.cumsum(count) - count
    flat = np.abs((normals[by_edge[start]] * normals[by_edge[start + (count == 2)]]).sum(axis=1)) > SHARP
    drawn: NDArray[np.integer] = unique[:, (count != 2) | ~flat]
    return drawn
