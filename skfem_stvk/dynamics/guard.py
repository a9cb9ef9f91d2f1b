"""Who notices that a motion blows up."""

from __future__ import annotations

import numpy as np

from .ledger import Ledger
from .plan import Plan

#: A body has blown up with this many times more energy, from nowhere, than it had or was given.
TOO_MUCH = 20.0
#: Up to this part of it a state counts as good; every so many steps one is kept.
GOOD, EVERY = 1.0, 20
COLUMNS = "kinetic_energy", "strain_energy", "potential_energy", "external_work", "dissipated_work", "closure_error"


class Guard:
    """Holds the closure error against the energy that there is, and keeps the last good state.

    Attributes
    ----------
    good : where the run was when that was kept.
    """

    def __init__(self, ledger: Ledger, plan: Plan) -> None:
        self._ledger, self._plan = ledger, plan
        self._columns = [ledger.names.index(name) for name in COLUMNS]
        self._potential = float(ledger["potential_energy"][0])
        self._most, self._since = energy_given(ledger), 0
        self.good = plan.snapshot(ledger.steps)

    def blown_up(self, whole: bool) -> bool:
        """Whether the last row tells of energy from nowhere, after a whole step or a shorter one."""
        kinetic, strain, potential, external, dissipated, excess = self._ledger.rows()[-1, self._columns].tolist()
        self._most = max(self._most, abs(potential - self._potential), abs(external), dissipated)
        if not np.isfinite(kinetic + strain + excess) or excess > TOO_MUCH * self._most > 0:
            return True
        self._since += 1
        if whole and self._since >= EVERY and excess <= GOOD * self._most:
            self.good, self._since = self._plan.snapshot(self._ledger.steps), 0
        return False


def from_nowhere(ledger: Ledger) -> float:
    """The closure error in the end, as a part of the energy that there was or was given: below zero where the steps lost it."""
    most = energy_given(ledger)
    return float(ledger["closure_error"][-1] / most) if most > 0 else 0.0


def energy_given(ledger: Ledger) -> float:
    """What the body had first, or the most that it was given or that damping took since [J]."""
    kinetic, strain, *changing = (ledger[name] for name in COLUMNS[:-1])
    return max(float(kinetic[0] + strain[0]), *(float(max(x.max() - x[0], x[0] - x.min())) for x in changing))
