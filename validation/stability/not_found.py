"""Error of a study whose subject was not found."""

from __future__ import annotations


class NotFoundError(RuntimeError):
    """Missing limit point, bifurcation or equilibrium."""
