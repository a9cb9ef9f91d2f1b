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


def boundary_vertices(mesh: SimplexMesh) -> NDArray[np.int64]:
    """Vertices of facets that belong to one simplex only."""
    ids = facet_ids(mesh)
    single = np.bincount(ids.ravel())[ids] == 1
    return np.unique(np.concatenate([np.delete(mesh.t, i, axis=0)[:, single[i]].ravel() for i in range(mesh.k + 1)]))
