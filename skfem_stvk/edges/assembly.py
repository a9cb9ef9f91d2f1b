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
from .stiffness import in_range
from .stretches import Stretches
from .tensions import ALL, Tensions


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
            form.p,
            form.t,
            form.edges,
            lambda t, own: in_range(form.stiffness.stored(form.p, t, own.elements, own.local), own.elements, dtype),
            dtype,
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

    @in_turn
    def mean_force(self, u0: Array, u1: Array, weights: tuple[float, float], theta: float, force: Array) -> float:
        """Add to `force` (nv, d) [N] what mean tensions of two states `u0`, `u1` (nv, d) pull along the edges as they are in between.

            f_a = sum_b t_ab (p_a - p_b)        t = L (w0 zeta(u0) + w1 zeta(u1)),  p at (1 - theta) u0 + theta u1

        Forces and torques about `p` balance. The work over `u1 - u0` is `W(u1) - W(u0)` for `w0 = w1 = theta = 1/2`, and with other weights of
        sum 1 more by `(w1 - w0)` times `1/4 dzeta' L dzeta` [J], which is returned: zero for a rigid motion, and never negative.
        """
        shares = self._forces
        f = self._slots("F", shares)
        block_kernels.gather(u0, self.vertices, self._u)
        change = self._gathered("direction", u1, np.float64)
        change -= self._u
        simplices = self._t.ravel(), shares.slots, self._D, self._X, self._u
        w0, w1 = weights
        parts = run(simplex_kernels.mean_force, shares.parts, *simplices, change, float(w0), float(w1), float(theta), f)
        self._add(f, shares, force)
        return sum(parts)

    @in_turn
    def damping_force(self, u: Array, v: Array, force: Array) -> float:
        """Add to `force` (nv, d) the resistance of the edges to velocities `v` at `u` (nv, d), for a relaxation time of 1 s.

            f_a = sum_b t_ab (p_a - p_b)        t = L dzeta/dt,  dzeta_ab/dt = 2 (p_a - p_b) . (v_a - v_b)

        It is `2 J' L J v`, the product with the Gauss-Newton tangent, and the derivative by `v` of `R = 1/4 dzeta/dt' L dzeta/dt` [W], which
        is returned: the power that it takes is `2 R`. Rigid motions, turning ones too, meet no resistance.
        """
        shares = self._forces
        f = self._slots("F", shares)
        block_kernels.gather(u, self.vertices, self._u)
        V = self._gathered("direction", v, np.float64)
        simplices = self._t.ravel(), shares.slots, self._D, self._X, self._u
        parts = run(simplex_kernels.damping_force, shares.parts, *simplices, V, f)
        self._add(f, shares, force)
        return sum(parts)

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
        self, u: Array, force: Array | None = None, out: Array | None = None, kept: Tensions = ALL
    ) -> tuple[float, Array]:
        """As of `SimplexTerm`: `K = 2 J' L J + sum g t Lap (x) I` with the factors `g` of the tensions `t` that are kept."""
        W, blocks = super().edge_blocks(u, force, out, kept)
        if kept.negative != kept.positive:
            run(block_kernels.weigh_negative, self._products.parts, self._tensions(), kept.positive - kept.negative, blocks)
        return W, blocks

    def _linearize(self, shares: Shares, edge_slots: NDArray[Any], f: Array, blocks: Array, kept: Tensions) -> float:
        simplices = self._t.ravel(), shares.slots, edge_slots, self._own.marks, self._D, self._X, self._u
        return sum(run(simplex_kernels.linearize, shares.parts, *simplices, kept.positive, f, blocks))
