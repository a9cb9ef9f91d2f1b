"""What the steps of a motion took."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class Counts:
    """Counted by a stepper, over the whole motion: those before it was resumed are added.

    Attributes
    ----------
    iterations : of Newton's method, or of the linear solver where a step is one linear solve; 0 where there are none.
    clamped : steps of one linear solve that were made with the clamped tangent, because K was not positive definite.
    """

    iterations: int = 0
    clamped: int = 0

    def add(self, before: Counts) -> None:
        """Count what was counted before as well."""
        self.iterations += before.iterations
        self.clamped += before.clamped
