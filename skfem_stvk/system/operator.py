"""The tangent stiffness as an operator: its product with a vector, without forming it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray
from scipy.sparse.linalg import LinearOperator

from ..errors import StateError
from ..terms import BoundTerm
from .free import FreeDofs

Array = NDArray[np.floating[Any]]


class TangentOperator(LinearOperator):
    """`v -> K(u) v` for scipy's iterative solvers, prepared once at `u` and applied often.

    Prepared are the blocks of the edges, 1.2 x 9 numbers a tetrahedron; their transposes, the diagonal and the pattern are never made:
    `(K v)_a = sum_b K_ab (v_b - v_a)`. `System.linear_operator` makes it.

    Attributes
    ----------
    nodal_shape : (nv, d), the shape that vectors have within.
    """

    def __init__(
        self, terms: Sequence[BoundTerm], state: Callable[[ArrayLike], Array], u: ArrayLike, dtype: DTypeLike, clamped: bool = False
    ) -> None:
        self._terms, self._state = terms, state
        self._blocks: list[Any] = [None] * len(terms)
        self.prepare(u, clamped=clamped)
        self.nodal_shape = self._u.shape
        super().__init__(dtype, (self._u.size, self._u.size))

    def prepare(self, u: ArrayLike, *, clamped: bool = False) -> None:
        """Fill the blocks anew, at other displacements `u` (ndofs,) [m].

        `clamped`: without the negative tensions of edges, positive semi-definite.

        Raises
        ------
        StateError
            if `u` does not have one finite entry for each degree of freedom, or is so large that K overflows.
        """
        x = self._state(u)
        self._u: Array = np.empty(0)  # nowhere, until all of it is done
        self._blocks = [
            term.edge_blocks(x, out=out, clamped=clamped)[1] for term, out in zip(self._terms, self._blocks, strict=True)
        ]
        if not all(np.isfinite(blocks).all() for blocks in self._blocks):
            raise StateError(
                f"K overflows at displacements of up to {np.abs(x).max():.1e}: did the step before diverge, or are units mixed up?"
            )
        self._u, self._clamped = x.copy(), clamped

    def is_at(self, u: Array) -> bool:
        """Whether it is the tangent, with all tensions, at these displacements (nv, d)."""
        return not self._clamped and np.array_equal(self._u, u)

    def diagonal_blocks(self) -> Array:
        """(nv, d, d) the blocks `K_aa` [N/m], for a preconditioner.

        Raises
        ------
        StateError
            if the last `prepare` did not end well.
        """
        self._refuse_unprepared()
        nv, d = self.nodal_shape
        out = np.zeros((nv, d, d), dtype=self.dtype)
        for term, blocks in zip(self._terms, self._blocks, strict=True):
            term.add_diagonal(blocks, out)
        return out

    def add_product(self, x: Array, out: Array) -> None:
        """Add `K x` to `out`, both (nv, d).

        Raises
        ------
        StateError
            if the last `prepare` did not end well.
        """
        self._refuse_unprepared()
        for term, blocks in zip(self._terms, self._blocks, strict=True):
            term.add_product(blocks, x, out)

    def memory(self) -> int:
        """Bytes of what is prepared."""
        return self._u.nbytes + sum(blocks.nbytes for blocks in self._blocks)

    def _matvec(self, v: Array) -> Array:
        if np.iscomplexobj(v):
            return np.asarray(self._matvec(v.real) + 1j * self._matvec(v.imag))
        x = np.ascontiguousarray(v, dtype=np.float32 if v.dtype == np.float32 else np.float64).reshape(self.nodal_shape)
        out = np.zeros(x.shape, dtype=self.dtype)
        self.add_product(x, out)
        return out.ravel()

    def _adjoint(self) -> TangentOperator:
        return self

    def _refuse_unprepared(self) -> None:
        if not self._u.size:
            raise StateError("The operator is not prepared: its last prepare(u) did not end well. Prepare it at another u.")


class FreeOperator(LinearOperator):
    """The tangent restricted to the degrees of freedom that are free, for solvers that need no matrix.

    It is always that of `tangent`: when that is prepared anew, so is this. The vectors that it works in are made once: it is for one Python
    thread at a time.

    Parameters
    ----------
    tangent : the operator of all degrees of freedom.
    held : which of them are free.
    shift : (n,) stiffness against the ground that is added to the free ones [N/m]; none by default.

    >>> import numpy as np, skfem
    >>> from skfem_stvk import StVK, System
    >>> mesh = skfem.MeshTet().refined(2)
    >>> body, u = System(mesh, StVK(young=1e5, poisson=0.3)), 0.01 * mesh.p.ravel("F")
    >>> held = body.free_dofs(np.arange(30))
    >>> Kff = FreeOperator(body.linear_operator(u), held)
    >>> v = np.cos(np.arange(len(held.free)))
    >>> bool(abs(Kff @ v - held.matrix(body.tangent(u)) @ v).max() < 1e-9)
    True
    """

    def __init__(self, tangent: TangentOperator, held: FreeDofs, shift: Array | None = None) -> None:
        self.tangent, self.held, self._shift = tangent, held, shift
        self._all, self._out = (np.zeros(tangent.nodal_shape, dtype=tangent.dtype) for _ in range(2))
        super().__init__(tangent.dtype, (len(held.free), len(held.free)))

    def diagonal_blocks(self) -> Array:
        """(nv, d, d) the blocks `K_aa` [N/m], with rows and columns of the identity for degrees of freedom that are held.

        Raises
        ------
        StateError
            if the last `prepare` of the tangent did not end well.
        """
        blocks = self.tangent.diagonal_blocks()
        vertex, component = np.divmod(self.held.fixed, blocks.shape[1])
        blocks[vertex, component, :] = blocks[vertex, :, component] = 0
        blocks[vertex, component, component] = 1
        if self._shift is not None:
            vertex, component = np.divmod(self.held.free, blocks.shape[1])
            blocks[vertex, component, component] += self._shift
        return blocks

    def _matvec(self, v: Array) -> Array:
        if np.iscomplexobj(v):
            return np.asarray(self._matvec(v.real) + 1j * self._matvec(v.imag))
        self._all.reshape(-1)[self.held.free] = v.ravel()
        self._out[:] = 0
        self.tangent.add_product(self._all, self._out)
        product: Array = self._out.reshape(-1)[self.held.free]
        return product if self._shift is None else product + self._shift * v.ravel()

    def _adjoint(self) -> FreeOperator:
        return self
