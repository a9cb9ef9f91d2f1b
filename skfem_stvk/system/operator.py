"""Tangent stiffness as an operator: its product with a vector, without an assembled matrix."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike
from scipy.sparse.linalg import LinearOperator

from ..arguments import Array
from ..edges import ALL, Tensions
from ..edges.pairs import PairTerm
from ..errors import StateError, StvkError
from ..kernels import node_blocks as block_kernels
from ..kernels.threads import CopyableLock, locked, parts_of, run, threads
from ..linear import EdgeBlocks
from ..linear.solver import NO_BLOCKS, NO_ROWS
from ..mesh import ElementMesh
from ..mesh.displacements import all_finite, by_vertex
from ..terms.loads.load import Time
from .pattern import FreeDofs


class TangentOperator(LinearOperator):
    """Operator `v -> K(u) v` for scipy's iterative solvers, prepared once at `u` and applied often.

    The prepared data are the blocks of the edges, 1.2 x 9 numbers per tetrahedron. Their transposes, the diagonal and the pattern
    are never formed: `(K v)_a = sum_b K_ab (v_b - v_a)`. `System.linear_operator` returns such an operator.

    Attributes
    ----------
    nodal_shape
        Internal shape of vectors, (nv, d).
    """

    def __init__(
        self,
        mesh: ElementMesh,
        terms_at: Callable[[Time], Sequence[PairTerm]],
        u: ArrayLike,
        dtype: DTypeLike,
        kept: Tensions = ALL,
        t: Time = 0.0,
    ) -> None:
        self._mesh, self._terms_at, self.space = mesh, terms_at, mesh.space
        count = len(terms_at(t))
        self._blocks: list[Any] = [None] * count
        self._pairs: list[Any] = [None] * count  # those of the blocks: a term may couple other pairs later
        self._at: Tensions | None = None
        self._u = np.empty((mesh.p.shape[1], mesh.d))
        self.nodal_shape = self._u.shape
        self.prepare(u, kept=kept, t=t)
        super().__init__(dtype, (self._u.size, self._u.size))

    def prepare(self, u: ArrayLike, *, kept: Tensions = ALL, force: Array | None = None, t: Time = 0.0) -> float:
        """Recompute the blocks at other displacements `u` (ndofs,) [m] and `t`, and return the strain energy `W(u)` [J].

        `kept` are the tensions of edges that enter K. The internal force `F(u)` [N] is added to `force` (nv, d), if given, in the
        same pass.

        Raises
        ------
        StateError
            if `u` does not have one finite entry for each degree of freedom, or is so large that K overflows.
        """
        energy = self.space.comm.sum_of(self._compute_blocks, u, t, kept, force)
        self._at, self._ready = kept, True
        if force is not None:
            self.space.share(force)
        return energy

    def _compute_blocks(self, u: ArrayLike, t: Time, kept: Tensions, force: Array | None) -> float:
        """Compute the blocks of one part of a divided body, and return its energy; `prepare` has the arguments."""
        x, energy = by_vertex(self._mesh, u), 0.0
        self._ready = False  # until all blocks are computed
        for i, term in enumerate(self._terms_at(t)):
            factor, own = kept.of(term)
            part, self._blocks[i] = term.blocks(x, force, self._blocks[i], own)
            if factor != 1:
                self._blocks[i] *= factor
            self._pairs[i] = term.pairs
            energy += part
            refuse_overflow(self._blocks[i], "K", x)
            if i:
                term.pairs.move_to(self._pairs[0], self._blocks[i], self._blocks[0])
        np.copyto(self._u, x)
        return energy

    def scale_and_add(self, factor: float, others: Sequence[tuple[float, TangentOperator]] = ()) -> None:
        """Replace K by `factor K + sum of c K_other`, for pairs `(c, other)` of operators of the same system.

        With a constant operator at rest, the result is the tangent of a body with Rayleigh damping. The next `prepare` replaces it.

        Raises
        ------
        StvkError
            if another operator belongs to other terms.
        StateError
            if the last `prepare` of one of them failed.
        """
        for operator in (self, *(other for _, other in others)):
            operator._refuse_unprepared()
            if operator._terms_at != self._terms_at:
                raise StvkError("Got an operator of other terms; expected those of linear_operator() of one and the same system.")
        self._at = None  # a sum is not the tangent at any state
        for i, blocks in enumerate(self._blocks):
            blocks *= factor
            for c, other in others:
                if other._pairs[i] is not self._pairs[i]:
                    if other._blocks[i].any():
                        raise StvkError(
                            "Got an operator whose terms couple other nodes; expected one prepared after the last change."
                        )
                    continue
                n = min(len(blocks), len(other._blocks[i]))  # entries after the edges depend on the thread count
                run(block_kernels.add_scaled, parts_of(n, 0.02, threads()), c, other._blocks[i], blocks)

    def is_at(self, u: Array) -> bool:
        """Return whether the operator is the tangent, with all tensions, at displacements `u` (nv, d)."""
        return self._at == ALL and np.array_equal(self._u, u)

    def diagonal_blocks(self) -> Array:
        """Return the blocks `K_aa` (nv, d, d) [N/m], for a preconditioner.

        Raises
        ------
        StateError
            if the last `prepare` failed.
        """
        self._refuse_unprepared()
        nv, d = self.nodal_shape
        out = np.zeros((nv, d, d), dtype=self.dtype)
        for pairs, blocks in zip(self._pairs, self._blocks, strict=True):
            pairs.add_diagonal(blocks, out)
        return self.space.share(out)

    def add_norms(self, x: Array, out: Array) -> None:
        """Add `sum_b |K_ab| x_b` over the other vertices `b` to `out`; `x` and `out` are (nv,).

        Errors as in `diagonal_blocks`.
        """
        self._refuse_unprepared()
        for pairs, blocks in zip(self._pairs, self._blocks, strict=True):
            pairs.add_norms(blocks, x, out)

    def add_product(self, x: Array, out: Array) -> None:
        """Add `K x` to `out`; `x` and `out` are (nv, d). Errors as in `diagonal_blocks`."""
        self._refuse_unprepared()
        for pairs, blocks in zip(self._pairs, self._blocks, strict=True):
            pairs.add_product(blocks, x, out)

    def by_edges(self, shift: Array | None = None) -> EdgeBlocks | None:
        """Return the blocks without a copy, for solvers with products of their own.

        Return None unless the operator consists of one term on elements, and of terms that couple no other vertices, and for a
        divided body.

        Errors as in `diagonal_blocks`.
        """
        self._refuse_unprepared()
        pairs = self._pairs[0]
        edges, vertices = pairs.edges, pairs.own.vertices
        grounding = None if self.space.comm.divided else self._blocks_of_vertices(vertices)
        if edges is None or grounding is None:
            return None
        return EdgeBlocks(edges, self._blocks[0][: pairs.size], vertices, shift, *grounding)

    def _blocks_of_vertices(self, vertices: Array) -> tuple[Array, Array] | None:
        """Return the rows and the blocks (9 m,) of the terms after the first one; None if they couple different vertices."""
        if len(self._pairs) == 1:
            return NO_ROWS, NO_BLOCKS
        d, rows, every = self._mesh.d, [NO_ROWS], [NO_BLOCKS]
        row_of = np.full(len(self._u), -1)
        row_of[vertices] = np.arange(len(vertices))
        for pairs, blocks in zip(self._pairs[1:], self._blocks[1:], strict=True):
            found = pairs.of_vertices(blocks)
            if found is None or (row_of[found[0]] < 0).any():
                return None
            row = row_of[found[0]]
            touching = found[1].any(axis=(1, 2))
            nine = np.zeros((np.count_nonzero(touching), 3, 3))
            nine[:, :d, :d] = found[1][touching]
            rows.append(row[touching])
            every.append(nine.ravel())
        return np.concatenate(rows), np.concatenate(every)

    def memory(self) -> int:
        """Return the bytes of the prepared data."""
        return self._u.nbytes + sum(blocks.nbytes for blocks in self._blocks)

    def _matvec(self, v: Array) -> Array:
        if np.iscomplexobj(v):
            return np.asarray(self._matvec(v.real) + 1j * self._matvec(v.imag))
        x = np.ascontiguousarray(v, dtype=np.float32 if v.dtype == np.float32 else np.float64).reshape(self.nodal_shape)
        out = np.zeros(x.shape, dtype=self.dtype)
        self.add_product(x, out)
        return self.space.share(out).ravel()

    def _adjoint(self) -> TangentOperator:
        return self

    def _refuse_unprepared(self) -> None:
        if not self._ready:
            raise StateError("The operator is not prepared: its last prepare(u) did not end well. Prepare it at another u.")


def at_all_times(terms: Sequence[PairTerm]) -> Callable[[Time], Sequence[PairTerm]]:
    """Return the function for a `TangentOperator` of terms that do not change with time."""
    return lambda t: terms


class FreeOperator(LinearOperator):
    """Tangent restricted to the free degrees of freedom, for solvers that need no matrix.

    The operator always follows `tangent`: after `tangent.prepare(u)` it belongs to the new `u`. A lock admits one Python thread at
    a time, since the work vectors are shared.

    Parameters
    ----------
    tangent
        Operator of all degrees of freedom.
    dofs
        The free and the constrained degrees of freedom.
    shift
        (n,) stiffness against the ground that is added at the free degrees of freedom [N/m]; none by default. It is not copied, so
        a later change in place takes effect from the next product on.

    Examples
    --------
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

    def __init__(self, tangent: TangentOperator, dofs: FreeDofs, shift: Array | None = None) -> None:
        self.tangent, self.dofs, self.shift, self.space = tangent, dofs, shift, tangent.space.on(dofs.free)
        self._all, self._out = (np.zeros(tangent.nodal_shape, dtype=tangent.dtype) for _ in range(2))
        self._lock = CopyableLock()
        super().__init__(tangent.dtype, (len(dofs.free), len(dofs.free)))

    def diagonal_blocks(self) -> Array:
        """Return the blocks `K_aa` (nv, d, d) [N/m], with rows and columns of the identity for constrained degrees of freedom.

        Errors as in `TangentOperator.diagonal_blocks`.
        """
        blocks = self.tangent.diagonal_blocks()
        vertex, component = np.divmod(self.dofs.fixed, blocks.shape[1])
        blocks[vertex, component, :] = blocks[vertex, :, component] = 0
        blocks[vertex, component, component] = 1
        if self.shift is not None:
            vertex, component = np.divmod(self.dofs.free, blocks.shape[1])
            blocks[vertex, component, component] += self.shift
        return blocks

    def by_edges(self) -> EdgeBlocks | None:
        """Return the blocks as in `TangentOperator.by_edges`, with the shift."""
        return self.tangent.by_edges(self.shift)

    @locked
    def _matvec(self, v: Array) -> Array:
        if np.iscomplexobj(v):
            return np.asarray(self._matvec(v.real) + 1j * self._matvec(v.imag))
        self._all.reshape(-1)[self.dofs.free] = v.ravel()
        self._out[:] = 0
        self.tangent.add_product(self._all, self._out)
        self.tangent.space.share(self._out)
        product: Array = self._out.reshape(-1)[self.dofs.free]
        return product if self.shift is None else product + self.shift * v.ravel()

    def _adjoint(self) -> FreeOperator:
        return self


def refuse_overflow(values: ArrayLike, name: str, u: Array) -> None:
    """Raise StateError if results, called `name`, are not finite at displacements `u`."""
    if not (isfinite(values) if isinstance(values, float | int) else all_finite(np.asarray(values))):
        raise StateError(
            f"{name} overflows at displacements of up to {np.abs(u).max():.1e}: did the previous step diverge, or are units mixed "
            "up?"
        )
