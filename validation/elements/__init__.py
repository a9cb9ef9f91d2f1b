"""Elements: orders of convergence, cost for a given precision, and the flag with quadratic triangles."""

from __future__ import annotations

from collections.abc import Sequence

from ..study import run

#: Modules and functions of the studies by name.
STUDIES = {
    "orders": "orders.orders",
    "work-precision": "work_precision.work_precision",
    "turek-hron": "flag.flag_of_quadratic_triangles",
    "costs": "costs.costs",
}
NAMES = tuple(STUDIES)


def main(quick: bool = False, only: Sequence[str] = (), out: str | None = None) -> int:
    """Measure orders, work-precision and costs of all elements; the flag with quadratic triangles."""
    return run(__name__, STUDIES, only or NAMES, quick, out)


__all__ = ["NAMES", "STUDIES", "main"]
