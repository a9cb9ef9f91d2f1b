"""Which of the tensions of edges stay in the tangent stiffness."""

from __future__ import annotations

from typing import NamedTuple


class Tensions(NamedTuple):
    """Factors of the tensions of edges in `K = 2 J' L J + sum_ab g_ab t_ab Lap_ab (x) I`, `g` that of the sign of `t`.

    The forces are not touched by them. The pressure of a `VolumePenalty` counts as a negative tension.

        ALL         the exact tangent
        TENSILE     clamped: without negative tensions, positive semi-definite
        NONE        Gauss-Newton, `2 J' L J`: positive semi-definite

    Attributes
    ----------
    positive, negative : factors of tensions `t > 0` and `t < 0`.

    >>> Tensions(1.0, 0.0) == TENSILE
    True
    """

    positive: float
    negative: float


ALL = Tensions(1.0, 1.0)
TENSILE = Tensions(1.0, 0.0)
NONE = Tensions(0.0, 0.0)
