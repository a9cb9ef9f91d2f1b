"""The facets of simplices: which of them are shared, and where given ones stand among them."""

from __future__ import annotations

from math import factorial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..kernels.geometry import measures
from ..kernels.topology import lexicographic_order

if TYPE_CHECKING:
    from .simplices import SimplexMesh

Ids = NDArray[np.int32]


def facets_of(t: Ids, nv: int) -> tuple[Ids, Ids]:
    """Facets of simplices, each once, and the facets of each simplex.

    Parameters
    ----------
    t : (k + 1, nt) vertices of the simplices, smaller than `nv`.

    Returns
    -------
    facets : (k, nf) vertices, ascending, in lexicographic order: scikit-fem's `mesh.facets`.
    t2f : (k + 1, nt) facet opposite to each vertex of each simplex.

    >>> facets_of(np.array([[0, 1], [1, 2]]), 3)
    (array([[0, 1, 2]], dtype=int32), array([[1, 2],
           [0, 1]], dtype=int32))
    """
    corner = np.argsort(t, axis=0)
    facets = _opposite(np.take_along_axis(t, corner, axis=0))
    order, new = _grouped(facets, nv)
    ids = np.empty(len(order), dtype=np.int32)
    ids[order] = np.cumsum(new) - 1
    t2f = np.empty(t.shape, dtype=np.int32)
    np.put_along_axis(t2f, corner, ids.reshape(t.shape), axis=0)
    return facets[:, order[new]], t2f


def facet_ids(mesh: SimplexMesh) -> Ids:
    """(k + 1, nt) number of the facet opposite to each vertex of each simplex; simplices that share a facet share the number."""
    return facets_of(mesh.t, mesh.nv)[1]


def boundary_facets(mesh: SimplexMesh) -> Ids:
    """(k, n) vertices of the facets that belong to one simplex only, turned outwards where the simplices fill the space.

    Those of tetrahedra are counterclockwise when seen from outside; those of triangles in the plane have the body on their left.
    `mesh.surface` keeps them.

    >>> from skfem_stvk import SimplexMesh
    >>> boundary_facets(SimplexMesh(p=[[0, 1, 0], [0, 0, 1]], t=[[0], [2], [1]]))
    array([[0, 2, 1],
           [1, 0, 2]], dtype=int32)
    """
    ordered = np.sort(mesh.t, axis=0)
    every = _opposite(ordered)
    order, new = _grouped(every, mesh.nv)
    alone = order[new & np.append(new[1:], True)]
    facets = every[:, alone]
    if mesh.k == mesh.d > 1:
        corner, element = np.divmod(alone, mesh.nt)
        x = mesh.p[:, [*facets, ordered[corner, element]]]
        inside = np.linalg.det((x[:, 1:] - x[:, :1]).transpose(2, 0, 1)) * (-1) ** mesh.k > 0
        facets[:2, ~inside] = facets[1::-1, ~inside]
    return facets


def boundary_vertices(mesh: SimplexMesh) -> Ids:
    """Vertices of the boundary facets."""
    return np.unique(mesh.surface)


def find_facets(wanted: Ids, facets: Ids, nv: int) -> NDArray[np.int64]:
    """(n,) where the `wanted` facets (k, n) stand among `facets`, whatever the order of their vertices; -1 if they do not.

    >>> find_facets(np.array([[2, 1], [0, 3]]), np.array([[0, 0], [1, 2]]), 4)
    array([ 1, -1])
    """
    count = facets.shape[1]
    order, new = _grouped(np.sort(np.concatenate([facets, wanted], axis=1), axis=0), nv)
    first = np.empty(len(order), dtype=np.int64)
    first[order] = order[new][np.cumsum(new) - 1]
    return np.where(first[count:] < count, first[count:], -1)


def facet_sizes(p: NDArray[np.float64], facets: Ids) -> NDArray[np.float64]:
    """(n,) areas or lengths of facets (k, n) [m^(k-1)]; 1 for points."""
    k = len(facets)
    if k == 1:
        return np.ones(facets.shape[1])
    sizes: NDArray[np.float64] = measures(p, np.ascontiguousarray(facets))[0] / factorial(k - 1)
    return sizes


def _opposite(ordered: NDArray[Any]) -> Ids:
    """(k, (k + 1) nt) the facets opposite to the first, second, ... vertex of simplices with ascending vertices."""
    return np.concatenate([np.delete(ordered, i, axis=0) for i in range(len(ordered))], axis=1).astype(np.int32, copy=False)


def _grouped(facets: Ids, nv: int) -> tuple[Ids, NDArray[np.bool_]]:
    """Lexicographic order of facets, in which equal ones keep theirs; and whether each differs from the one before it there."""
    order = lexicographic_order(facets, nv)
    facets = facets[:, order]
    new = np.ones(len(order), dtype=bool)
    new[1:] = (facets[:, 1:] != facets[:, :-1]).any(axis=0)
    return order, new
