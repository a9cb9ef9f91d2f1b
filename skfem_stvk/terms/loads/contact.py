"""Contacts: their friction, their specification, and what the package asks of one on a body."""

from __future__ import annotations

from abc import abstractmethod
from copy import copy
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...arguments import Array, Quantity, Specification, number, own, shown, text
from ...edges.bound_term import BoundTerm
from ...errors import ContactError, StvkError
from ..term import Term
from .rigid_shapes import RigidShape

Own = TypeVar("Own", bound="BoundContact")


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


class Contact(Specification, Term):
    """Specification of a contact, with a name, friction, and a stiffness that the materials give by default.

    Attributes
    ----------
    unit
        Unit of the stiffness.
    """

    error: ClassVar[type[StvkError]] = ContactError
    on_elements: ClassVar[bool] = True
    unit: ClassVar[str]
    name: str
    friction: Friction | None
    stiffness: float | None

    def __post_init__(self) -> None:
        own(self)
        kind = type(self).__name__
        if not isinstance(self.friction, Friction | None):
            raise ContactError(f"{kind}: friction = {shown(self.friction)}; expected Friction(...), or None.")
        object.__setattr__(self, "name", text(f"{kind}: name", self.name))
        if self.stiffness is not None:
            expected = f"a positive number [{self.unit}]"
            k = number(f"{self.label}: stiffness", self.stiffness, expected, 0.0, error=ContactError)
            object.__setattr__(self, "stiffness", k)

    @property
    def label(self) -> str:
        """Beginning of messages."""
        return f"{type(self).__name__} {self.name!r}"


class BoundContact(BoundTerm):
    """Forces where the surface of a body touches something. They join no nodes, and have a discrete gradient.

    Attributes
    ----------
    name
        Name in results and messages.
    distance
        Distance below which surfaces repel each other [m]; infinite for contacts without a barrier.
    nodes
        Nodes (m,) on which its resultant acts.
    is_barrier
        Whether its energy is infinite where surfaces meet, so that steps need Newton's method with a line search.
    does_work
        Whether it does work on the body by its motion, or dissipates energy by friction.
    has_friction
        Whether it dissipates energy by friction.
    """

    takes_time = has_mean_force = True
    balanced = False
    is_barrier: bool = False
    distance: float = np.inf
    does_work: bool = False
    has_friction: bool = False
    nodes_joined = np.empty((2, 0), dtype=np.int32)
    name: str

    @property
    def shape(self) -> RigidShape | None:
        """Rigid shape into which points go, displaced as at its time; None without one."""
        return None

    @abstractmethod
    def identity(self) -> list[float]:
        """Return numbers that differ from those of another contact, for checkpoints."""

    @abstractmethod
    def evaluated(self, u: Array) -> tuple[Array, Array, float]:
        """Return pressure (nv,) [Pa] and smallest gap (nv,) [m] at nodes for `u` (nv, d), and the area [m^2] that touches."""

    def smallest_gap(self, u: Array) -> float:
        """Return the smallest gap [m] at `u` (nv, d), negative where a point is in a shape."""
        return float(self.evaluated(u)[1].min())

    @abstractmethod
    def held_directions(self, u: Array) -> tuple[NDArray[np.int64], Array]:
        """Return nodes (m,) that touch at `u` (nv, d), and unit vectors (m, d) along which the contact holds them."""

    @abstractmethod
    def contact_limit(self, u: Array, v: Array) -> float:
        """Return the largest `s` up to which nothing passes through anything on the way `u + s v`, or infinity."""

    @abstractmethod
    def passes(self, u0: Array, u1: Array) -> bool:
        """Return whether something passes through something on the way from `u0` to `u1` (nv, d) over the present step."""

    @abstractmethod
    def refuse_start(self, u: Array) -> None:
        """Raise ContactError if surfaces intersect at `u` (nv, d), lie inside each other or on the wrong side."""

    def work(self, u0: Array, u1: Array) -> tuple[float, float]:
        """Return the work [J] on the body, and the dissipated energy, over the step from `u0` (nv, d) to `u1`."""
        return 0.0, 0.0

    def missing_friction(self, u: Array) -> tuple[Array, float]:
        """Return the friction at `u` with the normal forces there, less that with those of the last state, and the largest [N]."""
        return np.zeros((0, u.shape[1])), 0.0

    def drag(self, u: Array) -> Array:
        """Return the largest friction per speed (nv,) [N s/m] of each node in a step from `u` (nv, d), for explicit steps."""
        return np.zeros(len(u))

    def _with(self: Own, **parts: Any) -> Own:
        """Return the contact with other values of these attributes; it shares the others."""
        other = copy(self)
        vars(other).update(parts)
        return other
