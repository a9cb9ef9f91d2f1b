"""W, F and K of an energy of the volume ratios of elements."""

from __future__ import annotations

from math import factorial
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..arguments import Array
from ..kernels import penalty as penalty_kernels
from ..kernels.rows import PairSlots, RowSlots
from ..kernels.threads import in_turn, run
from ..mesh.points import determinants, spokes_at
from .assembly import ElementTerm, refuse_inside_out
from .elements import Quadrature, mean_frames, simplex_quadrature
from .pairs import ALL, Linearized, Tensions
from .streaming import ElementRows
from .topology import OwnOrder, Shares

#: What messages say of elements with `J <= 0`.
BARRIER_IS_INFINITE = (
    "the barrier of a VolumePenalty is infinite. Start from a state that is not inside out, and keep steps below step_limit(u, v); "
    'or take kind="compression" or "quadratic", which push such elements back.'
)


class PenaltyAssembly(ElementTerm):
    """`W = sum of k V0 psi(J)` over the points of elements, `J` the ratio of the signed volume there to that at rest.

    Parameters
    ----------
    p : (d, nv) rest coordinates [m].
    t : (n, nt) nodes of the elements, which fill their space.
    stiffness : (nt,) `k` times section [Pa] times 1, thickness or area.
    kind : of `psi`, a number of `kernels.penalty`.
    elements : (nt,) their ids, for messages.
    dtype : of results and of what is stored, which is computed in double and rounded then.
    quadrature : the kind of elements and the rule, by default linear simplices.
    """

    def __init__(
        self,
        p: NDArray[np.float64],
        t: NDArray[np.int32],
        stiffness: NDArray[np.float64],
        kind: int,
        elements: NDArray[Any],
        dtype: DTypeLike = np.float64,
        *,
        quadrature: Quadrature | None = None,
    ) -> None:
        quadrature = quadrature or simplex_quadrature(len(t) - 1)

        def stored(nodes: NDArray[np.int32], own: OwnOrder) -> Array:
            return _stored(p, nodes, stiffness[own.elements], quadrature)

        super().__init__(p, t, quadrature, stored, dtype)
        self._kind, self._ids = kind, elements

    def _energy(self, shares: Shares, f: Array) -> float:
        return self._checked(run(penalty_kernels.penalty_energy_and_force, shares.parts, *self._arrays(shares), f))

    def _linearize(self, shares: Shares, to: PairSlots | RowSlots, f: Array, kept: Tensions) -> list[Any]:
        t, slots, *others = self._arrays(shares)
        return run(penalty_kernels.penalty_linearize, shares.parts, t, slots, to, *others, float(kept.negative), f)

    def _total(self, found: list[Any]) -> tuple[float, float]:
        return self._checked([(W, least) for W, least, _ in found]), sum(trace for _, _, trace in found)

    @in_turn
    def add_round_off(self, u: Array, out: Array) -> None:
        """Add the absolute values of all that adds up to the force at `u` (nv, d) to `out` (nv, d) [N]: times eps, its rounding."""
        shares, f = self._open(u, out)
        least = run(penalty_kernels.penalty_round_off, shares.parts, *self._arrays(shares), f)
        self._checked([(0.0, value) for value in least])
        self._close(f, out)

    def _arrays(self, shares: Shares) -> tuple[Any, ...]:
        """The arguments of the kernels, behind the blocks that they go over."""
        elements = self.elements
        return elements.t.ravel(), shares.slots, self.points, self._D, elements.X, elements.u, elements.k, self._kind

    def fill(
        self, u: Array, rows: ElementRows, data: Array, add: bool, force: Array | None = None, kept: Tensions = ALL
    ) -> Linearized:
        """Fill K as in `PairTerm`. The part of `psi'` in K is skew, without diagonal: if it overflows, so does the energy."""
        W, total = super().fill(u, rows, data, add, force, kept)
        return Linearized(W, total + W)

    def _checked(self, found: list[tuple[float, float]]) -> float:
        """The energy of all parts, unless that is infinite because elements have no volume left at a point."""
        if min(least for _, least in found) <= 0:
            refuse_inside_out(self._volume_ratios(self.elements.at_points), self._ids, BARRIER_IS_INFINITE)
        return sum(W for W, _ in found)


def _stored(p: Array, t: NDArray[np.int32], stiffness: Array, quadrature: Quadrature) -> Array:
    """(2, nq, nt) `k V0` and `1/C0` at each point, with the sign that `C0` has; the weights of a table of points are not in
    `V0`.
    """
    element = quadrature.element
    if element.is_linear_simplex:
        corners = p[:, t]
        C0 = np.linalg.det((corners[:, 1:] - corners[:, :1]).transpose(2, 1, 0))[None]
        return np.stack([stiffness * np.abs(C0) / factorial(len(p)), 1 / C0])
    if quadrature.hourglass is not None:  # the frame is that of space
        _, volumes = mean_frames(p, t, element)
        return np.stack([stiffness * volumes, np.ones_like(volumes)])[:, None]
    C0 = np.stack([determinants(spokes_at(p, t, element, xi[None]))[:, 0] for xi in quadrature.rule.points])
    return np.stack([stiffness * np.abs(C0), 1 / C0])
