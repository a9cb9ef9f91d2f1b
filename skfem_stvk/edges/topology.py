"""The edges of simplices, in scikit-fem's order."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..kernels.topology import edges_of_simplices

#: Local edges of a segment, triangle and tetrahedron, as pairs of local vertices: those of a tetrahedron begin with a triangle's.
LOCAL_EDGES = {
    1: ((0, 1),),
    2: ((0, 1), (1, 2), (0, 2)),
    3: ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)),
}


def edge_topology(t: NDArray[np.int32]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Edges and the edges of each simplex.

    Parameters
    ----------
    t : (k + 1, nt) vertices of the simplices.

    Returns
    -------
    edges : (2, ne) end vertices `a < b`, in lexicographic order: scikit-fem's `mesh.edges` (`mesh.facets` for triangles).
    t2e : (m, nt) edges of each simplex, `m = k (k + 1)/2` in the order of `LOCAL_EDGES`: its `mesh.t2e` (`mesh.t2f`).

    >>> edge_topology(np.array([[0, 1], [1, 2], [2, 3]]))
    (array([[0, 0, 1, 1, 2],
            [1, 2, 2, 3, 3]], dtype=int32), array([[0, 2],
           [2, 4],
           [1, 3]], dtype=int32))
    """
    t = np.ascontiguousarray(t, dtype=np.int32)
    edges, t2e = edges_of_simplices(t, np.array(LOCAL_EDGES[t.shape[0] - 1]), int(t.max()) + 1)
    return edges, t2e
