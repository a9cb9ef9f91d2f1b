"""W, F and K of an edge form, and what solvers ask of them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..kernels import blocks as block_kernels
from ..kernels import simplices as simplex_kernels
from ..kernels import volumes as volume_kernels
from ..kernels.simplices import LANES
from ..kernels.threads import in_turn, parts_of, run
from .arrays import OwnArrays
from .rows import Places, Rows, rows_of

Array = NDArray[np.floating[Any]]

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


class Assembly(OwnArrays):
    """The calls of the kernels. Its arrays are in use during a call: Python threads take turns."""

    @in_turn
    def energy(self, u: Array, force: Array | None = None) -> float:
        """Strain energy [J] at displacements `u` (nv, d) [m]; adds the internal force `dW/du` [N] to `force` (nv, d)."""
        shares = self._forces
        f = self._slots("F", shares) if force is not None else np.empty(0, dtype=self.dtype)
        block_kernels.gather(u, self.vertices, self._u)
        W = run(simplex_kernels.energy_and_force, shares.parts, self._t.ravel(), shares.slots, self._D, self._X, self._u, f)
        if force is not None:
            self._add(f, shares, force)
        return sum(W)

    @in_turn
    def along(self, u: Array, v: Array) -> NDArray[np.float64]:
        """(5,) coefficients `c` [J] of the energy along `u + s v`, both (nv, d): exactly `c_0 + c_1 s + ... + c_4 s^4`, at any `s`."""
        block_kernels.gather(u, self.vertices, self._u)
        V = self._gathered("direction", v, np.float64)
        coefficients = run(simplex_kernels.along, self._forces.parts, self._t.ravel(), self._D, self._X, self._u, V)
        total: NDArray[np.float64] = np.sum(coefficients, axis=0)
        return total

    @in_turn
    def add_round_off(self, u: Array, out: Array) -> None:
        """Add the absolute values of all that adds up to the force at `u` (nv, d) to `out` (nv, d) [N].

        Times eps it is the size of the force's rounding error, of which that of `u` itself is a part.
        """
        shares = self._forces
        f = self._slots("F", shares)
        block_kernels.gather(u, self.vertices, self._u)
        run(simplex_kernels.round_off, shares.parts, self._t.ravel(), shares.slots, self._D, self._X, self._u, f)
        self._add(f, shares, out)

    @in_turn
    def tensions(self, u: Array) -> Array:
        """(ne,) tensions `t = L zeta` [N/m] at `u` (nv, d) of the edges in lexicographic order: `form.tensions` without L."""
        block_kernels.gather(u, self.vertices, self._u)
        tensions: Array = self._tensions()[self._lexicographic]
        return tensions

    def _tensions(self) -> Array:
        """Of the edges in their own order, at the displacements that were gathered last."""
        to, total = self._blocks, self._own.total
        t = self._room("t", total + len(to.extra), self.dtype)
        t[total:] = 0
        edge_slots = to.slots.reshape(len(self._t), -1)
        simplices = self._t.ravel(), edge_slots, self._own.marks, self._D, self._X, self._u
        run(simplex_kernels.tensions, self._forces.parts, *simplices, t)
        block_kernels.fold(t, total, to.extra, 1)
        return t[:total]

    def volume_ratios(self, u: Array) -> NDArray[np.float64]:
        """(nt,) volumes at `u` (nv, d) over those at rest, of the form's simplices in their order; below zero where one is inside out.

        Of triangles in space, and of segments in more than one dimension, the ratios of areas and lengths, which have no sign.
        """
        ratios, own = np.empty(len(self._elements)), np.empty(len(self._t) * LANES)
        self._smallest_volume_ratio(u, own)
        ratios[self._elements] = own[: len(ratios)]
        return ratios

    def smallest_volume_ratio(self, u: Array) -> float:
        """The smallest of `volume_ratios(u)`, for half the price of F."""
        return self._smallest_volume_ratio(u, np.empty(0))

    @in_turn
    def _smallest_volume_ratio(self, u: Array, out: Array) -> float:
        block_kernels.gather(u, self.vertices, self._u)
        k, d = len(self.form.t) - 1, len(self.form.p)
        return min(run(volume_kernels.volume_ratios, self._forces.parts, self._t.ravel(), self._X, self._u, k, d, out))

    @in_turn
    def edge_blocks(
        self, u: Array, force: Array | None = None, out: Array | None = None, clamped: bool = False
    ) -> tuple[float, Array]:
        """The energy [J] and the blocks `K_ab` (9 ne,) of the edges at `u` (nv, d), with room for what threads add to them.

        Adds the internal force to `force` (nv, d). `out` are blocks that this method returned before, to be filled anew.

        `clamped`: with `max(t, 0)` in the place of the tensions `t` of the edges, so that K is positive semi-definite.
        """
        shares, to = self._forces, self._blocks
        size = 9 * (self._own.total + len(to.extra))
        blocks = np.empty(size, dtype=self.dtype) if out is None or len(out) != size else out
        f = self._slots("F", shares) if force is not None else np.empty(0, dtype=self.dtype)
        block_kernels.gather(u, self.vertices, self._u)
        edge_slots = to.slots.reshape(len(self._t), -1)
        simplices = self._t.ravel(), shares.slots, edge_slots, self._own.marks, self._D, self._X
        blocks[9 * self._own.total :] = 0
        W = run(simplex_kernels.linearize, shares.parts, *simplices, self._u, f, blocks)
        block_kernels.fold(blocks, self._own.total, to.extra, 9)
        if clamped:
            run(block_kernels.clamp, self._products.parts, self._tensions(), blocks)
        if force is not None:
            self._add(f, shares, force)
        return sum(W), blocks

    def rows(self, pattern: Places) -> Rows:
        """Where the blocks stand in the values of a matrix of this pattern."""
        return rows_of(self._own, self.vertices, pattern)

    @in_turn
    def tangent(
        self, u: Array, rows: Rows, data: Array, add: bool, force: Array | None = None, clamped: bool = False
    ) -> Linearized:
        """Write the tangent stiffness [N/m] to the CSR values `data`, or add it to them; adds the force to `force` (nv, d).

        `clamped`: as of `edge_blocks`.
        """
        W, blocks = self.edge_blocks(u, force, self._kept.get("blocks"), clamped)
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

    def add_diagonal(self, blocks: Array, out: Array) -> None:
        """Add the diagonal blocks `K_aa` to `out` (nv, d, d), for the `blocks` of the edges."""
        block_kernels.add_diagonal(self._own.edges, self.vertices, blocks, out)
