"""A task: one measurement, and how it turns into a result whatever happens."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from .players import METHODS, Foul, Player
from .results import Outcome, Result, judged


class NotApplicable(Exception):
    """The check has no meaning here, by nature; the message says why."""


class CannotTell(Exception):
    """The check ran and could not decide; the message says why."""


@dataclass(frozen=True)
class Task:
    """One check of one quantity of one player in one state.

    `needs` are those of W, F, K that the player must have. `measure` returns what `judged` takes: at least `measured`, `limit`.
    """

    check: str
    player: Player
    quantity: str
    state: str
    needs: str
    measure: Callable[[], dict[str, Any]]
    against: str = ""

    @property
    def _who(self) -> dict[str, Any]:
        return {
            "check": self.check,
            "subject": self.player.name,
            "quantity": self.quantity,
            "state": self.state,
            "against": self.against,
        }

    def missed(self, reason: str) -> Result:
        """The result of a task that could not run."""
        return Result(outcome=Outcome.COULD_NOT_RUN, reason=reason, **self._who)

    def run(self) -> Result:
        """The result; never an exception."""
        lacking = [f"{METHODS[quantity]}(u)" for quantity in self.needs if not self.player.has(quantity)]
        if lacking:
            return Result(
                outcome=Outcome.NOT_APPLICABLE, reason=f"{self.player.name} has no {' and no '.join(lacking)}", **self._who
            )
        try:
            return judged(**self._who, **self.measure())
        except NotApplicable as why:
            return Result(outcome=Outcome.NOT_APPLICABLE, reason=str(why), **self._who)
        except (Foul, CannotTell) as why:
            return self.missed(str(why))
        except Exception as error:
            return self.missed(f"{type(error).__name__}: {error}")
