"""From elements to nodes: averages weighted by rest volume."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ..arguments import Array


class NodalAverage:
    """At each node the mean over the elements around it, weighted by their rest volumes; the operator is built once.

    It smooths what is constant in each element, across the boundary of two materials too, where stresses jump: average over one region at
    a time there, by leaving the others out.

    Parameters
    ----------
    t : (k + 1, nt) nodes of the elements.
    volume : (nt,) rest volumes.
    nodes : how many there are.

    >>> average = NodalAverage(np.array([[0, 1], [1, 2]]), np.array([1.0, 3.0]), 4)
    >>> average(np.array([10.0, 20.0]), np.array([False, False]))
    (array([10. , 17.5, 20. ,  0. ]), array([False, False, False,  True]))
    """

    def __init__(self, t: NDArray[np.integer], volume: Array, nodes: int) -> None:
        size, nt = t.shape
        self._sum = csr_matrix((np.tile(volume, size), (t.ravel(), np.tile(np.arange(nt), size))), shape=(nodes, nt))

    def __call__(self, values: Array, missing: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
        """(nodes, ...) averages of (nt, ...) values over the elements that are not missing, and the nodes without any."""
        weight = self._sum @ np.where(missing, 0.0, 1.0)
        flat = np.where(missing[:, None], 0.0, values.reshape(len(values), -1))
        average = (self._sum @ flat) / np.where(weight > 0, weight, 1.0)[:, None]
        return average.reshape(-1, *values.shape[1:]), weight == 0


def split_nodes(t: NDArray[np.integer], part: NDArray[np.integer]) -> tuple[NDArray[np.int64], int]:
    """(k + 1, nt) numbers of the nodes, and how many, after each has been split in one for every part that meets there.

    >>> split_nodes(np.array([[0, 1], [1, 2]]), np.array([0, 1]))
    (array([[0, 2],
           [1, 3]]), 4)
    """
    nodes = int(t.max()) + 1
    numbers, split = np.unique(part * nodes + t, return_inverse=True)
    return split.reshape(t.shape), len(numbers)
