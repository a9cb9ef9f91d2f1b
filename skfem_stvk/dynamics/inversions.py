"""Elements that turn inside out in a motion: counted step by step, and told of."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..errors import name_ids, warn
from .ledger import INSIDE_OUT, Ledger
from .plan import Plan

#: Explicit integrators are looked at after so many steps, for a look costs half a force; implicit ones after each.
EXPLICIT, IMPLICIT = 20, 1


class Inversions:
    """Count the elements that are inside out, and enter their number in the ledger's last row.

    Rows between two looks have the number of the look before, so that a run which is resumed has the same ledger as one that never stopped.
    """

    def __init__(self, plan: Plan, ledger: Ledger) -> None:
        self._plan, self._ledger, self._warned = plan, ledger, False
        self._every = EXPLICIT if plan.integrator.explicit else IMPLICIT
        out_of_turn = plan.steps % self._every  # as the end of a run that is resumed, which was looked at because it was the end
        ledger.replace_last(INSIDE_OUT, ledger[INSIDE_OUT][-2] if out_of_turn else len(self._elements()))

    def look(self, last: bool) -> None:
        """Count them if it is time, and in any case in the `last` state.

        Warns
        -----
        StvkWarning
            where there are any for the first time.
        """
        if self._plan.steps % self._every and not last:
            return
        turned = self._elements()
        self._ledger.replace_last(INSIDE_OUT, len(turned))
        if len(turned) and not self._warned:
            self._warned = True
            warn(f"t = {self._plan.state.t:.4g} s: {name_ids(turned, 'element')} inside out. {self._advice()}")

    def on_the_way(self) -> str:
        """How many elements were inside out since the beginning, and when, for the message of the run; empty if none was seen so."""
        counts, times = self._ledger[INSIDE_OUT], self._ledger["time"]
        seen = np.flatnonzero(counts)
        if not len(seen):
            return ""
        first, last = times[seen[[0, -1]]]
        return f"; elements were inside out on the way, up to {counts.max():.0f} at once, between t = {first:.4g} s and t = {last:.4g} s"

    @property
    def resisted(self) -> bool:
        """Whether a term resists that elements turn inside out."""
        return self._plan.motion.system.resists_inversion

    def _elements(self) -> NDArray[np.int64]:
        return self._plan.motion.system.inside_out(self._plan.state.u)

    def _advice(self) -> str:
        if self.resisted:
            return "Take smaller steps, or a stiffer VolumePenalty."
        return "St. Venant-Kirchhoff does not resist that: add VolumePenalty() to the terms, or take smaller steps."
