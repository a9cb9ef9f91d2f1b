"""Outcomes of analyses, and handling of Ctrl-C, which takes effect at the end of a step."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from enum import Enum
from types import FrameType
from typing import Any

from ...space import ONE_PROCESS, Communicator

#: Whether Ctrl-C was pressed, and whether an analysis is running that ends after its step then.
_finish_requested = _steps_run = False


class Status(Enum):
    """Outcome of a static solve, of one of its steps, or of a motion; the value is its description."""

    CONVERGED = "converged"
    AT_ROUND_OFF = "converged as far as rounding allows"
    UNSTABLE = "in equilibrium, but unstable"
    INVERTED = "in equilibrium, but with inverted elements"
    STOPPED = "stopped before the end"
    FINISHED = "finished"
    ENDED_INVERTED = "reached the end, but with inverted elements"
    BLEW_UP = "blew up"
    NOT_CONVERGED = "a step did not converge"
    INTERRUPTED = "interrupted"

    @property
    def success(self) -> bool:
        """Whether the analysis reached its end without inverted elements, in a state that is stable as far as known."""
        return self in (Status.CONVERGED, Status.AT_ROUND_OFF, Status.FINISHED)

    def __str__(self) -> str:
        return self.value


class Interrupted(KeyboardInterrupt):
    """Interruption of a static solve or a motion by Ctrl-C.

    Attributes
    ----------
    result
        The result so far, a `StaticResult` or a `Run`.

    Examples
    --------
    >>> import skfem
    >>> from skfem_stvk import NodalLoad, StVK, System, solve_static
    >>> def pull(t):
    ...     if 0.5 < t < 1:
    ...         raise KeyboardInterrupt                              # as Ctrl-C does
    ...     return [0.1 * t]
    >>> bar = System(skfem.MeshLine(), [StVK(young=1.0, poisson=0.3), NodalLoad([1], pull)], fixed={(0,): "x"})
    >>> try:
    ...     solve_static(bar, steps=4, quiet=True)
    ... except Interrupted as interruption:
    ...     print(0 < interruption.result.t <= 0.5)
    True
    """

    def __init__(self, result: Any) -> None:
        super().__init__(result.message)
        self.result = result

    @property
    def run(self) -> Any:
        """Result of a motion, as in `SimulationError.run`."""
        return self.result

    def __reduce__(self) -> Any:
        return type(self), (self.result,)


def with_remedy(result: Any) -> str:
    """Return the message of the error for a result without success: that of the result, and how to get the result instead."""
    if result.status is Status.INTERRUPTED:
        return str(result.message)
    return f"{result.message} With raise_on_failure=False, the result so far is returned instead of this error."


@contextmanager
def finishing_steps() -> Iterator[None]:
    """Make the first Ctrl-C end an analysis after its current step, and a second Ctrl-C end it at once.

    Only the main thread receives signals. In other threads this context manager has no effect.
    """
    global _finish_requested, _steps_run
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    _finish_requested, outer = False, _steps_run
    before = signal.signal(signal.SIGINT, _on_interrupt)
    try:
        _steps_run = True
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        _finish_requested, _steps_run = False, outer


class _Requested(KeyboardInterrupt):
    """Interruption between two steps, which all parts of a divided body have together."""


def stop_if_requested(comm: Communicator = ONE_PROCESS) -> None:
    """Raise KeyboardInterrupt if Ctrl-C was pressed, in a divided body on any rank.

    Analyses call this function after each step, when all output of the step is written.
    """
    if comm.end_step(_finish_requested):
        raise _Requested


def raise_if_divided(comm: Communicator, error: BaseException) -> None:
    """Raise an error again if other ranks may not have it. They would wait for this rank forever."""
    if comm.divided and not isinstance(error, _Requested):
        raise error


def request_finish() -> None:
    """Make a running analysis end after its current step, as the first Ctrl-C does."""
    global _finish_requested
    _finish_requested = True


def finish_on_signal(number: int, frame: FrameType | None) -> None:
    """Handle a signal of a job scheduler like the first Ctrl-C, however often it arrives. Without an analysis it is Ctrl-C."""
    if not _steps_run:
        raise KeyboardInterrupt
    request_finish()


def _on_interrupt(number: int, frame: FrameType | None) -> None:
    global _finish_requested
    if _finish_requested:
        raise KeyboardInterrupt
    _finish_requested = True
    with suppress(OSError):
        print("\nCtrl-C: ending after this step; press it again to end at once.", file=sys.stderr, flush=True)
