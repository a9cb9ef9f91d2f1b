"""Conjugate gradients on the edges of one part of a divided body: compiled pieces between the exchanges with other parts."""

from __future__ import annotations

from itertools import pairwise
from math import isfinite, nan, sqrt

import numpy as np
from numpy.typing import NDArray

from ..kernels import compiled_cg as kernels
from ..kernels import sparse as products
from ..kernels.compiled import Ids
from ..kernels.threads import run
from ..space import Space
from .cg import solve_by
from .solver import NO_BLOCKS, NO_ROWS, EdgeBlocks, Outcome, Solution, Vector


class PartCg:
    """Conjugate gradients with the blocks of edges between the nodes (nv,) of a part, with three components each.

    `space` is that of the nodes, and `edges` (ne, 2) are pairs of them; `indices` (n,) are the indices `3 node + component` of the
    unknowns. `inverse` (9 nv,) are the inverses of the diagonal blocks of the whole K. Residuals are zero at constrained
    components. An iteration has one exchange at shared nodes and two reductions.
    """

    def __init__(self, edges: Ids, K: EdgeBlocks, inverse: Vector, indices: NDArray[np.int64], space: Space) -> None:
        self._edges, self._blocks, self._inverse = edges, K.blocks, inverse
        self._indices, self._space, n = indices, space, space.n
        is_constrained = np.ones(n, dtype=bool)
        is_constrained[indices] = False
        self._constrained = np.flatnonzero(is_constrained)
        self._diagonal = np.zeros(n)
        if K.shift is not None:
            self._diagonal[indices] = K.shift
            self._diagonal = space.counted(self._diagonal)  # each node once, as blocks are added up
        self._b, self._x, self._r, self._s, self._p, self._q = (np.zeros(n) for _ in range(6))
        ends = np.unique([0, n, *(end for own in space.owned for end in (own.start, own.stop))])
        self._parts = [(a, b, any(own.start <= a < own.stop for own in space.owned)) for a, b in pairwise(ends.tolist())]

    def solve(self, b: Vector, rtol: float, max_iterations: int, x0: Vector | None, out: Vector | None) -> Solution:
        """Solve from `x0` or from zero, together with the other parts, and write x to `out`."""
        self._out = np.empty(len(b)) if out is None else out
        for full, vector in ((self._b, b), (self._x, x0)):
            full[self._indices] = 0.0 if vector is None else vector
        self.iterations, self.curvature, self._rho, self._last = 0, nan, 0.0, 0.0
        self.size = self._space.norm(self._b)
        self.true_residual()
        return solve_by(self, b, rtol, max_iterations)

    def x(self) -> Vector:
        return np.take(self._x, self._indices, out=self._out, mode="clip")

    def precondition(self, r: Vector) -> Vector:
        """Return the product (n,) of the inverse diagonal blocks and `r`."""
        self._r[self._indices] = r
        products.multiply_diagonal(0, len(self._inverse) // 9, self._inverse, self._r, self._s)
        return self._s[self._indices]

    def true_residual(self) -> float:
        self._multiply(0.0, self._x)
        np.subtract(self._b, self._q, out=self._r)
        self._last = 0.0
        self._update(0.0)
        return self.norm

    def run(self, tolerance: float, max_iterations: int) -> Outcome:
        while self.norm > tolerance:
            if self.iterations >= max_iterations:
                return Outcome.OUT_OF_ITERATIONS
            if not self._rho > 0:
                return Outcome.NEGATIVE_CURVATURE if isfinite(self._rho) else Outcome.NOT_FINITE
            self._multiply(self._rho / self._last if self._last else 0.0, self._s)
            curvature = self._dot(self._p, self._q)
            if not curvature > 0:
                self.curvature = curvature / (self._dot(self._p, self._p) or nan)
                return Outcome.NEGATIVE_CURVATURE if isfinite(curvature) else Outcome.NOT_FINITE
            self._last = self._rho
            self._update(self._rho / curvature)
            self.iterations += 1
            if not isfinite(self.norm):
                return Outcome.NOT_FINITE
        return Outcome.SOLVED

    def _multiply(self, beta: float, s: Vector) -> None:
        """Update the search direction, `p = s + beta p`, and compute `q = K p`."""
        kernels.update_and_multiply(
            self._edges, self._blocks, self._diagonal, NO_ROWS, NO_BLOCKS, self._constrained, beta, s, self._p, self._q
        )
        self._space.share(self._q)

    def _update(self, alpha: float) -> None:
        """Update x and the residual along `p`, precondition the residual, and compute `|r|` and `r'M^-1 r`."""
        arrays, sums = (self._inverse, self._p, self._q, self._x, self._r, self._s), np.zeros(2)
        for begin, end, counted in self._parts:
            found = kernels.step_and_precondition(begin // 3, end // 3, alpha, *arrays)
            if counted:
                sums += found
        square, self._rho = self._space.total(sums).tolist()
        self.norm = sqrt(square) if square >= 0 else nan

    def _dot(self, x: Vector, y: Vector) -> float:
        own = (run(products.dot, np.array([begin, end]), x, y)[0] for begin, end, counted in self._parts if counted)
        return self._space.total(float(sum(own)))
