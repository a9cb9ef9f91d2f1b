"""Smoothed aggregation: levels with Gauss-Seidel sweeps, aggregates of vertices, and the hierarchy with its cycle."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ..errors import StvkError
from ..kernels import sparse as kernels
from ..kernels.compiled import Ids, Reals
from ..kernels.threads import parts_of, run, threads
from .block_matrices import BlockStructure, EdgeMidpoints

SINGLE: Any = np.float32
POWER_ITERATIONS = 8
#: Nodes are strongly coupled if `|A_ij| >= STRONG sqrt(|A_ii| |A_jj|)`. The value suits slender elements and jumps of stiffness.
STRONG = 0.05
#: Smallest average number of nodes per aggregate. Smaller aggregates make coarse levels expensive, so weaker couplings are
#: included.
MIN_AGGREGATE_SIZE = 5
#: Largest number of nodes of the coarsest level, which is solved by its dense inverse.
MAX_COARSEST_NODES = 50


class Level:
    """Matrix `A` with values `blocks` in double precision, and `scale` times them in `single`, which is sufficient for smoothing.

    `graph` is the graph of its nodes, with the diagonal and sorted columns. `x` (3 n,) is the result of the last sweep.
    """

    def __init__(self, graph: csr_matrix, structure: BlockStructure, diagonal: Ids, blocks: Reals, single: Reals) -> None:
        self.graph, self.A, self.blocks, self.single = graph, structure, blocks, single
        self._diagonal, n = diagonal, structure.n
        self._inverse, self._extra = np.empty(9 * n, SINGLE), np.zeros(n, SINGLE)
        self.x, self._residual = np.empty(3 * n, SINGLE), np.empty(3 * n, SINGLE)

    def scale(self, scale: float) -> None:
        """Copy the values to single precision. An unknown that no mode of the next finer level reaches gets a diagonal entry."""
        entries = self.blocks.reshape(-1, 9)
        for component in (0, 4, 8):
            dead = self._diagonal[entries[self._diagonal, component] == 0]
            entries[dead, component] = 1 / scale
        np.multiply(self.blocks, scale, out=self.single, casting="same_kind")

    def invert(self) -> None:
        """Invert the diagonal blocks, for sweeps whose parts run concurrently."""
        A = self.A
        if len(A.parts) > 2:
            run(kernels.outside_norms, A.parts, A.rows, A.columns, self.single, self._extra)
        run(kernels.invert_diagonal, A.parts, self._diagonal, self.single, self._extra, self._inverse)

    def forward(self, b: Reals) -> Reals:
        """Sweep forward from zero, write the result to `x`, and return the residual."""
        A = self.A
        run(kernels.sweep_forward, A.parts, A.rows, A.columns, self._diagonal, self.single, self._inverse, b, self.x)
        own = A.rows, A.columns, self._diagonal, self.single, self._extra, self.x, self._residual
        run(kernels.residual_after_forward, A.parts, *own)
        return self._residual

    def backward(self, b: Reals) -> Reals:
        """Improve `x` by a backward sweep, the adjoint of the forward one."""
        A, before = self.A, self.x
        if len(A.parts) > 2:
            before = self._residual
            np.copyto(before, self.x)
        run(kernels.sweep_backward, A.parts, A.rows, A.columns, self.single, self._inverse, b, before, self.x)
        return self.x

    def smoothed(
        self, structure: BlockStructure, indices: Ids, products: Reals, tentative: Reals, scale: float, out: Reals
    ) -> None:
        """Write `P = T - 4/3 / rho D^-1 A T`. `products` are A T in the structure of P, in which `indices` are the indices of T."""
        count = len(tentative) // (9 * self.A.n)
        omega = 4 / 3 / self._spectral_radius() * scale
        own = structure.rows, indices, count, self._inverse, omega, products, tentative
        run(kernels.smooth_prolongator, self.A.parts, *own, out)

    def _spectral_radius(self) -> float:
        """Return an estimate of the spectral radius of `D^-1 A` by the power method.

        The result is multiplied by 1.1, because the method underestimates the radius.
        """
        x = np.random.default_rng(0).standard_normal(3 * self.A.n).astype(SINGLE)
        for _ in range(POWER_ITERATIONS):
            x /= self._size(x)
            self.A.product(self.single, x, self._residual)
            run(kernels.multiply_diagonal, self.A.parts, self._inverse, self._residual, x)
        return 1.1 * self._size(x)

    def _size(self, x: Reals) -> float:
        return float(np.sqrt(sum(run(kernels.dot, 3 * self.A.parts, x, x))))


class Transfer(ABC):
    """Transfer to the next level: `R = P'`, and `A_next = R A P` with `structure` and `graph`."""

    graph: csr_matrix
    structure: BlockStructure

    def __init__(self, graph: csr_matrix, P: csr_matrix, row: int, column: int) -> None:
        """Set up the structures from that of P between the nodes of a graph.

        Each node has `row` blocks on the finer level and `column` blocks on the coarser one.
        """
        P, graph = _sorted(P), graph.astype(np.float32)
        AP = _sorted(graph @ P)
        self.graph = _sorted(P.T.tocsr() @ AP)
        self.structure = BlockStructure.of(self.graph, column, column)
        self._P, self._AP = BlockStructure.of(P, row, column), BlockStructure.of(AP, row, column)
        self._R, self._transposition = self._P.transposed()
        self._p, self._r, self._ap = self._P.empty_values(SINGLE), self._R.empty_values(SINGLE), self._AP.empty_values()

    @abstractmethod
    def prolong(self, level: Level, modes: Reals, scale: float) -> Reals:
        """Compute P from the `modes` of a level, and return the modes of the next level."""

    def galerkin(self, level: Level, out: Reals) -> None:
        """Write `R A P` to the values of the next level."""
        level.A.multiply(level.blocks, self._P, self._p, self._AP, self._ap)
        self._R.multiply(self._r, self._AP, self._ap, self.structure, out)

    def restrict(self, residual: Reals, out: Reals) -> Reals:
        """Return the restricted residual `R r`."""
        return self._R.product(self._r, residual, out)

    def correct(self, error: Reals, x: Reals) -> None:
        """Add the correction: `x += P e`."""
        self._P.product(self._p, error, x, add=True)

    def _transpose(self) -> None:
        """Write R as the transpose of P."""
        run(kernels.transpose_blocks, parts_of(len(self._transposition), 0.3, threads()), self._transposition, self._p, self._r)


class Coarsening(Transfer):
    """Transfer to aggregates of nodes, with P by smoothed aggregation."""

    def __init__(self, level: Level, count: int) -> None:
        numbers = aggregates(level.graph, level.A, level.single)
        each, n = level.A.n // level.graph.shape[0], numbers.max() + 1
        tentative = csr_matrix((np.ones(len(numbers), np.float32), numbers, np.arange(len(numbers) + 1)), shape=(len(numbers), n))
        super().__init__(level.graph, level.graph.astype(np.float32) @ tentative, each, count)
        self._T = BlockStructure.of(tentative, each, count)
        self._count, rows = count, np.repeat(numbers, each)
        self._members = np.argsort(rows, kind="stable").astype(np.int32)
        self._starts = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=n))]).astype(np.int32)
        self._indices = np.flatnonzero(self._P.columns == count * rows[self._P.block_rows()])

    def prolong(self, level: Level, modes: Reals, scale: float) -> Reals:
        """Compute P such that its range contains `modes` (blocks of T's structure), and return the modes of the next level."""
        n = len(self._starts) - 1
        coarse = np.empty(9 * self._count**2 * n)
        parts = parts_of(n, 40, threads())
        run(kernels.orthonormalise, parts, self._starts, self._members, self._count, modes, coarse)
        products = level.A.multiply(level.blocks, self._T, modes, self._P, self._P.empty_values())
        level.smoothed(self._P, self._indices, products, modes, scale, self._p)
        self._transpose()
        return coarse


class ToCorners(Transfer):
    """Transfer from quadratic elements to linear ones on their corners. At the middle of an edge, P is the mean of both ends.

    On straight edges, `R A P` is exactly the matrix of the linear elements, except for constrained components. Linear elements are
    stiffer than quadratic ones at a support of a few nodes. The body's motion on such a support would cost additional iterations.
    Therefore, if one end is constrained, the weight of the other end is not always 1/2, as in the mean. The weight is that for
    which the forces at the middle balance, up to a Jacobi step, when all free corners move by one. It is 1/2 next to a wall, and up
    to 1 next to a single node.
    """

    def __init__(self, level: Level, midpoints: EdgeMidpoints) -> None:
        ends, self._known = midpoints
        n = len(ends)
        self._corners = np.flatnonzero(ends[:, 0] == np.arange(n))
        number = np.full(n + 1, -1)
        number[self._corners] = np.arange(len(self._corners))
        row, column = np.repeat(np.arange(n), 2), number[ends].ravel()
        at = column >= 0
        P = csr_matrix((np.full(at.sum(), 0.5, np.float32), (row[at], column[at])), shape=(n, len(self._corners)))
        super().__init__(level.graph, P, 1, 1)
        self._row, self._means = self._P.block_rows(), P.data[:, None] * np.ones(3, SINGLE)
        self._means *= self._known[self._row] & self._known[self._corners[self._P.columns]]
        self._write(self._means)

    def prolong(self, level: Level, modes: Reals, scale: float) -> Reals:
        """Compute P from the values of a level, and return the modes at the corners."""
        self._write(self._means * self._factors(level)[self._row])
        return np.ascontiguousarray(modes.reshape(level.A.n, -1)[self._corners]).ravel()

    def _factors(self, level: Level) -> Reals:
        """Return the factors (n, 3) of the means.

        They are a Jacobi step for the components with one free end, when the free corners move by one.
        """
        sums = np.zeros((level.A.n, 3))
        np.add.at(sums, self._row, self._means)
        out = np.ones_like(sums)
        diagonal = level.blocks.reshape(-1, 3, 3)[level.A.diagonal()]
        for c in range(3):
            moved = np.zeros_like(sums)
            moved[:, c] = sums[:, c]
            force = level.A.product(level.blocks, moved.ravel(), np.empty(3 * level.A.n)).reshape(-1, 3)[:, c]
            half = sums[:, c] == 0.5
            out[half, c] = np.clip(1 - 2 * force[half] / diagonal[half, c, c], 1, 2)
        return out

    def _write(self, values: Reals) -> None:
        """Write P and R from the diagonals of P's blocks (blocks, 3)."""
        self._p[:] = (values[:, :, None] * np.eye(3)).ravel()
        self._transpose()


def _sorted(graph: csr_matrix) -> csr_matrix:
    graph.sort_indices()
    return graph


def aggregates(graph: csr_matrix, structure: BlockStructure, blocks: Reals) -> NDArray[np.int32]:
    """Return the aggregate number (nodes,) of each node, by pyamg's standard aggregation of strongly coupled nodes of the graph.

    The matrix has the same number of block rows for each node.
    """
    norms, diagonal = _norms(graph, structure, blocks)
    row = np.repeat(np.arange(graph.shape[0]), np.diff(graph.indptr))
    strength = norms / np.sqrt(diagonal[row] * diagonal[graph.indices])
    for least in (STRONG, STRONG / 2, STRONG / 4, 0.0):
        numbers = _aggregates(graph, row, (strength >= least) | (row == graph.indices))
        if numbers.max() + 1 <= graph.shape[0] / MIN_AGGREGATE_SIZE:
            break
    return numbers


def _norms(graph: csr_matrix, structure: BlockStructure, blocks: Reals) -> tuple[Reals, Reals]:
    """Return the Frobenius norms of the blocks of the graph's entries, and of its diagonal."""
    squares = np.einsum("ij,ij->i", blocks.reshape(-1, 9), blocks.reshape(-1, 9), dtype=np.float64)
    each = structure.n // graph.shape[0]
    if each > 1:
        coordinates = structure.block_rows() // each, structure.columns // each
        joined = csr_matrix((squares, coordinates), shape=graph.shape)
        joined.sort_indices()
        squares = joined.data
    norms = np.sqrt(squares)
    own = np.repeat(np.arange(graph.shape[0]), np.diff(graph.indptr)) == graph.indices
    return norms, norms[own]


def _aggregates(graph: csr_matrix, row: Ids, retained: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Return aggregates by the retained entries of the graph. A node without neighbours is an aggregate of its own."""
    rows = np.concatenate([[0], np.cumsum(retained)])[graph.indptr].astype(np.int32)
    strong = csr_matrix((np.ones(rows[-1]), graph.indices[retained], rows), shape=graph.shape)
    found, _ = _standard_aggregation()(strong)
    numbers = found.shape[1] + np.arange(graph.shape[0])
    numbers[np.diff(found.indptr) > 0] = found.indices
    return np.unique(numbers, return_inverse=True)[1].astype(np.int32)


def _standard_aggregation() -> Callable[[csr_matrix], tuple[csr_matrix, Ids]]:
    """Return pyamg's function. It is imported on demand, because `python -OO` removes docstrings that pyamg extends."""
    try:
        from pyamg.aggregation.aggregate import standard_aggregation
    except TypeError as error:
        raise StvkError(
            f"pyamg cannot be imported: {error}. solver='amg-cg' uses its aggregation, and pyamg needs docstrings. Run Python "
            "without -OO, or choose solver='superlu', 'pardiso' or 'ssor-cg'."
        ) from error
    aggregation: Callable[[csr_matrix], tuple[csr_matrix, Ids]] = standard_aggregation
    return aggregation


class Hierarchy:
    """Levels of a matrix, from fine to coarse. They form an approximate inverse, symmetric and positive definite.

    The `modes` (3 n, r) are displacements of low energy, in the block rows of the matrix. Values in single precision are multiplied
    by `scale`. If some rows are `midpoints` of edges, as for quadratic elements, the second level is that of the corners.
    """

    def __init__(self, finest: Level, modes: Reals, scale: float, midpoints: EdgeMidpoints | None = None) -> None:
        count = -(-modes.shape[1] // 3)
        self._levels: list[Level] = [finest]
        self._transfers: list[Transfer] = []
        blocks = _in_blocks(modes, count)
        while (level := self._levels[-1]).graph.shape[0] > MAX_COARSEST_NODES:
            level.invert()
            transfer: Transfer = ToCorners(level, midpoints) if midpoints and not self._transfers else Coarsening(level, count)
            if transfer.graph.shape[0] == level.graph.shape[0]:
                break
            blocks = transfer.prolong(level, blocks, scale)
            self._transfers.append(transfer)
            structure = transfer.structure
            self._levels.append(
                Level(transfer.graph, structure, structure.diagonal(), structure.empty_values(), structure.empty_values(SINGLE))
            )
            self._fill(len(self._transfers), scale)
        self._solve_coarsest(scale)
        self._rhs = [np.empty_like(level.x) for level in self._levels]
        self._sums = [np.empty_like(level.x) for level in self._levels]

    def refresh(self, scale: float) -> None:
        """Compute all levels again from the values of the finest; R and P do not change."""
        for number in range(1, len(self._levels)):
            self._levels[number - 1].invert()
            self._fill(number, scale)
        self._solve_coarsest(scale)

    def __call__(self, b: Reals) -> Reals:
        """Run one cycle for `b` in single precision. The next call overwrites the result."""
        return self._cycle(0, b)

    def _fill(self, number: int, scale: float) -> None:
        above, level = self._levels[number - 1], self._levels[number]
        self._transfers[number - 1].galerkin(above, level.blocks)
        level.scale(scale)

    def _solve_coarsest(self, scale: float) -> None:
        """Invert the coarsest matrix, as a matrix of blocks. An indefinite one is replaced by its absolute value."""
        level = self._levels[-1]
        n, dense = level.A.n, scale * level.A.dense(level.blocks)
        inverse = dense.copy()
        if not kernels.invert_dense(inverse):
            values, vectors = np.linalg.eigh((dense + dense.T) / 2)
            sizes = np.abs(values)
            inverse = (vectors / np.maximum(sizes, 1e-12 * sizes.max())) @ vectors.T
        self._inverse = np.ascontiguousarray(inverse.reshape(n, 3, n, 3).transpose(0, 2, 1, 3), SINGLE).ravel()
        rows, columns = n * np.arange(n + 1, dtype=np.int32), np.tile(np.arange(n, dtype=np.int32), n)
        self._full = BlockStructure(rows, columns, n, np.array([0, n]))

    def _cycle(self, number: int, b: Reals) -> Reals:
        level = self._levels[number]
        if number == len(self._transfers):
            return self._full.product(self._inverse, b, level.x)
        transfer = self._transfers[number]
        coarse = transfer.restrict(level.forward(b), self._rhs[number + 1])
        transfer.correct(self._twice(number + 1, coarse), level.x)
        return level.backward(b)

    def _twice(self, number: int, b: Reals) -> Reals:
        """Run two cycles (W). Coarse levels are cheap, and inexact coarse solves cost iterations on the finest level."""
        level, total = self._levels[number], self._sums[number]
        x = self._cycle(number, b)
        if number == len(self._transfers):
            return x
        np.copyto(total, x)
        level.A.product(level.single, total, level.x)
        b -= level.x
        total += self._cycle(number, b)
        return total


def _in_blocks(modes: Reals, count: int) -> Reals:
    """Return the modes (9 count n,) as `count` blocks per block row, padded with zeros."""
    padded = np.zeros((len(modes), 3 * count))
    padded[:, : modes.shape[1]] = modes
    return np.ascontiguousarray(padded.reshape(-1, 3, count, 3).transpose(0, 2, 1, 3)).ravel()
