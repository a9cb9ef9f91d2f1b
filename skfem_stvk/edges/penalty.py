"""Energy of the volume ratios of elements, as a law on elements."""

from __future__ import annotations

from math import factorial
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from ..arguments import Array
from ..kernels import penalty as penalty_kernels
from ..kernels.penalty import BARRIER
from ..kernels.rows import PairSlots, RowSlots
from ..kernels.threads import locked
from ..mesh.points import base_vectors_at, determinants
from .assembly import Assembly, offering
from .elements import Quadrature, mean_frames
from .pairs import Tensions
from .stiffness import StoredLaw
from .topology import KernelOrder

#: End of messages about elements with `J <= 0`.
BARRIER_IS_INFINITE = (
    "the barrier of a VolumePenalty is infinite. Start without inverted elements, and keep steps below step_limit(u, v); "
    'or take kind="compression" or "quadratic", which push such elements back.'
)


class PenaltyStiffness(StoredLaw):
    """`W = sum of k V0 psi(J)` over the points of elements, `J` the ratio of the signed volume there to that at rest.

    Parameters
    ----------
    stiffness
        (nt,) stiffness `k` times section [Pa] times 1, thickness or area, of elements that fill their space.
    kind
        Kind of `psi`, a number of `kernels.penalty`.
    """

    def __init__(self, stiffness: Array, kind: int) -> None:
        self._stiffness, self.kind = stiffness, kind
        self.barrier = BARRIER_IS_INFINITE if kind == BARRIER else ""

    def law(self, D: Array) -> Array:
        """Return the numbers themselves."""
        return D

    def numbers(self, p: Array, quadrature: Quadrature, order: KernelOrder, dtype: DTypeLike) -> Array:
        """Return `k V0` and `1/C0` (2, nq, nt) at each point, with the sign of `C0`. `V0` excludes the weights of a table of
        points.
        """
        t, stiffness, element = order.vertices[order.t], self._stiffness[order.elements], quadrature.element
        if element.is_linear_simplex:
            corners = p[:, t]
            C0 = np.linalg.det((corners[:, 1:] - corners[:, :1]).transpose(2, 1, 0))[None]
            return np.stack([stiffness * np.abs(C0) / factorial(len(p)), 1 / C0])
        if quadrature.hourglass is not None:  # the frame is the axes of space
            _, volumes = mean_frames(p, t, element)
            return np.stack([stiffness * volumes, np.ones_like(volumes)])[:, None]
        C0 = np.stack([determinants(base_vectors_at(p, t, element, xi[None]))[:, 0] for xi in quadrature.rule.points])
        return np.stack([stiffness * np.abs(C0), 1 / C0])


@locked
def add_round_off(term: Assembly, u: Array, out: Array) -> None:
    """Add the absolute values of all summands of the force at `u` (nv, d) to `out` (nv, d) [N]: times eps, its rounding error."""
    term.elements.gather(u)
    term.run(penalty_kernels.penalty_round_off, out, *_arguments(term))


def _energies(term: Assembly, force: Array | None) -> list[float]:
    return [W for W, _ in term.run(penalty_kernels.penalty_energy_and_force, force, *_arguments(term))]


def _linearize(term: Assembly, to: PairSlots | RowSlots, kept: Tensions, force: Array | None) -> list[tuple[float, float]]:
    """Return energies and traces with the energy added to the trace, so that the trace shows an overflow of the part of `psi'` in
    K. That part is skew and has no diagonal; if it overflows, so does the energy.
    """
    found = term.run(penalty_kernels.penalty_linearize, force, *_arguments(term), float(kept.negative), to=(to,))
    return [(W, trace + W) for W, _, trace in found]


def _arguments(term: Assembly) -> tuple[int, int]:
    """Return the arguments of the kernels that other laws do not have."""
    assert isinstance(term.stored, PenaltyStiffness)
    return term.elements.k, term.stored.kind


def _check(term: Assembly, found: list[Any]) -> None:
    """Refuse results of the barrier with a smallest `J` that is not positive: elements have no volume left at a point."""
    if min(one[1] if isinstance(one, tuple) else one for one in found) <= 0:
        term.refuse_inside_out()


PENALTY = offering(__name__, "PENALTY", _energies=_energies, _linearize=_linearize, check=_check, add_round_off=add_round_off)
