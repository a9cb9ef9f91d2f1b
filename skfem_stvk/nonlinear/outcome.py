"""Outcomes of analyses, and Ctrl-C, which waits for the end of a step."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from enum import Enum
from types import FrameType
from typing import Any

#: Whether Ctrl-C was pressed.
_asked = False


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


@contextmanager
def finishing_steps() -> Iterator[None]:
    """Let the first Ctrl-C within end an analysis after the step that it is in, and another one at once.

    Signals are of the main thread; in others nothing changes.
    """
    global _asked
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    _asked = False
    before = signal.signal(signal.SIGINT, _note)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        _asked = False


def stop_if_asked() -> None:
    """Raise KeyboardInterrupt if Ctrl-C was pressed since: analyses call it after each step, when all of it is written."""
    if _asked:
        raise KeyboardInterrupt


def ask_to_finish() -> None:
    """Let an analysis that runs end after the step that it is in, as the first Ctrl-C does."""
    global _asked
    _asked = True


def _note(number: int, frame: FrameType | None) -> None:
    global _asked
    if _asked:
        raise KeyboardInterrupt
    _asked = True
    print("\nCtrl-C: ending after this step; press it again to end at once.", file=sys.stderr, flush=True)
