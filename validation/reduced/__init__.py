"""Studies of reduced models against full models, and of membranes and cables against closed forms."""

from __future__ import annotations

from collections.abc import Sequence

NAMES = ("statics", "motion", "energy", "costs", "cable", "net", "sphere", "disc", "wrinkles")


def main(quick: bool = False, only: Sequence[str] = (), out: str | None = None) -> int:
    """compare reduced models with full models in error, energy, time and memory, and membranes and cables with closed forms"""
    from .studies import run

    return run(only or NAMES, quick, out)


__all__ = ["NAMES", "main"]
