"""Operation counts of F and K by edges and by elements, from instrumented runs."""

from __future__ import annotations


def main(quick: bool = False) -> int:
    """Count operations of F and K: by edges, elements (Total Lagrangian, O'Brien-Hodgins) and Picinbono's polynomial."""
    from .table import show

    return show(quick)


__all__ = ["main"]
