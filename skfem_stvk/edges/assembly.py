"""W, F and K of an edge form, and what solvers ask of them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..kernels import blocks as block_kernels
from ..kernels import simplices as simplex_kernels
from ..kernels.threads import in_turn, run
from .form import EdgeForm
from .sharing import Shares
from .simplices import Array, SimplexTerm
from .stretches import Stretches


class Assembly(Stretches, SimplexTerm):
    """The kernels on the simplices of an edge form.

    Parameters
    ----------
    form : the edge form.
    dtype : of results and of coefficients, which are computed in double and rounded then.
    """

    def __init__(self, form: EdgeForm, dtype: DTypeLike = np.float64) -> None:
        self.form = form
        super().__init__(
            form.p, form.t, form.edges, lambda t, own: form.stiffness.stored(form.p, t, own.elements, own.local), dtype
        )
        if self._D.shape[1] == 7 * simplex_kernels.LANES:
            self._D = self._D.ravel()

    def _energy(self, shares: Shares, f: Array) -> float:
        return sum(run(simplex_kernels.energy_and_force, shares.parts, self._t.ravel(), shares.slots, self._D, self._X, self._u, f))

    @in_turn
    def along(self, u: Array, v: Array) -> NDArray[np.float64]:
        """(5,) coefficients `c` [J] of the energy along `u + s v`, both (nv, d): exactly `c_0 + c_1 s + ... + c_4 s^4`, at any `s`."""
        block_kernels.gather(u, self.vertices, self._u)
        V = self._gathered("direction", v, np.float64)
        coefficients = run(simplex_kernels.along, self._forces.parts, self._t.ravel(), self._D, self._X, self._u, V)
        total: NDArray[np.float64] = np.sum(coefficients, axis=0)
        return total

    def _round_off(self, shares: Shares, f: Array) -> None:
        run(simplex_kernels.round_off, shares.parts, self._t.ravel(), shares.slots, self._D, self._X, self._u, f)

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

    @in_turn
    def edge_blocks(
        self, u: Array, force: Array | None = None, out: Array | None = None, clamped: bool = False
    ) -> tuple[float, Array]:
        """As of `SimplexTerm`; `clamped` puts `max(t, 0)` in the place of the tensions `t` of the edges, so that K is positive semi-definite."""
        W, blocks = super().edge_blocks(u, force, out)
        if clamped:
            run(block_kernels.clamp, self._products.parts, self._tensions(), blocks)
        return W, blocks

    def _linearize(self, shares: Shares, edge_slots: NDArray[Any], f: Array, blocks: Array, clamped: bool) -> float:
        simplices = self._t.ravel(), shares.slots, edge_slots, self._own.marks, self._D, self._X
        return sum(run(simplex_kernels.linearize, shares.parts, *simplices, self._u, f, blocks))
