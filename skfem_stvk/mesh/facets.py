"""The facets of simplices: which of them are shared."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .simplices import SimplexMesh


def facet_ids(mesh: SimplexMesh) -> NDArray[np.int64]:
    """(k + 1, nt) number of the facet opposite to each vertex of each simplex; simplices that share a facet share the number.

    >>> facet_ids(SimplexMesh(p=[[0, 1, 2]], t=[[0, 1], [1, 2]]))
    array([[1, 2],
           [0, 1]])
    """
    facets = np.concatenate([np.sort(np.delete(mesh.t, i, axis=0), axis=0) for i in range(mesh.k + 1)], axis=1)
    order = np.lexsort(facets[::-1])
    ordered = facets[:, order]
    ids = np.empty(len(order), dtype=np.int64)
    ids[order] = np.concatenate([[0], np.cumsum((ordered[:, 1:] != ordered[:, :-1]).any(axis=0))])
    return ids.reshape(mesh.k + 1, mesh.nt)


def boundary_facets(mesh: SimplexMesh) -> NDArray[np.int32]:
    """(k, n) vertices of the facets that belong to one simplex only; of tetrahedra counterclockwise when seen from outside."""
    ids = facet_ids(mesh)
    corner, element = np.nonzero(np.bincount(ids.ravel())[ids] == 1)
    others = np.array([[j for j in range(mesh.k + 1) if j != i] for i in range(mesh.k + 1)])
    facets = mesh.t[others[corner].T, element]
    if mesh.k == mesh.d == 3:
        a, b, c, inside = mesh.p[:, [*facets, mesh.t[corner, element]]].transpose(1, 0, 2)
        inwards = (np.cross(b - a, c - a, axis=0) * (inside - a)).sum(axis=0) > 0
        facets[:2, inwards] = facets[1::-1, inwards]
    return facets


def boundary_vertices(mesh: SimplexMesh) -> NDArray[np.int32]:
    """Vertices of the boundary facets."""
    return np.unique(boundary_facets(mesh))
