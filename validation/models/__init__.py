"""The overview's models side by side: one bar and one body, under all of them, with error, speed, memory and stable step."""

from __future__ import annotations

from collections.abc import Sequence

NAMES = ("bent", "twisted", "released", "thrown", "recoveries", "random-starts", "costs")


def main(quick: bool = False, only: Sequence[str] = (), out: str | None = None) -> int:
    """one bar bent and twisted, released and thrown, under linear elements, springs, corotated, StVK, invertible, neo-Hookean"""
    from .studies import run

    return run(only or NAMES, quick, out)


__all__ = ["NAMES", "main"]
