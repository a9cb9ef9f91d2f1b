"""Conjugate gradients on blocks of vertices, preconditioned by their diagonal or by sweeps over them (SSOR)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import triu

from ..arguments import flag, shown
from ..errors import StateError, StvkError, name_ids
from ..kernels.compiled_cg import fill_edges
from ..kernels.sparse import invert_diagonal, multiply_diagonal
from ..kernels.threads import locked, parts_of, run, threads
from ..space import Space
from .block_matrices import BlockStructure, VertexRows
from .cg import MAX_ITERATIONS, EdgeCg, EdgeFactors, conjugate_gradients
from .solver import (
    CheckedAnalysis,
    CheckedFactors,
    EdgeBlocks,
    Kind,
    LinearSolver,
    Operator,
    Solution,
    Unknowns,
    Vector,
    latest_only,
)


@dataclass(frozen=True)
class BlockJacobiCg:
    """Conjugate gradients with the least memory: neither K nor its pattern is formed. Iterations grow with refinement.

    For a body with one term, the whole loop is compiled and runs on one thread. This is faster than Python with products on any
    number of threads.

    Attributes
    ----------
    assembled
        Use K as a matrix instead, and store the blocks on and above the diagonal. This gives the compiled loop to bodies with
        several terms, and to any other matrix.

    Examples
    --------
    >>> import numpy as np
    >>> class Springs:
    ...     def matvec(self, v):
    ...         return 3 * v - np.roll(v, 1) - np.roll(v, -1)
    ...     def diagonal_blocks(self):
    ...         return np.full((8, 1, 1), 3.0)
    >>> unknowns = Unknowns(np.arange(8), np.zeros(8, dtype=int))
    >>> factors = BlockJacobiCg().analyse(unknowns).factorise(Springs(), Kind.POSITIVE_DEFINITE)
    >>> factors.solve(np.arange(8.0), rtol=1e-12).outcome.value
    'solved'
    """

    assembled: bool = False

    name: ClassVar[str] = "block-jacobi-cg"
    omega: ClassVar[float] = 0.0
    takes: ClassVar[Kind] = Kind.SYMMETRIC
    iterative: ClassVar[bool] = True

    @property
    def on_parts(self) -> bool:
        """Whether the solver takes an operator of a divided body."""
        return not self.assembled

    def __post_init__(self) -> None:
        object.__setattr__(self, "assembled", flag("assembled", self.assembled))

    @property
    def matrix_free(self) -> bool:
        """Whether the solver requires an `Operator` instead of a matrix."""
        return not self.assembled

    def analyse(self, unknowns: Unknowns) -> BlockJacobiAnalysis | AssembledAnalysis:
        """Determine which components of which vertices are unknown.

        Raises
        ------
        StvkError
            if K is to be assembled, and its structure is missing, or lacks a full block for a pair of vertices that it couples.
        """
        return AssembledAnalysis(self, unknowns, self.omega) if self.assembled else BlockJacobiAnalysis(self, unknowns)


class BlockJacobiAnalysis(CheckedAnalysis):
    """Indices of the unknowns in the diagonal blocks."""

    def __init__(self, solver: BlockJacobiCg, unknowns: Unknowns) -> None:
        super().__init__(solver, unknowns)
        self._omega = solver.omega
        self._vertices, row = np.unique(unknowns.vertex, return_inverse=True)
        self._row, self._component = row.ravel(), unknowns.component
        self.unknown_indices = 3 * self._row + self._component
        self._edges: NDArray[np.integer[Any]] | None = None
        self._search: EdgeCg | None = None

    @locked
    def factorise(self, K: Operator, kind: Kind) -> BlockJacobiFactors | EdgeFactors:
        """Invert the diagonal blocks. K itself is not copied, so it must not change while the factors are used."""
        self.begin(kind)
        if not hasattr(K, "matvec") or not hasattr(K, "diagonal_blocks"):
            raise StvkError(f"K = {shown(K)}; '{self.solver.name}' expects an operator with matvec(v) and diagonal_blocks().")
        by_edges = K.by_edges() if hasattr(K, "by_edges") else None
        search = None if by_edges is None else self._search_on(by_edges)
        if by_edges is not None and search is not None:
            search.shift(by_edges)
            return EdgeFactors(self, search)
        return BlockJacobiFactors(self, K, self._inverse_of(K))

    def _inverse_of(self, K: Operator) -> Vector:
        """Return `_inverted` of the diagonal blocks of K, which are finite in all parts of a divided body."""
        diagonal, space = np.asarray(K.diagonal_blocks()), getattr(K, "space", Space(self.n))
        with space.comm.together():
            return self._inverted(diagonal)

    def _search_on(self, K: EdgeBlocks) -> EdgeCg | None:
        """Return the compiled loop on these edges, and store it. Return None if a vertex with unknowns has no edge."""
        if self._edges is not K.edges:
            number = np.full(max(K.vertices.max(), self._vertices[-1]) + 1, -1)
            number[K.vertices] = np.arange(len(K.vertices))
            indices = 3 * number[self.unknowns.vertex] + self._component
            self._edges, self._search = K.edges, None
            if indices.min() >= 0:
                self._search = EdgeCg(K.edges, K.vertices, indices, assembled=False, omega=self._omega)
        return self._search

    def _inverted(self, diagonal: Vector) -> Vector:
        """Return the inverses (9 rows,) of the diagonal blocks of vertices that have unknowns.

        Constrained components are omitted.
        """
        d, count = diagonal.shape[-1], len(self._vertices)
        is_free = np.zeros((count, 3), dtype=bool)
        is_free[self._row, self._component] = True
        blocks = np.zeros((count, 3, 3))
        blocks[:, :d, :d] = diagonal[self._vertices]
        blocks[~(is_free[:, :, None] & is_free[:, None, :])] = 0
        bad = self._vertices[~np.isfinite(blocks).all(axis=(1, 2))]
        if len(bad):
            raise StateError(f"The diagonal of K is not finite at {name_ids(bad, 'vertex')}: did the previous step diverge?")
        inverse, parts = np.empty(9 * count), parts_of(count, 1, threads())
        run(invert_diagonal, parts, np.arange(count), blocks.ravel(), np.zeros(count), inverse)
        return inverse


class BlockJacobiFactors(CheckedFactors):
    """Operator with the inverses of its diagonal blocks."""

    negative_pivots: ClassVar[None] = None

    _analysis: BlockJacobiAnalysis

    def __init__(self, analysis: BlockJacobiAnalysis, K: Operator, inverse: Vector) -> None:
        super().__init__(analysis)
        self._K, self._inverse = K, inverse
        self._space = getattr(K, "space", None)
        self._padded, self._out = np.zeros(len(inverse) // 3), np.empty(len(inverse) // 3)
        self._parts: NDArray[np.int64] = parts_of(len(inverse) // 9, 1, threads())

    def _solve(self, b: Vector, rtol: float, x0: Vector | None, out: Vector | None) -> Solution:
        """Solve by conjugate gradients, with one product per iteration."""
        return conjugate_gradients(self._multiply, self.precondition, b, rtol, MAX_ITERATIONS, x0, space=self._space)

    @latest_only
    def precondition(self, r: Vector) -> Vector:
        """Return the product (n,) of the inverse diagonal blocks and `r`."""
        self._padded[self._analysis.unknown_indices] = r
        run(multiply_diagonal, self._parts, self._inverse, self._padded, self._out)
        return self._out[self._analysis.unknown_indices]

    def _multiply(self, v: Vector) -> Vector:
        return np.asarray(self._K.matvec(v), dtype=np.float64)


class AssembledAnalysis(CheckedAnalysis):
    """Edges of the graph of K, and arrays for the values."""

    def __init__(self, solver: LinearSolver, unknowns: Unknowns, omega: float) -> None:
        super().__init__(solver, unknowns)
        self._rows = VertexRows(unknowns)
        self._above = BlockStructure.of(triu(self._rows.graph, 1, format="csr"))
        edges = np.stack([self._above.block_rows(), self._above.columns], axis=1)
        self._blocks = self._above.empty_values()
        self._search = EdgeCg(edges, self._rows.vertices, self._rows.unknown_indices, assembled=True, omega=omega)

    @locked
    def factorise(self, K: Any, kind: Kind) -> EdgeFactors:
        """Copy the values, and invert the diagonal blocks."""
        values, rows, search = self.begin_with(K, kind), self._rows, self._search
        unknowns = rows.first, rows.row, rows.component, K.indptr, K.indices, values
        fill_edges(self._above.rows, self._above.columns, *unknowns, self._blocks, search.diagonal)
        search.fill(self._blocks)
        return EdgeFactors(self, search)


@dataclass(frozen=True)
class SsorCg(BlockJacobiCg):
    """Conjugate gradients with SSOR: a third of the iterations of `BlockJacobiCg`, each of which takes 1.5 times as long.

    A backward and a forward sweep over the vertices replace the product.

    The sweeps are part of the compiled loop. They require the blocks of the edges of one term, which are copied, or with
    `assembled` those of a matrix. A body with several terms that is not assembled is solved with diagonal blocks, as by
    `BlockJacobiCg`.

    >>> import numpy as np
    >>> from scipy.sparse import diags
    >>> from skfem_stvk.linear import Kind, Unknowns
    >>> K = diags([-1.0, 2.5, -1.0], [-1, 0, 1], shape=(60, 60), format="csr")
    >>> unknowns = Unknowns(np.arange(60), np.zeros(60, dtype=int), K.indptr, K.indices)
    >>> b = np.cos(np.arange(60.0))
    >>> solvers = SsorCg(assembled=True), BlockJacobiCg(assembled=True)
    >>> one, other = (solver.analyse(unknowns).factorise(K, Kind.POSITIVE_DEFINITE).solve(b, rtol=1e-8) for solver in solvers)
    >>> one.outcome.value, one.iterations < other.iterations / 2, bool(abs(one.x - other.x).max() < 1e-6)
    ('solved', True, True)
    """

    name: ClassVar[str] = "ssor-cg"
    on_parts: ClassVar[bool] = False
    #: Relaxation factor. Compared with 1, it saves a sixth to an eighth of the iterations in time steps, and a quarter in statics.
    #: Beyond 1.6 the iterations increase.
    omega: ClassVar[float] = 1.4
