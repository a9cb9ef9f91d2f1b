"""Motion in time: integrators against published motions, closed forms and independent references, and costs."""

from __future__ import annotations

from collections.abc import Sequence

NAMES = (
    *("independent", "csm3", "flight", "vibrations", "limit", "large-steps", "fast-swings", "blow-ups", "tangents"),
    *("work-precision", "speed", "step-solvers"),
)


def main(quick: bool = False, only: Sequence[str] = (), out: str | None = None) -> int:
    """Compare integrators with published motions, eigenfrequencies and references; stability limits, work-precision, speed."""
    from .studies import run

    return run(only or NAMES, quick, out)


__all__ = ["NAMES", "main"]
