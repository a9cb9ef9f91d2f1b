"""Seconds of a solve, by part."""

from __future__ import annotations

from collections.abc import Mapping
from time import perf_counter


class Lap:
    """Seconds within `with`: a generator would take 1.2 us instead of 0.3, again and again in steps of 50."""

    def __init__(self) -> None:
        self.seconds, self._begin = 0.0, 0.0

    def __enter__(self) -> None:
        self._begin = perf_counter()

    def __exit__(self, *error: object) -> None:
        self.seconds += perf_counter() - self._begin


class Stopwatch:
    """Seconds by part, `more` parts beside "assemble", "factor" and "solve"; what is in no part is "other".

    >>> watch = Stopwatch()
    >>> with watch("assemble"):
    ...     pass
    >>> list(watch.parts())
    ['assemble', 'factor', 'solve', 'other']
    """

    def __init__(self, *more: str) -> None:
        self._begin = perf_counter()
        self._parts = {name: Lap() for name in ("assemble", "factor", "solve", *more)}

    def __call__(self, part: str) -> Lap:
        return self._parts[part]

    def add(self, before: Mapping[str, float]) -> None:
        """Count seconds that were spent before as well, by part."""
        for name, part in self._parts.items():
            part.seconds += before.get(name, 0.0)
        self._begin -= sum(before.values())

    def total(self) -> float:
        """Seconds since it was made, and those that were added."""
        return perf_counter() - self._begin

    def parts(self) -> dict[str, float]:
        """Seconds by part, which add up to the total."""
        seconds = {name: part.seconds for name, part in self._parts.items()}
        return seconds | {"other": self.total() - sum(seconds.values())}
