"""Refusal of analyses that need the whole body on one machine."""

from __future__ import annotations

from ..errors import StvkError
from ..space import Space


def refuse_divided(space: Space, what: str, expected: str, reason: str) -> None:
    """Refuse an analysis or an option `what` of a body that is divided into parts, with the expected value and the reason.

    >>> refuse_divided(Space(3), "stability = True", "False", "K is not factorised.")
    """
    if space.divided:
        raise StvkError(f"{what}; expected {expected} for a body that is divided into parts: {reason}")
