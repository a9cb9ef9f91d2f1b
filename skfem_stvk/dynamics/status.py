"""How a simulation, or an attempt at one, came out."""

from __future__ import annotations

from enum import Enum


class Status(Enum):
    """The outcome; its value says it in words."""

    FINISHED = "finished"
    INVERTED = "reached the end, but with elements inside out"
    BLEW_UP = "blew up"
    NOT_CONVERGED = "a step did not converge"
    INTERRUPTED = "interrupted"

    @property
    def success(self) -> bool:
        """Whether it reached the end in a state with no element inside out."""
        return self is Status.FINISHED

    def __str__(self) -> str:
        return self.value
