"""How what acts on simplices goes to their vertices."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..mesh import ElementMesh

Values = NDArray[np.float64]


class Spread:
    """Simplices, and how what acts on them goes to their vertices.

        integral of N_a f = size/(m (m + 1)) (f_a + sum_b f_b)        f linear on a simplex of m vertices
                          = size/m f                                  f constant

    The simplices (m, n) are elements or facets, their sizes (n,) what a unit of `f` acts on: volumes, masses, areas. Their vertices
    (nv,), at `x` (d, nv) [m], are in the order of values; by default ascending.
    """

    def __init__(
        self, mesh: ElementMesh, simplices: NDArray[np.int32], sizes: Values, vertices: NDArray[np.int64] | None = None
    ) -> None:
        if vertices is None:
            there = np.zeros(mesh.nv, dtype=bool)
            there[simplices] = True
            vertices = np.flatnonzero(there)
        number = np.empty(mesh.nv, dtype=np.int64)
        number[vertices] = np.arange(len(vertices))
        self.vertices, self.x = vertices, mesh.p[:, vertices]
        self.corners, self.sizes = number[simplices], sizes

    @cached_property
    def total(self) -> Values:
        """(nv,) integral of `N_a`."""
        return self.add(np.broadcast_to(self.sizes / len(self.corners), self.corners.shape))

    def shares(self, values: Values) -> Values:
        """(c, m, n) integral of `N_a f` over each simplex, from `values` (c, nv) at the vertices or (c, 1) everywhere."""
        m = len(self.corners)
        if values.shape[1] == 1:
            return np.broadcast_to((values * self.sizes / m)[:, None], (len(values), *self.corners.shape))
        f = values[:, self.corners]
        return np.asarray((f + f.sum(axis=1, keepdims=True)) * self.sizes / (m * (m + 1)))

    def integrate(self, values: Values) -> Values:
        """(nv, c) integral of `N_a f` over all of them, from `values` (c, nv) or (c, 1)."""
        if values.shape[1] == 1:
            return self.total[:, None] * values[:, 0]
        return np.stack([self.add(component) for component in self.shares(values)], axis=1)

    def add(self, at_corners: Values) -> Values:
        """(nv,) sums at the vertices of what is at the corners (m, n)."""
        sums: NDArray[Any] = np.bincount(self.corners.ravel(), weights=at_corners.ravel(), minlength=len(self.vertices))
        return sums
