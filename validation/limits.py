"""Limits of time and memory for calls with random or hostile inputs."""

from __future__ import annotations

import resource
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

Result = TypeVar("Result")


class Hang(Exception):
    """Error of a call that exceeded its time limit."""


def limited(call: Callable[[], Result], seconds: float) -> Result:
    """Return the result of the call. If the system has alarms, a call that takes longer than `seconds` raises `Hang`."""
    if not hasattr(signal, "SIGALRM"):
        return call()

    def alarm(*_: Any) -> None:
        raise Hang(f"no result within {seconds:g} s")

    before = signal.signal(signal.SIGALRM, alarm)
    signal.setitimer(signal.ITIMER_REAL, seconds, seconds)  # repeated: exceptions in callbacks of the garbage collector are lost
    try:
        return call()
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


@contextmanager
def at_most(gigabytes: float) -> Iterator[None]:
    """Limit the address space that this process may use in addition within the `with` block."""
    _, most = resource.getrlimit(resource.RLIMIT_AS)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + int(gigabytes * 2**30), most))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
