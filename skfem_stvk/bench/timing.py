"""The time of a call."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping
from contextlib import contextmanager
from time import perf_counter
from typing import Any, NamedTuple, TypeVar

import numba
import numpy as np

LEAST = 5
Key = TypeVar("Key", bound=Hashable)


class Seconds(NamedTuple):
    """Shortest and median time of a call [s], and of how many."""

    best: float
    median: float
    repetitions: int


def best_and_median(calls: Mapping[Key, Callable[[], Any]], seconds: float) -> dict[Key, Seconds]:
    """The time of each call in caches that are warm from itself.

    They take turns, so that what else the machine does meets all of them alike. A turn is one call that is not counted, for what came
    before has filled the caches (a CSR product took twice as long after something else), and five that are. A call has turns until its
    `seconds` are spent.
    """
    taken: dict[Key, list[float]] = {key: [] for key in calls}
    while waiting := [key for key, times in taken.items() if not times or sum(times) < seconds]:
        for key in waiting:
            taken[key] += _turn(calls[key])
    return {key: Seconds(min(times), float(np.median(times)), len(times)) for key, times in taken.items()}


def _turn(call: Callable[[], Any]) -> list[float]:
    call()
    times = []
    for _ in range(LEAST):
        begin = perf_counter()
        call()
        times.append(perf_counter() - begin)
    return times


@contextmanager
def threads(count: int) -> Iterator[None]:
    """Numba's number of threads within, and as it was afterwards."""
    before = numba.get_num_threads()
    numba.set_num_threads(count)
    try:
        yield
    finally:
        numba.set_num_threads(before)


def most_threads() -> int:
    """How many threads numba can have here."""
    most: int = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
    return most
