"""Preconditioned conjugate gradients: the stopping rule, and two loops.

One loop calls functions that multiply and precondition on several threads. The other is compiled as a whole, for edges on one
thread.
"""

from __future__ import annotations

from collections.abc import Callable
from math import nan
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from ..errors import StateError, StvkError, name_ids
from ..kernels import compiled_cg as kernels
from ..kernels import sparse as products
from ..kernels.compiled import Ids
from ..kernels.threads import parts_of, run, threads
from ..space import Space
from .solver import NO_BLOCKS, NO_ROWS, CheckedAnalysis, CheckedFactors, EdgeBlocks, Outcome, Solution, Vector, latest_only

Map = Callable[[Vector], Vector]
#: Largest number of iterations. On slender bodies, iterations grow at least as fast as the number of elements along them.
MAX_ITERATIONS = 50_000
#: Number of edges that one call processes over its iterations: 50 ms, after which Python checks for Ctrl-C.
STRETCH = 10_000_000
OUTCOMES = {kernels.CONVERGED: Outcome.SOLVED, kernels.NEGATIVE: Outcome.NEGATIVE_CURVATURE, kernels.NOT_FINITE: Outcome.NOT_FINITE}


class Search(Protocol):
    """State of an iteration.

    `size` is `|b|`, and `norm` is `|b - K x|` as the loop updates it. `curvature` is the quotient `p'Kp / p'p` of a direction of
    negative curvature, if it is known.
    """

    size: float
    norm: float
    iterations: int
    curvature: float

    def run(self, tolerance: float, max_iterations: int) -> Outcome:
        """Iterate until the residual is at most `tolerance`, or the iteration ends for another reason."""

    def true_residual(self) -> float:
        """Compute `|b - K x|` again from x, and continue with this residual. The next search direction is that of a new start."""

    def x(self) -> Vector:
        """Return the current iterate (n,)."""


def solve_by(search: Search, b: Vector, rtol: float, max_iterations: int) -> Solution:
    """Return `x` with `|b - K x| <= rtol |b|`, or the last iterate.

    The iteration ends early if `p'Kp <= 0`, after `max_iterations` iterations, or at values that are not finite. At the end, the
    residual of the loop is compared with that of x. If that of x is too large, the loop starts again, once.
    """
    size, first = search.size, search.norm
    if not np.isfinite(first + size):
        return Solution.none(b, Outcome.NOT_FINITE)
    if size == 0:
        return Solution(np.zeros_like(b), 0, 0.0, Outcome.SOLVED)
    residual = first
    for tolerance in (rtol * size, rtol * size / 2):
        before = search.iterations
        outcome = search.run(tolerance, max_iterations)
        residual = search.true_residual() if search.iterations > before else residual
        if outcome is not Outcome.SOLVED or residual <= rtol * size:
            break
    if not np.isfinite(residual):
        return Solution.none(b, Outcome.NOT_FINITE)
    if outcome is Outcome.SOLVED and residual > rtol * size:
        outcome = Outcome.INACCURATE
    return Solution(search.x(), search.iterations, residual / size, outcome, first / size, search.curvature)


def conjugate_gradients(
    product: Map,
    precondition: Map,
    b: Vector,
    rtol: float,
    max_iterations: int,
    x0: Vector | None = None,
    *,
    space: Space | None = None,
) -> Solution:
    """Solve as in `solve_by`, from `x0` or zero, with functions for `K v` and for an approximate `K^-1 r`.

    `space` is that of the vectors, by default all (n,).
    """
    return solve_by(_Search(product, precondition, b, x0, space or Space(len(b))), b, rtol, max_iterations)


class _Search:
    """Iterates `x`, residuals `r` and directions `p` of conjugate gradients with functions.

    Each iteration has two reductions over the parts of a divided body. There, the norm of the residual is computed together with
    the products of the next iteration's preconditioned residual.
    """

    def __init__(self, product: Map, precondition: Map, b: Vector, x0: Vector | None, space: Space) -> None:
        self._product, self._precondition, self._b, self.space = product, precondition, b, space
        ends = [end for own in space.owned for end in (own.start, own.stop)]
        self._parts = np.union1d(parts_of(len(b), 0.1, threads()), ends).astype(np.int64)
        self._counted = [any(own.start <= begin < own.stop for own in space.owned) for begin in self._parts[:-1]]
        self._x, self._r, self._p, self._before = np.zeros_like(b), b.copy(), np.zeros_like(b), np.empty_like(b)
        self.size = self.norm = float(np.sqrt(self._dot(b, b)))
        self._rho, self.iterations, self.curvature = 0.0, 0, nan
        self._next: tuple[Vector, float, float] | None = None
        if x0 is not None:
            np.copyto(self._x, x0)
            self.true_residual()

    def run(self, tolerance: float, max_iterations: int) -> Outcome:
        while self.norm > tolerance:
            if self.iterations >= max_iterations:
                return Outcome.OUT_OF_ITERATIONS
            outcome = self._iterate()
            if outcome is not None:
                return outcome
        return Outcome.SOLVED

    def true_residual(self) -> float:
        self._r = self._b - self._product(self._x)
        self._rho, self.norm, self._next = 0.0, float(np.sqrt(self._dot(self._r, self._r))), None
        return self.norm

    def x(self) -> Vector:
        return self._x

    def _iterate(self) -> Outcome | None:
        """Make one iteration. Return the outcome if it is the last one.

        The preconditioner may be slightly unsymmetric by rounding, therefore `beta = z'(r - r_before) / (z'r)_before` (Polak,
        Ribiere).
        """
        z, rho, of_before = self._next or self._preconditioned()
        before = self._rho
        if not rho > 0:
            return Outcome.NEGATIVE_CURVATURE if np.isfinite(rho) else Outcome.NOT_FINITE
        beta = max((rho - of_before) / before, 0.0) if before else 0.0
        run(products.update_search_direction, self._parts, beta, z, self._p)
        q = self._product(self._p)
        curvature = self._dot(self._p, q)
        if not curvature > 0:
            self.curvature = curvature / (self._dot(self._p, self._p) or nan)
            return Outcome.NEGATIVE_CURVATURE if np.isfinite(curvature) else Outcome.NOT_FINITE
        np.copyto(self._before, self._r)
        self._rho, square = rho, self._sum(run(products.step, self._parts, rho / curvature, self._p, q, self._x, self._r))
        if self.space.comm.divided:
            z = self._precondition(self._r)
            square, rho, of_before = self.space.comm.total(np.array([square, self._part(z, self._r), self._part(z, self._before)]))
            self._next = z, float(rho), float(of_before)
        self.norm = float(np.sqrt(square))
        self.iterations += 1
        return None if np.isfinite(square) else Outcome.NOT_FINITE

    def _preconditioned(self) -> tuple[Vector, float, float]:
        """Return the preconditioned residual `z`, `z'r` and `z'r_before`, 0 in the first iteration."""
        z = self._precondition(self._r)
        return z, self._dot(z, self._r), self._dot(z, self._before) if self._rho else 0.0

    def _dot(self, x: Vector, y: Vector) -> float:
        return self.space.comm.total(self._part(x, y))

    def _part(self, x: Vector, y: Vector) -> float:
        """Return the contribution of this part of the body to `x'y`."""
        return self._sum(run(products.dot, self._parts, x, y))

    def _sum(self, found: list[float]) -> float:
        """Return the sum of the results of kernels for the entries that count in this part of the body."""
        return float(sum(one for one, counted in zip(found, self._counted, strict=True) if counted))


def dot(parts: NDArray[np.int64], x: Vector, y: Vector) -> float:
    """Return `x'y`, computed by kernels. BLAS would start threads that wait actively and slow down the threads of the kernels."""
    return float(sum(run(products.dot, parts, x, y)))


class EdgeCg:
    """Conjugate gradients on blocks of edges (ne, 2), pairs of block rows `a < b`, on one thread.

    `vertices` (rows,) are the vertices of the block rows, for messages. `indices` (n,) are the indices `3 row + component` of the
    unknowns. With `assembled`, the caller supplies the diagonal, block by block. Otherwise the diagonal is a shift minus the blocks
    of edges. `omega` is the relaxation factor of SSOR. SSOR on edges that are not sorted needs a copy of the blocks. `omega = 0`
    selects the diagonal blocks alone.
    """

    def __init__(self, edges: Ids, vertices: Ids, indices: NDArray[np.int64], assembled: bool, omega: float) -> None:
        self._order = _sorting(edges) if omega > 0 else None
        self.edges = edges if self._order is None else edges[self._order]
        self._vertices, self._indices, self._omega = vertices, indices, omega
        rows = len(vertices)
        is_constrained = np.ones(3 * rows, dtype=bool)
        is_constrained[indices] = False
        self._constrained, self._rows = np.flatnonzero(is_constrained), np.arange(rows)
        self._held_diagonal = 9 * (self._constrained // 3) + 4 * (self._constrained % 3)
        self.diagonal, self.inverse = np.zeros((9 if assembled else 3) * rows), np.zeros(9 * rows)
        self._none, self._work, self._state = np.zeros(rows), np.zeros((6, 3 * rows)), np.zeros(4)
        self._blocks: NDArray[np.floating[Any]] = np.empty(0)
        self._indefinite = False
        self._ground: tuple[Ids, NDArray[np.floating[Any]]] = NO_ROWS, NO_BLOCKS
        self._b: Vector = np.empty(0)
        self.iterations, self.size, self.norm, self.curvature = 0, 0.0, 0.0, nan

    def shift(self, K: EdgeBlocks) -> None:
        """Set the blocks of the edges, and the stiffness of unknowns and of vertices against the ground."""
        shift, self._ground = K.shift, (K.grounded, K.ground)
        added = self._none[:0] if shift is None else shift
        if shift is None:
            self.diagonal[:] = 0
        elif shift.shape != self._indices.shape:
            expected = f"{self._indices.shape}, a value for each free degree of freedom"
            raise StvkError(f"The shift has shape {shift.shape}; expected {expected}.")
        blocks = self._sorted(K.blocks)
        unknowns = self._constrained, self._indices
        total = kernels.shifted_diagonal(self.edges, blocks, *self._ground, *unknowns, added, self.diagonal, self.inverse)
        self._invert(blocks, total)

    def fill(self, blocks: NDArray[np.floating[Any]]) -> None:
        """Set the blocks above the diagonal. The diagonal must be in `diagonal`."""
        np.copyto(self.inverse, self.diagonal)
        self._invert(blocks, float(self.inverse.sum()))

    def _invert(self, blocks: NDArray[np.floating[Any]], total: float) -> None:
        if not np.isfinite(total):
            bad = self._vertices[~np.isfinite(self.inverse.reshape(-1, 9)).all(axis=1)]
            raise StateError(f"The diagonal of K is not finite at {name_ids(bad, 'vertex')}: did the previous step diverge?")
        negative = products.invert_diagonal(0, len(self._rows), self._rows, self.inverse, self._none, self.inverse)
        self.inverse[self._held_diagonal] = 0
        if self._omega > 0:
            self.inverse *= self._omega
        self._blocks, self._indefinite = blocks, self._omega > 0 and negative > 0

    def _sorted(self, blocks: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
        """Return the blocks in the order of the sorted edges."""
        if self._order is None:
            return blocks
        if self._blocks.dtype != blocks.dtype or self._blocks.shape != blocks.shape:
            self._blocks = np.empty_like(blocks)
        np.take(blocks.reshape(-1, 9), self._order, axis=0, out=self._blocks.reshape(-1, 9), mode="clip")
        return self._blocks

    def solve(self, b: Vector, rtol: float, max_iterations: int, x0: Vector | None, out: Vector | None) -> Solution:
        """Solve from `x0` or from zero, and write x to `out`."""
        self._b, self._out = b, np.empty(len(b)) if out is None else out
        x = self._work[kernels.X]
        if x0 is None:
            x[:] = 0
        else:
            x[self._indices] = x0
        self.iterations, self.size = 0, float(np.sqrt(np.einsum("i,i", b, b)))
        self.true_residual()
        return solve_by(self, b, rtol, max_iterations)

    def precondition(self, r: Vector) -> Vector:
        """Return the preconditioned residual `M^-1 r` (n,)."""
        s = self._work[kernels.S]
        s[:] = 0
        s[self._indices] = r
        kernels.precondition(self.edges, self._blocks, self.inverse, self._constrained, self._omega, self._work)
        return np.asarray(self._work[kernels.T, self._indices])

    def true_residual(self) -> float:
        own = self.edges, self._blocks, self.diagonal, *self._ground, self._constrained
        kernels.residual(*own, self._indices, self._b, self._state, self._work)
        self.norm = float(self._state[kernels.NORM])
        return self.norm

    def run(self, tolerance: float, max_iterations: int) -> Outcome:
        """Iterate as described in `Search`.

        An indefinite diagonal block has a direction of negative curvature, which SSOR would not detect. It ends the iteration at
        once.
        """
        if self._indefinite:
            return Outcome.NEGATIVE_CURVATURE
        own = self.edges, self._blocks, self.diagonal, *self._ground, self.inverse, self._constrained, self._omega
        stretch, ended = max(1, STRETCH // max(1, len(self.edges))), kernels.UNFINISHED
        while ended == kernels.UNFINISHED:
            if self.iterations >= max_iterations:
                return Outcome.SOLVED if self.norm <= tolerance else Outcome.OUT_OF_ITERATIONS
            ended, done = kernels.iterate(*own, tolerance, min(stretch, max_iterations - self.iterations), self._state, self._work)
            self.iterations += done
        self.norm = float(self._state[kernels.NORM])
        return OUTCOMES[ended]

    def x(self) -> Vector:
        return np.take(self._work[kernels.X], self._indices, out=self._out, mode="clip")


def _sorting(edges: Ids) -> Ids | None:
    """Return the order that sorts the edges; None if they are sorted."""
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    return order if (np.diff(order) != 1).any() else None


class EdgeFactors(CheckedFactors):
    """Preconditioner of one matrix, in the arrays of its analysis."""

    negative_pivots: ClassVar[None] = None

    def __init__(self, analysis: CheckedAnalysis, search: EdgeCg) -> None:
        super().__init__(analysis)
        self._search = search

    def _solve(self, b: Vector, rtol: float, x0: Vector | None, out: Vector | None) -> Solution:
        """Solve by conjugate gradients, in the compiled loop."""
        return self._search.solve(b, rtol, MAX_ITERATIONS, x0, out)

    @latest_only
    def precondition(self, r: Vector) -> Vector:
        """Return the preconditioned residual `M^-1 r` (n,). With `omega = 0` it is the inverse diagonal blocks times `r`."""
        return self._search.precondition(r)
