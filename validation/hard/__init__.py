"""Hard cases: limit points, inversion, bad elements, bad starts, mechanisms, extreme scales; and bodies in motion."""

from __future__ import annotations

from collections.abc import Sequence

#: Names of the files with cases at rest, and of the table of motions.
NAMES = ("deformed", "crushed", "elements", "starts", "unstable", "slender", "slack", "scales", "motion")


def main(quick: bool = False, only: Sequence[str] = (), out: str | None = None) -> int:
    """Judge methods on hard cases at rest (plain Newton, clamped, default, volume term) and in motion (all integrators)."""
    from .study import run

    return run(only or NAMES, quick, out)


__all__ = ["NAMES", "main"]
