"""Operations of F and of K by edges and by elements: counted, not quoted; and the times of the same sources."""

from __future__ import annotations


def main(quick: bool = False) -> int:
    """operations and times of F and K by edges, by elements (Total Lagrangian, O'Brien-Hodgins) and by Picinbono's polynomial"""
    from .table import show  # which compiles, where Numba is there

    return show(quick)


__all__ = ["main"]
