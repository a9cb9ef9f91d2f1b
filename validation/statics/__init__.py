"""Static solves: what they are checked against, and what they cost."""

from __future__ import annotations

from collections.abc import Sequence

NAMES = ("homogeneous", "turek-hron", "manufactured", "elastica", "work-precision", "speed")
#: Runs only when it is asked for.
ON_DEMAND = ("large",)


def main(quick: bool = False, only: Sequence[str] = (), out: str | None = None) -> int:
    """static solves against closed forms and benchmarks, work-precision, and speed; `--only large` for a million unknowns"""
    from .studies import run

    return run(only or NAMES, quick, out)


__all__ = ["NAMES", "ON_DEMAND", "main"]
