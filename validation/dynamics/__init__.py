"""Motion in time: integrators against published motions, closed forms and independent references, and costs."""

from __future__ import annotations

from collections.abc import Sequence

from ..study import run

#: Modules and functions of the studies by name.
STUDIES = {
    "independent": "independent.independent",
    "csm3": "csm3.csm3",
    "flight": "flight.flight",
    "vibrations": "vibrations.vibrations",
    "work-precision": "work_precision.work_precision",
}
NAMES = tuple(STUDIES)


def main(quick: bool = False, only: Sequence[str] = (), out: str | None = None) -> int:
    """Compare integrators with published motions, eigenfrequencies and references; work-precision."""
    return run(__name__, STUDIES, only or NAMES, quick, out)


__all__ = ["NAMES", "STUDIES", "main"]
