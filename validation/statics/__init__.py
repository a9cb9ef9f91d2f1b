"""Static solves: comparison with closed forms and benchmarks."""

from __future__ import annotations

from collections.abc import Sequence

from ..study import run

#: Modules and functions of the studies by name.
STUDIES = {
    "homogeneous": "homogeneous.homogeneous",
    "turek-hron": "turek_hron.turek_hron",
    "manufactured": "manufactured.manufactured",
    "elastica": "elastica.elastica",
}
NAMES = tuple(STUDIES)


def main(quick: bool = False, only: Sequence[str] = ()) -> int:
    """Compare static solves with closed forms and benchmarks."""
    return run(__name__, STUDIES, only or NAMES, quick)


__all__ = ["NAMES", "STUDIES", "main"]
