"""Hard cases: limit points, inversion, bad elements, bad starts, mechanisms, scales; and bodies in motion."""

from __future__ import annotations

from collections.abc import Sequence

#: Each a file of cases at rest, and the two tables of motions.
NAMES = ("deformed", "crushed", "elements", "starts", "unstable", "slender", "slack", "scales", "motion", "memory")


def main(quick: bool = False, only: Sequence[str] = (), out: str | None = None) -> int:
    """hard cases at rest (plain Newton, clamped, default, with the volume term) and in motion (all integrators): who was right"""
    from .study import run

    return run(only or NAMES, quick, out)


__all__ = ["NAMES", "main"]
