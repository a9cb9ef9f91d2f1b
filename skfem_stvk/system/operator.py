"""The tangent stiffness as an operator: its product with a vector, without forming it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray
from scipy.sparse.linalg import LinearOperator

from ..errors import StateError
from ..terms import BoundTerm

Array = NDArray[np.floating[Any]]


class TangentOperator(LinearOperator):
    """`v -> K(u) v` for scipy's iterative solvers, prepared once at `u` and applied often.

    Prepared are the blocks of the edges, 1.2 x 9 numbers a tetrahedron; their transposes, the diagonal and the pattern are never made:
    `(K v)_a = sum_b K_ab (v_b - v_a)`. `System.linear_operator` makes it.
    """

    def __init__(self, terms: Sequence[BoundTerm], u: Array, dtype: DTypeLike) -> None:
        super().__init__(dtype, (u.size, u.size))
        self._terms, self._width = terms, u.shape[1]
        self._blocks: list[Any] = [None] * len(terms)
        self.prepare(u)

    def prepare(self, u: Array) -> None:
        """Fill the blocks anew, at other displacements `u` (nv, d) [m]."""
        self._u = u.copy()
        self._blocks = [term.edge_blocks(u, out=out)[1] for term, out in zip(self._terms, self._blocks, strict=True)]
        if not all(np.isfinite(blocks).all() for blocks in self._blocks):
            raise StateError(
                f"K overflows at displacements of up to {np.abs(u).max():.1e}: did the step before diverge, or are units mixed up?"
            )

    def is_at(self, u: Array) -> bool:
        """Whether it is prepared at these displacements (nv, d)."""
        return np.array_equal(self._u, u)

    def memory(self) -> int:
        """Bytes of what is prepared."""
        return self._u.nbytes + sum(blocks.nbytes for blocks in self._blocks)

    def _matvec(self, v: Array) -> Array:
        x = np.asarray(v).reshape(-1, self._width)
        out = np.zeros(x.shape, dtype=self.dtype)
        for term, blocks in zip(self._terms, self._blocks, strict=True):
            term.add_product(blocks, x, out)
        return out.ravel()

    def _adjoint(self) -> TangentOperator:
        return self
