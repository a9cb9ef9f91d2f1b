"""Studies of limit points, buckling and loss of ellipticity against closed forms and independent solutions."""

from __future__ import annotations

from collections.abc import Sequence

NAMES = ("snap-through", "arch", "dome", "column", "corotated", "post-buckling", "law", "ellipticity")


def main(quick: bool = False, only: Sequence[str] = (), out: str | None = None) -> int:
    """compare limit points, bifurcations and loss of ellipticity with closed forms and independent solves; `--out` draws paths"""
    from .studies import run

    return run(only or NAMES, quick, out)


__all__ = ["NAMES", "main"]
