"""Coulomb friction of contacts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from ...arguments import Quantity, Specification, number
from ...errors import ContactError, StvkError


@dataclass(frozen=True)
class Friction(Specification):
    """Coulomb friction with a force that rises over a small slip: `coefficient N f1(slip/width)`, `f1(r) = r (2 - r)` up to 1.

    The slip is that since the last accepted state, across the normal there, relative to the shape. The normal force N is that of
    the last accepted state, so that friction lags behind by a step. Its stiffness is symmetric. In motions the width is
    `slip_speed` times the step: a body that sticks creeps slower than that. Explicit integrators take smaller steps where friction
    rises steeply, down to `mass slip_speed/(coefficient N)` of a node.

    Parameters
    ----------
    coefficient
        Coefficient of friction.
    slip_speed
        Speed up to which friction rises in motions [m/s].
    slip_length
        Slip up to which friction rises in statics, per step of the load [m].

    Raises
    ------
    ContactError
        if a value is not positive, or none of the two widths is given; by analyses that need the other one.

    Notes
    -----
    Source: the smoothing f1 is that of the IPC Toolkit (Li et al. 2020).

    Examples
    --------
    >>> Friction(0.3, slip_speed=1e-3).slip_length is None
    True
    """

    error: ClassVar[type[StvkError]] = ContactError

    coefficient: Annotated[float, Quantity(None, "Coefficient of friction.", gt=0)]
    slip_speed: Annotated[float | None, Quantity("velocity", "Speed up to which friction rises in motions.", gt=0)] = None
    slip_length: Annotated[float | None, Quantity("length", "Slip up to which friction rises in statics, per step.", gt=0)] = None

    def __post_init__(self) -> None:
        for name, unit in (("coefficient", ""), ("slip_speed", " [m/s]"), ("slip_length", " [m]")):
            given = getattr(self, name)
            if given is None and name != "coefficient":
                continue
            value = number(f"Friction: {name}", given, f"a positive number{unit}", 0.0, error=ContactError)
            object.__setattr__(self, name, value)
        if self.slip_speed is None and self.slip_length is None:
            raise ContactError(
                "Friction: neither slip_speed nor slip_length; expected slip_speed=... [m/s] for motions, such as a "
                "hundredth of the speed of sliding, or slip_length=... [m] for statics."
            )


def refuse_missing_width(friction: Friction, in_time: bool, label: str) -> None:
    """Raise ContactError if the width of a motion, or of statics, is not given; `label` begins the message."""
    if in_time and friction.slip_speed is None:
        raise ContactError(f"{label}: Friction(slip_speed=None) in a motion; expected slip_speed=... [m/s].")
    if not in_time and friction.slip_length is None:
        raise ContactError(f"{label}: Friction(slip_length=None) in statics; expected slip_length=... [m].")


def width_of(friction: Friction, duration: float, in_time: bool) -> float:
    """Return the slip up to which friction rises [m], over a step of this duration [s] or over a step of the load."""
    return (friction.slip_speed or 0.0) * max(duration, 0.0) if in_time else friction.slip_length or 0.0


def numbers_of(friction: Friction | None) -> tuple[float, float, float]:
    """Return the coefficient and both widths, with 0 for those that are not given."""
    return (0.0, 0.0, 0.0) if friction is None else (friction.coefficient, friction.slip_speed or 0.0, friction.slip_length or 0.0)
