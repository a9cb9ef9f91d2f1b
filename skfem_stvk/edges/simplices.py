"""W, F and K of energies that are a sum over simplices: what they have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..kernels import blocks as block_kernels
from ..kernels.threads import in_turn, parts_of, run
from .rows import Places, Rows, rows_of
from .sharing import Shares
from .tensions import ALL, Tensions
from .volumes import Volumes

AXES = {1: (0,), 2: (0, 1), 3: (0, 1, 2)}


class Linearized(NamedTuple):
    """What a tangent comes with.

    Attributes
    ----------
    energy : strain energy [J].
    total : a sum that is not finite if any value of K is not.
    """

    energy: float
    total: float


class SimplexTerm(Volumes, ABC):
    """The calls of the kernels. Its arrays are in use during a call: Python threads take turns."""

    @in_turn
    def energy(self, u: Array, force: Array | None = None) -> float:
        """Strain energy [J] at displacements `u` (nv, d) [m]; adds the internal force `dW/du` [N] to `force` (nv, d)."""
        shares = self._forces
        f = self._slots("F", shares) if force is not None else np.empty(0, dtype=self.dtype)
        block_kernels.gather(u, self.vertices, self._u)
        W = self._energy(shares, f)
        if force is not None:
            self._add(f, shares, force)
        return W

    @abstractmethod
    def _energy(self, shares: Shares, f: Array) -> float:
        """The energy at the displacements that were gathered last; adds the forces to the slots `f`, unless that is empty."""

    @in_turn
    def edge_blocks(
        self, u: Array, force: Array | None = None, out: Array | None = None, kept: Tensions = ALL
    ) -> tuple[float, Array]:
        """The energy [J] and the blocks `K_ab` (9 ne,) of the edges at `u` (nv, d), with room for what threads add to them.

        Adds the internal force to `force` (nv, d). `out` are blocks that this method returned before, to be filled anew.

        `kept`: which tensions of edges stay in K.
        """
        shares, to = self._forces, self._blocks
        size = 9 * (self._own.total + len(to.extra))
        blocks = np.empty(size, dtype=self.dtype) if out is None or len(out) != size else out
        f = self._slots("F", shares) if force is not None else np.empty(0, dtype=self.dtype)
        block_kernels.gather(u, self.vertices, self._u)
        blocks[9 * self._own.total :] = 0
        W = self._linearize(shares, to.slots.reshape(len(self._t), -1), f, blocks, kept)
        block_kernels.fold(blocks, self._own.total, to.extra, 9)
        if force is not None:
            self._add(f, shares, force)
        return W, blocks

    @abstractmethod
    def _linearize(self, shares: Shares, edge_slots: NDArray[Any], f: Array, blocks: Array, kept: Tensions) -> float:
        """As `_energy`; writes the blocks of the edges to their slots in `blocks`."""

    def rows(self, pattern: Places) -> Rows:
        """Where the blocks stand in the values of a matrix of this pattern."""
        return rows_of(self._own, self.vertices, pattern)

    @in_turn
    def tangent(self, u: Array, rows: Rows, data: Array, add: bool, force: Array | None = None, kept: Tensions = ALL) -> Linearized:
        """Write the tangent stiffness [N/m] to the CSR values `data`, or add it to them; adds the force to `force` (nv, d).

        `kept`: as of `edge_blocks`.
        """
        W, blocks = self.edge_blocks(u, force, self._kept.get("blocks"), kept)
        self._kept["blocks"] = blocks
        parts = parts_of(len(self.vertices), 1, self._threads)
        totals = run(block_kernels.fill_rows, parts, *rows, blocks, AXES[u.shape[1]], add, data)
        return Linearized(W, sum(totals))

    @in_turn
    def add_product(self, blocks: Array, v: Array, out: Array) -> None:
        """Add `K v` to `out` (nv, d), for the `blocks` of the edges and `v` (nv, d)."""
        shares = self._products
        x, y = self._gathered("factor", v, self.dtype), self._slots("K v", shares)
        run(block_kernels.multiply, shares.parts, self._own.edges, shares.slots.reshape(-1, 2), blocks, x, y)
        self._add(y, shares, out)

    @property
    def own_edges(self) -> NDArray[np.int32]:
        """(ne, 2) edges in the order of their blocks, of numbers of `vertices`."""
        return self._own.edges

    def add_diagonal(self, blocks: Array, out: Array) -> None:
        """Add the diagonal blocks `K_aa` to `out` (nv, d, d), for the `blocks` of the edges."""
        block_kernels.add_diagonal(self._own.edges, self.vertices, blocks, out)

    def add_norms(self, blocks: Array, x: Array, out: Array) -> None:
        """Add `sum_b |K_ab| x_b` over the other vertices `b` to `out` (nv,), for `x` (nv,); Frobenius norms of the `blocks` of the edges."""
        block_kernels.add_norms(self._own.edges, self.vertices, blocks, self.d, x, out)

    @in_turn
    def add_round_off(self, u: Array, out: Array) -> None:
        """Add the absolute values of all that adds up to the force at `u` (nv, d) to `out` (nv, d) [N].

        Times eps it is the size of the force's rounding error, of which that of `u` itself is a part.
        """
        shares = self._forces
        f = self._slots("F", shares)
        block_kernels.gather(u, self.vertices, self._u)
        self._round_off(shares, f)
        self._add(f, shares, out)

    @abstractmethod
    def _round_off(self, shares: Shares, f: Array) -> None:
        """Add the sizes of the forces at the displacements that were gathered last to the slots `f`."""
