"""One level of the hierarchy: Gauss-Seidel sweeps, and the way to the next level."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse import csr_matrix

from ..kernels import sparse as kernels
from ..kernels.threads import parts_of, run, threads
from .aggregation import aggregates
from .blocks import BlockStructure, Ids, Reals

SINGLE: Any = np.float32
TURNS = 8


class Level:
    """A matrix in blocks, in double precision, and `scale` times it in single, which is enough to smooth with.

    Attributes
    ----------
    graph : of its nodes, with the diagonal, columns sorted.
    A, blocks, single : structure and values.
    x : (3 n,) the result of the last sweep.
    """

    def __init__(self, graph: csr_matrix, structure: BlockStructure, diagonal: Ids, blocks: Reals, single: Reals) -> None:
        self.graph, self.A, self.blocks, self.single = graph, structure, blocks, single
        self._diagonal, n = diagonal, structure.n
        self._inverse, self._extra = np.empty(9 * n, SINGLE), np.zeros(n, SINGLE)
        self.x, self._left = np.empty(3 * n, SINGLE), np.empty(3 * n, SINGLE)

    def scale(self, scale: float) -> None:
        """Copy to single precision; an unknown that no mode of the level above reaches gets a diagonal."""
        entries = self.blocks.reshape(-1, 9)
        for component in (0, 4, 8):
            dead = self._diagonal[entries[self._diagonal, component] == 0]
            entries[dead, component] = 1 / scale
        np.multiply(self.blocks, scale, out=self.single, casting="same_kind")

    def invert(self) -> None:
        """The diagonal blocks, for sweeps that go on in parts at the same time."""
        A = self.A
        if len(A.parts) > 2:
            run(kernels.outside, A.parts, A.rows, A.columns, self.single, self._extra)
        run(kernels.invert_diagonal, A.parts, self._diagonal, self.single, self._extra, self._inverse)

    def forward(self, b: Reals) -> Reals:
        """`x` from zero by a forward sweep; the residual."""
        A = self.A
        run(kernels.sweep_forward, A.parts, A.rows, A.columns, self._diagonal, self.single, self._inverse, b, self.x)
        own = A.rows, A.columns, self._diagonal, self.single, self._extra, self.x, self._left
        run(kernels.residual_after_forward, A.parts, *own)
        return self._left

    def backward(self, b: Reals) -> Reals:
        """`x` improved by a backward sweep: the adjoint of the forward one."""
        A, before = self.A, self.x
        if len(A.parts) > 2:
            before = self._left
            np.copyto(before, self.x)
        run(kernels.sweep_backward, A.parts, A.rows, A.columns, self.single, self._inverse, b, before, self.x)
        return self.x

    def smoothed(self, structure: BlockStructure, places: Ids, products: Reals, tentative: Reals, scale: float, out: Reals) -> None:
        """`P = T - 4/3 / rho D^-1 A T` from `products`, A T in the structure of P; `places` of T in it."""
        count = len(tentative) // (9 * self.A.n)
        omega = 4 / 3 / self._spectral_radius() * scale
        own = structure.rows, places, count, self._inverse, omega, products, tentative
        run(kernels.smooth_prolongator, self.A.parts, *own, out)

    def _spectral_radius(self) -> float:
        """Of `D^-1 A`, by some turns of the power method, which stay below it."""
        x = np.random.default_rng(0).standard_normal(3 * self.A.n).astype(SINGLE)
        for _ in range(TURNS):
            x /= self._size(x)
            self.A.product(self.single, x, self._left)
            run(kernels.multiply_diagonal, self.A.parts, self._inverse, self._left, x)
        return 1.1 * self._size(x)

    def _size(self, x: Reals) -> float:
        return float(np.sqrt(sum(run(kernels.dot, 3 * self.A.parts, x, x))))


class Coarsening:
    """From a level to the next: `R = P'`, `A_next = R A P`, P of smoothed aggregation.

    Attributes
    ----------
    structure, graph : of the next level.
    """

    def __init__(self, level: Level, count: int) -> None:
        numbers = aggregates(level.graph, level.A, level.single)
        each, n = level.A.n // level.graph.shape[0], numbers.max() + 1
        tentative = csr_matrix((np.ones(len(numbers), np.float32), numbers, np.arange(len(numbers) + 1)), shape=(len(numbers), n))
        graph = level.graph.astype(np.float32)
        P = _sorted(graph @ tentative)
        AP = _sorted(graph @ P)
        self.graph = _sorted(P.T.tocsr() @ AP)
        self.structure = BlockStructure.of(self.graph, count, count)
        self._T = BlockStructure.of(tentative, each, count)
        self._P, self._AP = BlockStructure.of(P, each, count), BlockStructure.of(AP, each, count)
        self._R, self._transposition = self._P.transposed()
        self._p, self._r, self._ap = self._P.room(SINGLE), self._R.room(SINGLE), self._AP.room()
        self._count, rows = count, np.repeat(numbers, each)
        self._members = np.argsort(rows, kind="stable").astype(np.int32)
        self._starts = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=n))]).astype(np.int32)
        self._places = np.flatnonzero(self._P.columns == count * rows[self._P.row_of_each()])

    def prolong(self, level: Level, modes: Reals, scale: float) -> Reals:
        """P anew, such that it holds `modes` (blocks of T's structure); the modes of the next level."""
        n = len(self._starts) - 1
        coarse = np.empty(9 * self._count**2 * n)
        parts = parts_of(n, 40, threads())
        run(kernels.orthonormalise, parts, self._starts, self._members, self._count, modes, coarse)
        products = level.A.multiply(level.blocks, self._T, modes, self._P, self._P.room())
        level.smoothed(self._P, self._places, products, modes, scale, self._p)
        run(kernels.transpose_blocks, parts_of(len(self._transposition), 0.3, threads()), self._transposition, self._p, self._r)
        return coarse

    def galerkin(self, level: Level, out: Reals) -> None:
        """`R A P` to the values of the next level."""
        level.A.multiply(level.blocks, self._P, self._p, self._AP, self._ap)
        self._R.multiply(self._r, self._AP, self._ap, self.structure, out)

    def restrict(self, residual: Reals, out: Reals) -> Reals:
        """`R r`."""
        return self._R.product(self._r, residual, out)

    def correct(self, error: Reals, x: Reals) -> None:
        """`x += P e`."""
        self._P.product(self._p, error, x, add=True)


def _sorted(graph: csr_matrix) -> csr_matrix:
    graph.sort_indices()
    return graph
