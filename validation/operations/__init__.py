"""Operation counts of F and K by edges and by elements, from instrumented runs, and times of the same sources."""

from __future__ import annotations


def main(quick: bool = False) -> int:
    """Count and time operations of F and K: by edges, elements (Total Lagrangian, O'Brien-Hodgins) and Picinbono's polynomial."""
    from .table import show  # this import compiles the sources if Numba is installed

    return show(quick)


__all__ = ["main"]
