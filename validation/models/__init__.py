"""Models of the overview on one bar and one body: error, speed, memory and stable step of each."""

from __future__ import annotations

from collections.abc import Sequence

from ..study import run

#: Modules and functions of the studies by name.
STUDIES = {
    "bent": "studies.bent",
    "twisted": "studies.twisted",
    "released": "studies.released",
    "thrown": "studies.thrown",
    "costs": "studies.costs",
}
NAMES = tuple(STUDIES)


def main(quick: bool = False, only: Sequence[str] = ()) -> int:
    """Compare models on a bar, bent, twisted, released and thrown: linear, springs, corotated, StVK, invertible, neo-Hookean."""
    return run(__name__, STUDIES, only or NAMES, quick)


__all__ = ["NAMES", "STUDIES", "main"]
