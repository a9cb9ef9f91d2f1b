"""Static solves: comparison with closed forms and benchmarks, and cost."""

from __future__ import annotations

from collections.abc import Sequence

NAMES = ("homogeneous", "turek-hron", "manufactured", "elastica", "work-precision", "speed")
#: These studies run only if `--only` names them.
ON_DEMAND = ("large",)


def main(quick: bool = False, only: Sequence[str] = (), out: str | None = None) -> int:
    """Compare static solves with closed forms and benchmarks, and measure speed; `--only large` has a million unknowns."""
    from .studies import run

    return run(only or NAMES, quick, out)


__all__ = ["NAMES", "ON_DEMAND", "main"]
