"""Who notices that a motion blows up."""

from __future__ import annotations

from math import isfinite
from operator import itemgetter

from .ledger import Ledger
from .plan import Plan, Snapshot

#: A body has blown up with this many times more energy, from nowhere, than it had or was given.
TOO_MUCH = 20.0
#: Up to this part of it a state counts as good, unless so much of it came within as many steps; every so many steps one is kept.
GOOD, QUICKLY, EVERY = 1.0, 0.1, 20
COLUMNS = "kinetic_energy", "strain_energy", "potential_energy", "external_work", "closure_error"


class Guard:
    """Holds the closure error against the energy that there is, and keeps the plan's last good state."""

    def __init__(self, ledger: Ledger, plan: Plan) -> None:
        self._ledger, self._plan = ledger, plan
        self._pick = itemgetter(*map(ledger.names.index, COLUMNS))
        self._potential = float(ledger["potential_energy"][0])
        self._most = energy_given(ledger)
        self._keep(plan.good or plan.snapshot(ledger.steps))

    def blown_up(self) -> bool:
        """Whether the last row tells of energy from nowhere."""
        kinetic, strain, potential, external, excess = self._pick(self._ledger.rows(self._ledger.steps - 1)[0].tolist())
        self._most = max(self._most, abs(potential - self._potential), abs(external))
        self._excess = excess
        return not isfinite(kinetic + strain + excess) or excess > TOO_MUCH * self._most > 0

    def keep(self) -> None:
        """Keep the state of the last row, if it is time and it is a good one."""
        since = (self._plan.steps - self._good.steps) / EVERY
        if since >= 1 and self._excess <= self._most * GOOD and self._excess - self._before <= self._most * QUICKLY * since:
            self._keep(self._plan.snapshot(self._ledger.steps))

    def _keep(self, good: Snapshot) -> None:
        self._good = self._plan.good = good
        self._before = float(self._ledger["closure_error"][good.rows - 1])


def from_nowhere(ledger: Ledger) -> float:
    """The closure error in the end, as a part of the energy that there was or was given: below zero where the steps lost it."""
    most = energy_given(ledger)
    return float(ledger["closure_error"][-1] / most) if most > 0 else 0.0


def energy_given(ledger: Ledger) -> float:
    """What the body had first, or the most that it was given since [J]: more than that damping takes only of what came from nowhere."""
    kinetic, strain, *changing = (ledger[name] for name in COLUMNS[:-1])
    return max(float(kinetic[0] + strain[0]), *(float(max(x.max() - x[0], x[0] - x.min())) for x in changing))
