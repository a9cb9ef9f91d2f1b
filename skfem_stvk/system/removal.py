"""What is left of a body when elements are taken out: the diagonal of bare nodes in K, and the parts that come loose."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..errors import name_ids
from .operator import TangentOperator
from .pattern import FreeDofs, Pattern

Ids = NDArray[Any]
#: How many parts messages name.
MOST = 3


class BareDiagonal:
    """The diagonal of K for `nodes` that nothing holds any more: `stiffness` [N/m], the mean of K at rest of the whole body.

    With it K stays positive definite, and as well conditioned as it was. There is no force to it.
    """

    def __init__(self, whole: TangentOperator) -> None:
        mean = float(np.einsum("vcc->", whole.diagonal_blocks().astype(np.float64))) / whole.shape[0]
        self.stiffness = mean if np.isfinite(mean) and mean > 0 else 1.0
        self.nodes: NDArray[np.int64] = np.empty(0, dtype=np.int64)

    def write(self, pattern: Pattern, data: Array, free: FreeDofs | None) -> None:
        """Write it to the values of K, or of K over the `free` degrees of freedom."""
        a = self.nodes.astype(np.int32)
        if not len(a):
            return
        d = pattern.shape[0] // len(pattern.strides)
        places = (pattern.places(a, a)[:, None] + np.arange(d) * (pattern.strides[a][:, None] + 1)).ravel()
        if free is not None:
            at = np.minimum(np.searchsorted(free.places, places), len(free.places) - 1)
            places = at[free.places[at] == places]
        data[places] = self.stiffness


class Pieces(NamedTuple):
    """The parts that terms hold together now.

    Attributes
    ----------
    part : (nv,) number of the part that each node is of.
    bare : (nv,) whether nothing holds it any more.
    held : (parts,) whether a support or a foundation holds it anywhere.
    element : (nt,) number of the part that each element is of, -1 if it was taken out.
    word : what messages call a node.
    """

    part: Ids
    bare: NDArray[np.bool_]
    held: NDArray[np.bool_]
    element: Ids
    word: str

    @classmethod
    def of(cls, system: Any) -> Pieces:
        """Those of a system as it is."""
        mesh, part = system.mesh, system.parts()
        bare, held = np.zeros(mesh.nv, dtype=bool), np.zeros(int(part.max()) + 1, dtype=bool)
        bare[system.bare] = True
        held[part[np.union1d(system.supports.held, system.grounded) // mesh.d]] = True
        element = part[mesh.t[0]].astype(np.int64)
        element[system.removed] = -1
        return cls(part, bare, held, element, mesh.word)

    def come_loose(self, before: Pieces) -> str:
        """The parts that nothing holds now, and that were held, or no parts of their own, before; empty if there are none.

        Of a part that nothing held before, the largest piece is still the body.
        """
        size = np.bincount(self.part[~self.bare], minlength=len(self.held))
        first = np.unique(self.part, return_index=True)[1]
        was = before.part[first]
        largest = np.zeros(len(before.held), dtype=np.int64)
        np.maximum.at(largest, was, size)
        candidates = np.flatnonzero((size > 0) & (size == largest[was]))
        the_body = np.zeros(len(size), dtype=bool)
        the_body[candidates[np.unique(was[candidates], return_index=True)[1]]] = True
        loose = np.flatnonzero((size > 0) & ~self.held & (before.held[was] | ~the_body))
        if not len(loose):
            return ""
        shown = [
            f"{name_ids(np.flatnonzero(self.element == i), 'element')} with "
            f"{name_ids(np.flatnonzero((self.part == i) & ~self.bare), self.word)}"
            for i in loose[:MOST]
        ]
        more = f"; and {len(loose) - MOST} more" if len(loose) > MOST else ""
        return f"{len(loose)} part{'s come' if len(loose) > 1 else ' comes'} loose: {'; '.join(shown)}{more}."
