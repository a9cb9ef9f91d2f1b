"""Which side of a surface is which."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..kernels.topology import lexicographic_order


def turned_alike(t: NDArray[np.int32], nv: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which triangles to turn so that all neighbours look to the same side, that of the first one of their connected piece.

    Neighbours are two triangles at an edge of no other: they look to the same side if they go along it in opposite directions.

    Parameters
    ----------
    t : (3, n) triangles of vertices smaller than `nv`.

    Returns
    -------
    turned : (n,) whether to turn it.
    two_sided : (n,) whether its piece has two sides, unlike a Moebius strip.

    >>> turned_alike(np.array([[0, 1], [1, 2], [2, 3]]), 4)
    (array([False,  True]), array([ True,  True]))
    """
    n = t.shape[1]
    one, other, against = _neighbours(t, nv)
    front, back = np.arange(n), np.arange(n, 2 * n)  # the two sides of each triangle, linked to those of its neighbours
    rows = np.concatenate([front[one], back[one]])
    columns = np.concatenate([np.where(against, front[other], back[other]), np.where(against, back[other], front[other])])
    graph = coo_matrix((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(2 * n, 2 * n))
    side = connected_components(graph, directed=False)[1]
    _, first, piece = np.unique(np.minimum(side[:n], side[n:]), return_index=True, return_inverse=True)
    return side[:n] != side[first][piece], side[:n] != side[n:]


def _neighbours(t: NDArray[np.int32], nv: int) -> tuple[NDArray[Any], NDArray[Any], NDArray[np.bool_]]:
    """Pairs of triangles at edges that only they have, and whether they go along it in opposite directions."""
    ends = np.concatenate([t[[0, 1]], t[[1, 2]], t[[2, 0]]], axis=1).astype(np.int32)
    both = np.sort(ends, axis=0)
    order = lexicographic_order(both, nv)
    same = (both[:, order[1:]] == both[:, order[:-1]]).all(axis=0)
    pair = np.flatnonzero(same & ~np.append(False, same[:-1]) & ~np.append(same[1:], False))
    one, other = order[pair], order[pair + 1]
    return one % t.shape[1], other % t.shape[1], ends[0, one] != ends[0, other]
