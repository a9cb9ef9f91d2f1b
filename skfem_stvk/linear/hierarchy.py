"""Smoothed aggregation: the levels, how they are filled, and the cycle."""

from __future__ import annotations

import numpy as np

from ..kernels.sparse import invert_dense
from .blocks import BlockStructure, Reals
from .level import SINGLE, Coarsening, Level

#: Nodes of the coarsest level at most: it is solved by its dense inverse.
COARSEST = 50


class Hierarchy:
    """Levels of a matrix, from fine to coarse: an approximate inverse, symmetric and positive definite.

    Parameters
    ----------
    finest : the matrix.
    modes : (3 n, r) displacements of little energy, in the block rows of the matrix.
    scale : of the values in single precision.
    """

    def __init__(self, finest: Level, modes: Reals, scale: float) -> None:
        count = -(-modes.shape[1] // 3)
        self._levels: list[Level] = [finest]
        self._ways: list[Coarsening] = []
        blocks = _in_blocks(modes, count)
        while (level := self._levels[-1]).graph.shape[0] > COARSEST:
            level.invert()
            way = Coarsening(level, count)
            if way.graph.shape[0] == level.graph.shape[0]:
                break
            blocks = way.prolong(level, blocks, scale)
            self._ways.append(way)
            structure = way.structure
            self._levels.append(Level(way.graph, structure, structure.diagonal(), structure.room(), structure.room(SINGLE)))
            self._fill(len(self._ways), scale)
        self._solve_coarsest(scale)
        self._rhs = [np.empty_like(level.x) for level in self._levels]
        self._sums = [np.empty_like(level.x) for level in self._levels]

    def refresh(self, scale: float) -> None:
        """All levels anew from the values of the finest; R and P stay."""
        for number in range(1, len(self._levels)):
            self._levels[number - 1].invert()
            self._fill(number, scale)
        self._solve_coarsest(scale)

    def __call__(self, b: Reals) -> Reals:
        """One cycle, for `b` in single precision; the result is overwritten by the next."""
        return self._cycle(0, b)

    def _fill(self, number: int, scale: float) -> None:
        above, level = self._levels[number - 1], self._levels[number]
        self._ways[number - 1].galerkin(above, level.blocks)
        level.scale(scale)

    def _solve_coarsest(self, scale: float) -> None:
        """The inverse, as a matrix of blocks; of an indefinite matrix that of its absolute value."""
        level = self._levels[-1]
        n, dense = level.A.n, scale * level.A.dense(level.blocks)
        inverse = dense.copy()
        if not invert_dense(inverse):
            values, vectors = np.linalg.eigh((dense + dense.T) / 2)
            sizes = np.abs(values)
            inverse = (vectors / np.maximum(sizes, 1e-12 * sizes.max())) @ vectors.T
        self._inverse = np.ascontiguousarray(inverse.reshape(n, 3, n, 3).transpose(0, 2, 1, 3), SINGLE).ravel()
        rows, columns = n * np.arange(n + 1, dtype=np.int32), np.tile(np.arange(n, dtype=np.int32), n)
        self._full = BlockStructure(rows, columns, n, np.array([0, n]))

    def _cycle(self, number: int, b: Reals) -> Reals:
        level = self._levels[number]
        if number == len(self._ways):
            return self._full.product(self._inverse, b, level.x)
        way = self._ways[number]
        coarse = way.restrict(level.forward(b), self._rhs[number + 1])
        way.correct(self._twice(number + 1, coarse), level.x)
        return level.backward(b)

    def _twice(self, number: int, b: Reals) -> Reals:
        """Two cycles (W): coarse levels cost little, and inexact ones cost the finest iterations."""
        level, total = self._levels[number], self._sums[number]
        x = self._cycle(number, b)
        if number == len(self._ways):
            return x
        np.copyto(total, x)
        level.A.product(level.single, total, level.x)
        b -= level.x
        total += self._cycle(number, b)
        return total


def _in_blocks(modes: Reals, count: int) -> Reals:
    """(9 count n,) modes as `count` blocks a block row, padded with zeros."""
    padded = np.zeros((len(modes), 3 * count))
    padded[:, : modes.shape[1]] = modes
    return np.ascontiguousarray(padded.reshape(-1, 3, count, 3).transpose(0, 2, 1, 3)).ravel()
