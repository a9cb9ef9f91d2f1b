"""What a study raises when what it is about is not there."""

from __future__ import annotations


class NotFoundError(RuntimeError):
    """A limit point, a bifurcation or an equilibrium was not found."""
