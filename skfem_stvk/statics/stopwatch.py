"""Where the time of a solve goes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from time import perf_counter


class Stopwatch:
    """Seconds by part; what is in no part is "other".

    >>> watch = Stopwatch()
    >>> with watch("assemble"):
    ...     pass
    >>> list(watch.parts())
    ['assemble', 'factor', 'solve', 'other']
    """

    def __init__(self) -> None:
        self._begin = perf_counter()
        self._seconds = {"assemble": 0.0, "factor": 0.0, "solve": 0.0}

    @contextmanager
    def __call__(self, part: str) -> Iterator[None]:
        begin = perf_counter()
        try:
            yield
        finally:
            self._seconds[part] += perf_counter() - begin

    def total(self) -> float:
        """Seconds since it was made."""
        return perf_counter() - self._begin

    def parts(self) -> dict[str, float]:
        """Seconds by part, which add up to the total."""
        return self._seconds | {"other": self.total() - sum(self._seconds.values())}
