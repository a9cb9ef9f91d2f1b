"""Conjugate gradients with smoothed-aggregation multigrid."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from ..errors import StvkError
from ..kernels.threads import locked, parts_of, threads
from .block_matrices import VertexRows
from .cg import conjugate_gradients, dot
from .multigrid import SINGLE, Hierarchy, Level
from .solver import CheckedAnalysis, CheckedFactors, Kind, Solution, Unknowns, Vector, structure_of

#: Largest number of iterations.
MAX_ITERATIONS = 1000

#: The hierarchy is rebuilt when the iterations per decade of the residual exceed this multiple of those just after it was built.
GROWTH = 1.5


@dataclass(frozen=True)
class AmgCg:
    """Conjugate gradients with multigrid. Memory and time grow almost in proportion to the number of unknowns.

    An indefinite matrix is detected. Aggregates consist of strongly coupled vertices, the rigid motions are the near-null space,
    and the smoother is Gauss-Seidel by vertex. For quadratic elements, the second level is that of linear elements on their
    corners. The corners are aggregated on the coarser levels. The cycle works in single precision, conjugate gradients in double.
    The aggregates, R and P are retained from one matrix to the next, until iterations grow.

    >>> import numpy as np
    >>> from scipy.sparse import diags
    >>> K = diags([-1.0, 2.0, -1.0], [-1, 0, 1], shape=(500, 500), format="csr")
    >>> one = np.ones((500, 1))
    >>> unknowns = Unknowns(np.arange(500), np.zeros(500, dtype=int), K.indptr, K.indices, near_null_space=lambda: one)
    >>> solution = AmgCg().analyse(unknowns).factorise(K, Kind.POSITIVE_DEFINITE).solve(one[:, 0], rtol=1e-8)
    >>> solution.outcome.value, bool(solution.iterations < 20)
    ('solved', True)
    """

    name: ClassVar[str] = "amg-cg"
    takes: ClassVar[Kind] = Kind.SYMMETRIC
    matrix_free: ClassVar[bool] = False
    iterative: ClassVar[bool] = True

    def analyse(self, unknowns: Unknowns) -> AmgAnalysis:
        """Compute the block rows and their order, and allocate the values.

        Raises
        ------
        StvkError
            if there is no near-null space, or K does not have a full block for each pair of vertices that it couples.
        """
        return AmgAnalysis(self, unknowns)


class AmgAnalysis(CheckedAnalysis):
    """Arrays for K in blocks, and the hierarchy. Both are retained between Newton steps."""

    def __init__(self, solver: AmgCg, unknowns: Unknowns) -> None:
        super().__init__(solver, unknowns)
        if unknowns.near_null_space is None:
            raise StvkError("near_null_space = None; expected a function that returns the rigid motions: multigrid needs them.")
        self.rows = VertexRows(unknowns)
        indptr, indices = structure_of(unknowns)
        self._diagonal = np.flatnonzero(np.repeat(np.arange(unknowns.n), np.diff(indptr)) == indices)
        structure = self.rows.structure
        self.finest = Level(
            self.rows.graph, structure, self.rows.diagonal, structure.empty_values(), structure.empty_values(SINGLE)
        )
        self.parts = parts_of(len(self.finest.x), 0.1, threads())
        self.hierarchy: Hierarchy | None = None
        self.pace = Pace()

    @locked
    def factorise(self, K: Any, kind: Kind) -> AmgFactors:
        """Compute the values of all levels. Build a hierarchy if there is none, or if the last one has become slow."""
        values = self.begin_with(K, kind)
        size = float(np.abs(values[self._diagonal]).mean())
        scale = 1 / size if size > 0 else 1.0
        self.rows.fill(values, scale, self.finest.blocks, self.finest.single)
        if self.hierarchy is None or self.pace.is_slow:
            modes = self.rows.padded(_modes(self.unknowns))
            self.hierarchy, self.pace = Hierarchy(self.finest, modes, scale, self.rows.midpoints()), Pace()
        else:
            self.hierarchy.refresh(scale)
        return AmgFactors(self)


class AmgFactors(CheckedFactors):
    """Hierarchy with the values of one matrix."""

    negative_pivots: ClassVar[None] = None

    _analysis: AmgAnalysis

    def __init__(self, analysis: AmgAnalysis) -> None:
        super().__init__(analysis)
        self._single = np.empty_like(analysis.finest.x)
        self._product = np.empty(len(self._single))

    def _solve(self, b: Vector, rtol: float, x0: Vector | None, out: Vector | None) -> Solution:
        """Solve by conjugate gradients. Each iteration has a product in double precision and a cycle in single precision."""
        rows = self._analysis.rows
        start = None if x0 is None else rows.padded(x0)
        found = conjugate_gradients(self._multiply, self._precondition, rows.padded(b), rtol, MAX_ITERATIONS, start)
        self._analysis.pace.record(found)
        return replace(found, x=rows.unpadded(found.x))

    def _multiply(self, x: Vector) -> Vector:
        finest = self._analysis.finest
        finest.A.product(finest.blocks, x, self._product)
        return self._product

    def _precondition(self, r: Vector) -> Vector:
        """Run a cycle for `r`, scaled to norm one so that single precision cannot underflow."""
        size = float(np.sqrt(dot(self._analysis.parts, r, r)))
        np.multiply(r, 1 / size, out=self._single, casting="same_kind")
        assert self._analysis.hierarchy is not None
        return np.multiply(self._analysis.hierarchy(self._single), size, dtype=np.float64)


class Pace:
    """Iterations per decade of the residual, in the first and in the last solve with a hierarchy."""

    def __init__(self, first: float | None = None, is_slow: bool = False) -> None:
        self.first, self.is_slow = first, is_slow

    def record(self, found: Solution) -> None:
        """Record the pace of a solve. Solves with few iterations are ignored, because their pace is not meaningful."""
        if found.iterations < 5 or not 0 < found.residual < 0.1 * found.start:
            return
        pace = found.iterations / float(np.log10(found.start / found.residual))
        self.first = self.first or pace
        self.is_slow = pace > GROWTH * self.first


def _modes(unknowns: Unknowns) -> Vector:
    assert unknowns.near_null_space is not None
    modes = np.asarray(unknowns.near_null_space())
    if modes.ndim != 2 or modes.shape[0] != unknowns.n or not 1 <= modes.shape[1] <= 6 or not np.isfinite(modes).all():
        raise StvkError(
            f"near_null_space() has shape {modes.shape}; expected ({unknowns.n}, r), finite, with r = 1 ... 6 rigid motions, "
            "restricted to the unknowns."
        )
    return modes
