"""Steps that are cut where they fail, and kept below the critical one where they have to be."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from .books import Books
from .integrators import StepFailed
from .integrators.integrator import Stepper
from .state import State

Array = NDArray[Any]

#: A step is cut in two at most so often: in 64 parts.
DEEPEST = 6


class Cutting:
    """An integrator's steps; where there is no state at the end of one, it is made in two halves, and so on.

    Attributes
    ----------
    cuts : steps that were made in parts.
    """

    def __init__(self, stepper: Stepper, books: Books, cuts: int) -> None:
        self._stepper, self._books, self.cuts = stepper, books, cuts

    def advance(self, state: State, t: float) -> None:
        """Go on to time `t`.

        Raises
        ------
        StepFailed
            if parts of 1/64 fail too; the state is as it was then.
        """
        try:
            self._stepper.step(state, t)
        except StepFailed:
            before = state.copy()
            try:
                self._halves(state, t, 1)
            except StepFailed:
                state.become(before)
                raise
            self.cuts += 1
        else:
            self._books.work(state)

    def _halves(self, state: State, t: float, depth: int) -> None:
        for end in ((state.t + t) / 2, t):
            try:
                self._stepper.step(state, end)
            except StepFailed:
                if depth == DEEPEST:
                    raise
                self._halves(state, end, depth + 1)
            else:
                self._books.work(state)
