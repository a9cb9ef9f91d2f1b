"""Conjugate gradients without a matrix, with the diagonal blocks of the vertices as preconditioner."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ..errors import StateError, StvkError, name_ids
from ..kernels import sparse as kernels
from ..kernels.threads import parts_of, run, threads
from .cg import conjugate_gradients
from .checks import Newest, check_kind, checked_vector
from .solver import Kind, Operator, Solution, Unknowns, Vector

#: Iterations at most: on slender bodies they grow with the number of elements along them, and more.
MOST = 50_000


@dataclass(frozen=True)
class BlockJacobiCg:
    """The least memory: neither K nor its pattern is ever formed. Iterations grow with refinement.

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

    name: ClassVar[str] = "block-jacobi-cg"
    takes: ClassVar[Kind] = Kind.SYMMETRIC
    matrix_free: ClassVar[bool] = True
    iterative: ClassVar[bool] = True

    def analyse(self, unknowns: Unknowns) -> BlockJacobiAnalysis:
        """Which components of which vertices are unknown."""
        return BlockJacobiAnalysis(self, unknowns)


class BlockJacobiAnalysis:
    """Places of the unknowns in the diagonal blocks."""

    def __init__(self, solver: BlockJacobiCg, unknowns: Unknowns) -> None:
        self._solver, self.n, self._newest = solver, unknowns.n, Newest()
        self._vertices, row = np.unique(unknowns.vertex, return_inverse=True)
        self._row, self._component = row.ravel(), unknowns.component
        self.places = 3 * self._row + self._component

    def factorise(self, K: Operator, kind: Kind) -> BlockJacobiFactors:
        """The inverses of the diagonal blocks. K itself is not copied: it must stay as it is while the factors are used."""
        check_kind(self._solver, kind)
        if not hasattr(K, "matvec") or not hasattr(K, "diagonal_blocks"):
            raise StvkError(
                f"K is a {type(K).__name__}; '{self._solver.name}' expects an operator with matvec(v) and diagonal_blocks()."
            )
        inverse = self._inverted(np.asarray(K.diagonal_blocks()))
        return BlockJacobiFactors(self, K, inverse, self._newest)

    def _inverted(self, diagonal: Vector) -> Vector:
        """(9 rows,) inverses of the blocks of the vertices that have unknowns; held components are left out."""
        d, count = diagonal.shape[-1], len(self._vertices)
        is_free = np.zeros((count, 3), dtype=bool)
        is_free[self._row, self._component] = True
        blocks = np.zeros((count, 3, 3))
        blocks[:, :d, :d] = diagonal[self._vertices]
        blocks[~(is_free[:, :, None] & is_free[:, None, :])] = 0
        bad = self._vertices[~np.isfinite(blocks).all(axis=(1, 2))]
        if len(bad):
            raise StateError(f"The diagonal of K is not finite at {name_ids(bad, 'vertex')}: did the step before diverge?")
        inverse, parts = np.empty(9 * count), parts_of(count, 1, threads())
        run(kernels.invert_diagonal, parts, np.arange(count), blocks.ravel(), np.zeros(count), inverse)
        return inverse


class BlockJacobiFactors:
    """The operator, and the inverses of its diagonal blocks."""

    negative_pivots: ClassVar[None] = None

    def __init__(self, analysis: BlockJacobiAnalysis, K: Operator, inverse: Vector, newest: Newest) -> None:
        self._analysis, self._K, self._inverse = analysis, K, inverse
        self._newest, self._number = newest, newest.next()
        self._padded, self._out = np.zeros(len(inverse) // 3), np.empty(len(inverse) // 3)
        self._parts: NDArray[np.int64] = parts_of(len(inverse) // 9, 1, threads())

    def solve(self, b: Vector, rtol: float = 1e-10) -> Solution:
        """Conjugate gradients, each iteration with a product."""
        self._newest.check(self._number)
        b = checked_vector(b, self._analysis.n)
        return conjugate_gradients(self._multiply, self._precondition, b, rtol, MOST)

    def _multiply(self, v: Vector) -> Vector:
        return np.asarray(self._K.matvec(v), dtype=np.float64)

    def _precondition(self, r: Vector) -> Vector:
        self._padded[self._analysis.places] = r
        run(kernels.multiply_diagonal, self._parts, self._inverse, self._padded, self._out)
        return self._out[self._analysis.places]
