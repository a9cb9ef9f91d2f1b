"""Models of the overview on one bar and one body: error, speed, memory and stable step of each."""

from __future__ import annotations

from collections.abc import Sequence

NAMES = ("bent", "twisted", "released", "thrown", "recoveries", "random-starts", "costs")


def main(quick: bool = False, only: Sequence[str] = (), out: str | None = None) -> int:
    """Compare models on a bar, bent, twisted, released and thrown: linear, springs, corotated, StVK, invertible, neo-Hookean."""
    from .studies import run

    return run(only or NAMES, quick, out)


__all__ = ["NAMES", "main"]
