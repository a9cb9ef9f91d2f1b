"""How a static solve, or one of its steps, came out."""

from __future__ import annotations

from enum import Enum


class Status(Enum):
    """The outcome; its value says it in words."""

    CONVERGED = "converged"
    AT_ROUND_OFF = "converged as far as rounding allows"
    UNSTABLE = "in equilibrium, but unstable"
    INVERTED = "in equilibrium, but with elements inside out"
    STOPPED = "stopped before the end"
    INTERRUPTED = "interrupted"

    @property
    def success(self) -> bool:
        """Whether the state is an equilibrium at the full load that is stable, as far as was seen, and has no element inside out."""
        return self in (Status.CONVERGED, Status.AT_ROUND_OFF)

    def __str__(self) -> str:
        return self.value
