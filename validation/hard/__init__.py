"""Hard cases: what solvers make of limit points, inversion, bad elements, bad starts, mechanisms and scales."""

from __future__ import annotations

from collections.abc import Sequence

NAMES = ("deformed", "crushed", "elements", "starts", "unstable", "scales")


def main(quick: bool = False, only: Sequence[str] = (), out: str | None = None) -> int:
    """the table of hard cases: plain Newton, the clamped one, the default and the default with the volume term, and who was right"""
    from .study import run

    return run(only or NAMES, quick, out)


__all__ = ["NAMES", "main"]
