"""Ctrl-C that waits for the end of a step."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_asked = False


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
