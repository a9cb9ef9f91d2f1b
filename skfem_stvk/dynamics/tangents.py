"""What stands in for the tangent stiffness in implicit integrators."""

from __future__ import annotations

from enum import Enum

from ..edges import ALL, NONE, TENSILE, Tensions


class Tangent(Enum):
    """By its name in an integrator's options.

    exact           K
    clamped         without negative tensions of edges: positive semi-definite
    gauss-newton    without any tension: 2 J'LJ
    diagonal        the diagonal blocks alone (Debunne 2001, Mueller 2001): no solve, but forces reach no further than a vertex a step
    rest            K(0), made and factorised once: wrong under rotation
    """

    EXACT = "exact"
    CLAMPED = "clamped"
    GAUSS_NEWTON = "gauss-newton"
    DIAGONAL = "diagonal"
    REST = "rest"

    @property
    def kept(self) -> Tensions:
        """The tensions that stay in it."""
        return {Tangent.CLAMPED: TENSILE, Tangent.GAUSS_NEWTON: NONE}.get(self, ALL)
