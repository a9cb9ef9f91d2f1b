"""Elements: their orders, what precision costs with each, the flag with quadratic triangles, and hard cases with quadratic ones."""

from __future__ import annotations

from collections.abc import Sequence

NAMES = ("orders", "work-precision", "turek-hron", "costs", "solvers", "hard", "peers")


def main(quick: bool = False, only: Sequence[str] = (), out: str | None = None) -> int:
    """orders, work-precision and costs of all elements; Turek and Hron's flag and the hard cases with quadratic ones"""
    from .studies import run

    return run(only or NAMES, quick, out)


__all__ = ["NAMES", "main"]
