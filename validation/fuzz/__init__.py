"""Random bodies, programs and files by Hypothesis: each case must give a clear error or a right result."""

from __future__ import annotations


def main(cases: int = 2000, seconds: float | None = None, seed: int = 0) -> int:
    """Run random cases of every family until N cases or the time is reached; exit code 1 if a case fails."""
    from .study import run  # Hypothesis is imported only for this study

    return run(cases, seconds, seed)
