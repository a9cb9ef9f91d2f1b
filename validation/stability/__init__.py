"""Limit points, buckling and the law's own limits against closed forms."""

from __future__ import annotations

from collections.abc import Sequence

from ..study import run

#: Modules and functions of the studies by name.
STUDIES = {
    "snap-through": "snap_through.snap_through",
    "column": "column.column",
    "post-buckling": "post_buckling.post_buckling",
    "law": "law.law",
}
NAMES = tuple(STUDIES)


def main(quick: bool = False, only: Sequence[str] = ()) -> int:
    """Compare limit points and buckling with closed forms."""
    return run(__name__, STUDIES, only or NAMES, quick)


__all__ = ["NAMES", "STUDIES", "main"]
