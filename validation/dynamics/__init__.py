"""Motion in time: integrators against published motions, closed forms and independent references, and what they cost."""

from __future__ import annotations

from collections.abc import Sequence

NAMES = (
    *("independent", "csm3", "flight", "vibrations", "limit", "large-steps", "fast-swings", "blow-ups", "tangents"),
    *("work-precision", "speed", "step-solvers"),
)


def main(quick: bool = False, only: Sequence[str] = (), out: str | None = None) -> int:
    """integrators against published motions, eigenfrequencies and independent references, their stability limits, work-precision"""
    from .studies import run

    return run(only or NAMES, quick, out)


__all__ = ["NAMES", "main"]
