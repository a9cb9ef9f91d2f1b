"""Conjugate gradients, preconditioned: when they end, and the loop of solvers whose products take several threads."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..kernels import sparse as kernels
from ..kernels.threads import parts_of, run, threads
from .direct import nothing
from .solver import Outcome, Solution, Vector

Map = Callable[[Vector], Vector]


class Search(Protocol):
    """Where an iteration is.

    Attributes
    ----------
    size : `|b|`.
    norm : `|b - K x|` as the loop has it.
    iterations : so far.
    """

    size: float
    norm: float
    iterations: int

    def run(self, enough: float, most: int) -> Outcome:
        """Iterate until the residual is small enough, or something else happens."""

    def true_residual(self) -> float:
        """`|b - K x|` from x, and from here on that is the residual; the next direction is the first again."""

    def x(self) -> Vector:
        """(n,) where it is."""


def solve_by(search: Search, b: Vector, rtol: float, most: int) -> Solution:
    """`x` with `|b - K x| <= rtol |b|`, or what there is when `p'Kp <= 0`, after `most` iterations, or when something is not finite.

    The residual that the loop keeps is compared with that of x at the end, and where it was too small the loop starts again from x, once.
    """
    size, first = search.size, search.norm
    if not np.isfinite(first + size):
        return nothing(b, Outcome.NOT_FINITE)
    if size == 0:
        return Solution(np.zeros_like(b), 0, 0.0, Outcome.SOLVED)
    residual = first
    for enough in (rtol * size, rtol * size / 2):
        before = search.iterations
        outcome = search.run(enough, most)
        residual = search.true_residual() if search.iterations > before else residual
        if outcome is not Outcome.SOLVED or residual <= rtol * size:
            break
    if not np.isfinite(residual):
        return nothing(b, Outcome.NOT_FINITE)
    if outcome is Outcome.SOLVED and residual > rtol * size:
        outcome = Outcome.INACCURATE
    return Solution(search.x(), search.iterations, residual / size, outcome, first / size)


def conjugate_gradients(product: Map, precondition: Map, b: Vector, rtol: float, most: int, x0: Vector | None = None) -> Solution:
    """As `solve_by`, from `x0` or from zero, with functions for `K v` and for what is about `K^-1 r`."""
    return solve_by(_Search(product, precondition, b, x0), b, rtol, most)


class _Search:
    """`x`, the residual `r`, the direction `p`."""

    def __init__(self, product: Map, precondition: Map, b: Vector, x0: Vector | None) -> None:
        self._product, self._precondition, self._b = product, precondition, b
        self._parts = parts_of(len(b), 0.1, threads())
        self._x, self._r, self._p, self._before = np.zeros_like(b), b.copy(), np.zeros_like(b), np.empty_like(b)
        self.size = self.norm = float(np.sqrt(self._dot(b, b)))
        self._rho, self.iterations = 0.0, 0
        if x0 is not None:
            np.copyto(self._x, x0)
            self.true_residual()

    def run(self, enough: float, most: int) -> Outcome:
        """Iterate until the residual is small enough, or something else happens."""
        while self.norm > enough:
            if self.iterations >= most:
                return Outcome.OUT_OF_ITERATIONS
            outcome = self._iterate()
            if outcome is not None:
                return outcome
        return Outcome.SOLVED

    def true_residual(self) -> float:
        """`|b - K x|` from x, and from here on that is the residual; the next direction is the first again."""
        self._r = self._b - self._product(self._x)
        self._rho, self.norm = 0.0, float(np.sqrt(self._dot(self._r, self._r)))
        return self.norm

    def x(self) -> Vector:
        """Where it is."""
        return self._x

    def _iterate(self) -> Outcome | None:
        """One step. The preconditioner may be rounded, not quite symmetric: `beta = z'(r - r_before) / (z'r)_before` (Polak, Ribiere)."""
        z = self._precondition(self._r)
        rho, before = self._dot(z, self._r), self._rho
        if not rho > 0:
            return Outcome.NEGATIVE_CURVATURE if np.isfinite(rho) else Outcome.NOT_FINITE
        beta = max((rho - self._dot(z, self._before)) / before, 0.0) if before else 0.0
        run(kernels.turn, self._parts, beta, z, self._p)
        q = self._product(self._p)
        curvature = self._dot(self._p, q)
        if not curvature > 0:
            return Outcome.NEGATIVE_CURVATURE if np.isfinite(curvature) else Outcome.NOT_FINITE
        np.copyto(self._before, self._r)
        square = sum(run(kernels.step, self._parts, rho / curvature, self._p, q, self._x, self._r))
        self.norm, self._rho = float(np.sqrt(square)), rho
        self.iterations += 1
        return None if np.isfinite(square) else Outcome.NOT_FINITE

    def _dot(self, x: Vector, y: Vector) -> float:
        return dot(self._parts, x, y)


def dot(parts: NDArray[np.int64], x: Vector, y: Vector) -> float:
    """`x'y` by kernels: BLAS wakes threads that wait awake, in the way of ours."""
    return float(sum(run(kernels.dot, parts, x, y)))
