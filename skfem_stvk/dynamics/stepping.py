"""Steps that are cut where they fail."""

from __future__ import annotations

from ..errors import warn
from .books import Books
from .integrators import StepFailed
from .integrators.integrator import Stepper
from .state import State

#: A step is cut in two at most so often: in 64 parts.
DEEPEST = 6
#: Steps in a row that have to be cut are told of from so many on.
MANY = 10


class Cutting:
    """An integrator's steps; where there is no state at the end of one, it is made in two halves, and so on.

    Attributes
    ----------
    cuts : steps that were made in parts.
    """

    def __init__(self, stepper: Stepper, books: Books, cuts: int) -> None:
        self._stepper, self._books, self.cuts, self._in_a_row = stepper, books, cuts, 0

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
            self._in_a_row += 1
            if self._in_a_row == MANY:
                warn(f"t = {t:.4g} s: {MANY} steps in a row had to be cut into parts. Take a smaller dt, or another tangent.")
        else:
            self._in_a_row = 0
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
