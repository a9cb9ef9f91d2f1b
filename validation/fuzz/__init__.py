"""Random bodies, programs and files, by Hypothesis: a clear error or a right result, whatever is asked, and in whatever order."""

from __future__ import annotations


def main(cases: int = 2000, seconds: float | None = None, seed: int = 0) -> int:
    """Random cases of every family in turn, until there are so many or the time is over; exit code 1 if one is wrong."""
    from .study import run  # Hypothesis is imported only for this study

    return run(cases, seconds, seed)
