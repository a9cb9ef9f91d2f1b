"""Spread of loads on elements or facets to their nodes."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...mesh import ElementMesh
from ...mesh.element import Element
from ...mesh.points import rule_of, sizes_at_points

Values = NDArray[np.float64]
Ids = NDArray[Any]


def shares_of_points(p: Values, t: Ids, element: Element) -> Values:
    """Return the fraction (nq, n) of the size of elements or facets `t` (m, n) at each point of the rule for masses: their sums are
    1.
    """
    sizes = sizes_at_points(p, t, element)
    return np.asarray(sizes / sizes.sum(axis=0))


def lumped_shares(p: Values, t: Ids, element: Element) -> Values:
    """Return the positive fractions (m, n) of the mass of elements `t` (m, n) that are lumped at their nodes; their sums are 1.

        linear simplices     1/m
        boxes                integral of N_a, which is the row sum of the consistent masses: the centre of mass is exact
        quadratic simplices  integral of N_a^2, scaled: row sums are negative at corners (Hinton, Rock, Zienkiewicz 1976)

    Other elements select one of the last two by `ShapeFunctions.lumped_by_rows`.

    For a straight quadratic tetrahedron, corners have 1/36 and edge midpoints 4/27; for a triangle 1/19 and 16/57.
    """
    if element.is_linear_simplex:
        return np.full(t.shape, 1 / len(t))
    N = element.values(rule_of(element, "mass").points)
    parts = np.einsum("qa,qn->an", N if element.shape.lumped_by_rows else N**2, shares_of_points(p, t, element))
    return np.asarray(parts / parts.sum(axis=0))


class Spread:
    """Elements or facets of a kind, and the distribution of loads on them to their nodes.

        integral of N_a f = sum_q w_q N_a(q) sum_b N_b(q) f_b        f interpolated between nodes, by the rule for masses

        integral of N_a f = size/(m (m + 1)) (f_a + sum_b f_b)       for a linear simplex of m vertices
                          = size/m f                                 for a linear simplex with constant f

    A unit of `f` acts on the sizes (n,) of the `cells` (m, n): volumes, masses or areas; within a cell they are distributed like
    its size. The nodes `vertices` (nv,) of the cells, at `x` (d, nv) [m], are in the order of values, by default ascending. `nodes`
    (m, n) are the nodes of the cells, as indices into `vertices`.
    """

    def __init__(
        self, mesh: ElementMesh, element: Element, cells: Ids, sizes: Values, vertices: NDArray[np.int64] | None = None
    ) -> None:
        if vertices is None:
            there = np.zeros(mesh.nv, dtype=bool)
            there[cells] = True
            vertices = np.flatnonzero(there)
        number = np.empty(mesh.nv, dtype=np.int64)
        number[vertices] = np.arange(len(vertices))
        self.vertices, self.x = vertices, mesh.p[:, vertices]
        self.element, self.nodes, self.sizes = element, number[cells], sizes
        self._N = element.values(rule_of(element, "mass").points)

    @cached_property
    def total(self) -> Values:
        """Integrals of `N_a` (nv,)."""
        if self.element.is_linear_simplex:
            return self.add(np.broadcast_to(self.sizes / len(self.nodes), self.nodes.shape))
        return self.add(np.einsum("qa,qn->an", self._N, self._at_points()))

    def shares(self, values: Values) -> Values:
        """Return the integral (c, m, n) of `N_a f` over each cell, from `values` (c, nv) at the nodes or (c, 1) everywhere."""
        m, constant = len(self.nodes), values.shape[1] == 1
        if self.element.is_linear_simplex and constant:
            return np.broadcast_to((values * self.sizes / m)[:, None], (len(values), *self.nodes.shape))
        if self.element.is_linear_simplex:
            f = values[:, self.nodes]
            return np.asarray((f + f.sum(axis=1, keepdims=True)) * self.sizes / (m * (m + 1)))
        return np.einsum("qa,cqn->can", self._N, self.at_points * self.interpolated(values))

    def integrate(self, values: Values) -> Values:
        """Return the integral (nv, c) of `N_a f` over all cells, from `values` (c, nv) or (c, 1)."""
        if values.shape[1] == 1:
            return self.total[:, None] * values[:, 0]
        return np.stack([self.add(component) for component in self.shares(values)], axis=1)

    def add(self, at_nodes: Values) -> Values:
        """Return the sums (nv,) at the nodes of the values at the nodes of the cells (m, n)."""
        sums: NDArray[Any] = np.bincount(self.nodes.ravel(), weights=at_nodes.ravel(), minlength=len(self.vertices))
        return sums

    def interpolated(self, values: Values) -> Values:
        """Return values (c, nq, n) at the points of the rule, from `values` (c, nv) at the nodes or (c, 1) everywhere."""
        if values.shape[1] == 1:
            return values[:, :, None]
        return np.einsum("qa,can->cqn", self._N, values[:, self.nodes])

    def matrices(self) -> Values:
        """Return the integral (m, m, n) of `N_a N_b` over each cell."""
        m = len(self.nodes)
        if self.element.is_linear_simplex:
            return (1 + np.eye(m))[:, :, None] * (self.sizes / (m * (m + 1)))
        return np.asarray(np.einsum("qa,qb->abq", self._N, self._N) @ self._at_points())

    @cached_property
    def at_points(self) -> Values:
        """Fraction (nq, n) of the size of each cell at each point of the rule."""
        return self._at_points()

    def _at_points(self) -> Values:
        return np.asarray(shares_of_points(self.x, self.nodes, self.element) * self.sizes)

    def memory(self) -> int:
        """Return the bytes of its arrays."""
        arrays = [value for value in vars(self).values() if isinstance(value, np.ndarray)]
        return sum(array.nbytes for array in arrays)
