"""W, F and K of an energy of the volume ratios of simplices."""

from __future__ import annotations

from functools import partial
from math import factorial
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..arguments import Array
from ..errors import StateError, name_ids
from ..kernels import penalty as penalty_kernels
from ..kernels.lanes import LANES
from ..kernels.threads import run
from .assembly import ElementTerm
from .elements import simplex_quadrature
from .pairs import ALL, Linearized, Rows, Tensions
from .topology import OwnOrder, Shares


class PenaltyAssembly(ElementTerm):
    """`W = sum of k V0 psi(J)`, `J` the ratio of a simplex's signed volume to that at rest.

    Parameters
    ----------
    p : (d, nv) rest coordinates [m].
    t : (d + 1, nt) vertices of the simplices.
    stiffness : (nt,) `k` times section [Pa] times 1, thickness or area.
    kind : of `psi`, a number of `kernels.penalty`.
    elements : (nt,) their ids, for messages.
    dtype : of results and of what is stored, which is computed in double and rounded then.
    """

    def __init__(
        self,
        p: NDArray[np.float64],
        t: NDArray[np.int32],
        stiffness: NDArray[np.float64],
        kind: int,
        elements: NDArray[Any],
        dtype: DTypeLike = np.float64,
    ) -> None:
        super().__init__(p, t, simplex_quadrature(len(t) - 1), partial(_stored, p, stiffness), dtype)
        self._D = self._D.reshape(-1, 2 * LANES)
        self._kind, self._ids = kind, elements

    def _energy(self, shares: Shares, f: Array) -> float:
        return self._checked(run(penalty_kernels.penalty_energy_and_force, shares.parts, *self._simplices(shares), f))

    def _linearize(self, shares: Shares, edge_slots: NDArray[Any], f: Array, blocks: Array, kept: Tensions) -> float:
        t, slots, *others = self._simplices(shares)
        arrays = t, slots, edge_slots, self.simplices.edges.marks, *others, kept.negative
        return self._checked(run(penalty_kernels.penalty_linearize, shares.parts, *arrays, f, blocks))

    def _round_off(self, shares: Shares, f: Array) -> None:
        least = run(penalty_kernels.penalty_round_off, shares.parts, *self._simplices(shares), f)
        self._checked([(0.0, value) for value in least])

    def _simplices(self, shares: Shares) -> tuple[Any, ...]:
        """What the kernels read."""
        simplices = self.simplices
        return simplices.t.ravel(), shares.slots, self._D, simplices.X, simplices.u, simplices.k, self._kind

    def fill(self, u: Array, rows: Rows, data: Array, add: bool, force: Array | None = None, kept: Tensions = ALL) -> Linearized:
        """As in `PairTerm`. What `psi'` adds to K is skew and in no diagonal entry: if it overflows, so does the energy."""
        W, total = super().fill(u, rows, data, add, force, kept)
        return Linearized(W, total + W)

    def _checked(self, found: list[tuple[float, float]]) -> float:
        """The energy of all parts, unless that is infinite because simplices have no volume left."""
        if min(least for _, least in found) <= 0:
            refuse_inside_out(self._volume_ratios(), self._ids)
        return sum(W for W, _ in found)


def refuse_inside_out(ratios: NDArray[np.float64], ids: NDArray[Any]) -> None:
    """Refuse a state of simplices with these `ids` and ratios `J`, of which one at least is not positive, but for rounding."""
    least = ratios.min()
    raise StateError(
        f"{name_ids(ids[ratios <= max(least, 0.0)], 'element')} inside out or flat (J down to {least:.2g}), where the barrier of "
        "a VolumePenalty is infinite. Start from a state that is not inside out, and keep steps below step_limit(u, v); or take "
        'kind="compression" or "quadratic", which push such elements back.'
    )


def _stored(p: NDArray[np.float64], stiffness: NDArray[np.float64], t: NDArray[np.int32], own: OwnOrder) -> NDArray[np.float64]:
    """(2, nt) `k V0` and `1/C0`, with the sign that `C0` has in the simplices' own order of vertices."""
    corners = p[:, t]
    C0 = np.linalg.det((corners[:, 1:] - corners[:, :1]).transpose(2, 1, 0))
    return np.stack([stiffness[own.elements] * np.abs(C0) / factorial(len(p)), 1 / C0])[:, None]
