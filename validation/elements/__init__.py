"""Elements: orders of convergence, cost for a given precision, the flag with quadratic triangles, and hard cases."""

from __future__ import annotations

from collections.abc import Sequence

NAMES = ("orders", "work-precision", "turek-hron", "costs", "solvers", "hard", "peers")


def main(quick: bool = False, only: Sequence[str] = (), out: str | None = None) -> int:
    """Measure orders, work-precision and costs of all elements; the flag and the hard cases with quadratic elements."""
    from .studies import run

    return run(only or NAMES, quick, out)


__all__ = ["NAMES", "main"]
