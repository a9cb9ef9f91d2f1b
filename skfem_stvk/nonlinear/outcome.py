"""Outcomes of analyses."""

from __future__ import annotations

from enum import Enum
from typing import Any


class Status(Enum):
    """The outcome of a static solve, of one of its steps, or of a motion; its value says it in words."""

    CONVERGED = "converged"
    AT_ROUND_OFF = "converged as far as rounding allows"
    UNSTABLE = "in equilibrium, but unstable"
    INVERTED = "in equilibrium, but with elements inside out"
    STOPPED = "stopped before the end"
    FINISHED = "finished"
    ENDED_INVERTED = "reached the end, but with elements inside out"
    BLEW_UP = "blew up"
    NOT_CONVERGED = "a step did not converge"
    INTERRUPTED = "interrupted"

    @property
    def success(self) -> bool:
        """Whether the end was reached in a state that is stable, as far as was seen, and has no element inside out."""
        return self in (Status.CONVERGED, Status.AT_ROUND_OFF, Status.FINISHED)

    def __str__(self) -> str:
        return self.value


class Interrupted(KeyboardInterrupt):
    """Ctrl-C during a static solve or a motion.

    Attributes
    ----------
    result : what there is so far: a `StaticResult` or a `Run`.
    """

    def __init__(self, result: Any) -> None:
        super().__init__(result.message)
        self.result = result

    @property
    def run(self) -> Any:
        """The result of a motion, as in `SimulationError.run`."""
        return self.result

    def __reduce__(self) -> Any:
        return type(self), (self.result,)
