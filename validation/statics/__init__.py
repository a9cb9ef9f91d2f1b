"""Static solves: comparison with closed forms and benchmarks, and cost."""

from __future__ import annotations

from collections.abc import Sequence

from ..study import run

#: Modules and functions of the studies by name.
STUDIES = {
    "homogeneous": "homogeneous.homogeneous",
    "turek-hron": "turek_hron.turek_hron",
    "manufactured": "manufactured.manufactured",
    "elastica": "elastica.elastica",
    "work-precision": "work_precision.work_precision",
}
NAMES = tuple(STUDIES)


def main(quick: bool = False, only: Sequence[str] = (), out: str | None = None) -> int:
    """Compare static solves with closed forms and benchmarks, and measure their speed."""
    return run(__name__, STUDIES, only or NAMES, quick, out)


__all__ = ["NAMES", "STUDIES", "main"]
