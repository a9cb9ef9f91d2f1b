"""Fewer unknowns and fewer dimensions: reduced models against full ones, membranes and cables against closed forms."""

from __future__ import annotations

from collections.abc import Sequence

NAMES = ("statics", "motion", "energy", "costs")


def main(quick: bool = False, only: Sequence[str] = (), out: str | None = None) -> int:
    """reduced models against full ones: error against size at rest and in motion, energy that is kept, time and memory"""
    from .studies import run

    return run(only or NAMES, quick, out)


__all__ = ["NAMES", "main"]
