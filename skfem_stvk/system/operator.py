"""The tangent stiffness as an operator: its product with a vector, without forming it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray
from scipy.sparse.linalg import LinearOperator

from ..errors import StateError
from ..terms import BoundTerm

Array = NDArray[np.floating[Any]]


class TangentOperator(LinearOperator):
    """`v -> K(u) v` for scipy's iterative solvers, prepared once at `u` and applied often.

    Prepared are the blocks of the edges, 1.2 x 9 numbers a tetrahedron; their transposes, the diagonal and the pattern are never made:
    `(K v)_a = sum_b K_ab (v_b - v_a)`. `System.linear_operator` makes it.
    """

    def __init__(self, terms: Sequence[BoundTerm], state: Callable[[ArrayLike], Array], u: ArrayLike, dtype: DTypeLike) -> None:
        self._terms, self._state = terms, state
        self._blocks: list[Any] = [None] * len(terms)
        self.prepare(u)
        super().__init__(dtype, (self._u.size, self._u.size))

    def prepare(self, u: ArrayLike) -> None:
        """Fill the blocks anew, at other displacements `u` (ndofs,) [m].

        Raises
        ------
        StateError
            if `u` does not have one finite entry for each degree of freedom, or is so large that K overflows.
        """
        x = self._state(u)
        self._u = np.empty(0)  # nowhere, until all of it is done
        self._blocks = [term.edge_blocks(x, out=out)[1] for term, out in zip(self._terms, self._blocks, strict=True)]
        if not all(np.isfinite(blocks).all() for blocks in self._blocks):
            raise StateError(
                f"K overflows at displacements of up to {np.abs(x).max():.1e}: did the step before diverge, or are units mixed up?"
            )
        self._u = x.copy()

    def is_at(self, u: Array) -> bool:
        """Whether it is prepared at these displacements (nv, d)."""
        return np.array_equal(self._u, u)

    def memory(self) -> int:
        """Bytes of what is prepared."""
        return self._u.nbytes + sum(blocks.nbytes for blocks in self._blocks)

    def _matvec(self, v: Array) -> Array:
        if not self._u.size:
            raise StateError("The operator is not prepared: its last prepare(u) did not end well. Prepare it at another u.")
        if np.iscomplexobj(v):
            return np.asarray(self._matvec(v.real) + 1j * self._matvec(v.imag))
        x = np.ascontiguousarray(v, dtype=np.float32 if v.dtype == np.float32 else np.float64).reshape(self._u.shape)
        out = np.zeros(x.shape, dtype=self.dtype)
        for term, blocks in zip(self._terms, self._blocks, strict=True):
            term.add_product(blocks, x, out)
        return out.ravel()

    def _adjoint(self) -> TangentOperator:
        return self
