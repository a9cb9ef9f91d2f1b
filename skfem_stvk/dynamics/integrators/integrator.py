"""Integrators: their options, their promises, and the steps that they make."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from ...arguments import number
from ...nonlinear.stopwatch import Stopwatch
from ..motion import Motion
from ..record import Counts, HierarchyOrigin, MotionState

LINEAR_MOMENTUM, ANGULAR_MOMENTUM, ENERGY = "linear momentum", "angular momentum", "energy"


class StepFailed(Exception):
    """A step found no state; the message says why. The state is as it was before."""


class Stepper(ABC):
    """An integrator at work on one motion, with the arrays it needs.

    Attributes
    ----------
    energy : strain energy of the last state [J], of the terms that have one.
    counts : iterations that its steps took so far.
    watch : the stopwatch of its steps.
    """

    def __init__(self, motion: Motion) -> None:
        self.motion, self.watch, self.counts, self.energy = motion, Stopwatch("write"), Counts(), 0.0

    @property
    def remark(self) -> str:
        """A remark on the steps so far, for the message of the run; empty by default."""
        return ""

    @property
    def origin(self) -> HierarchyOrigin | None:
        """The origin of the hierarchy that multigrid keeps; None where there is none."""
        return None

    def rebuild(self, origin: HierarchyOrigin) -> None:  # noqa: B027
        """Build the hierarchy of multigrid again that another run kept."""

    @abstractmethod
    def start(self, state: MotionState) -> None:
        """Prepare for the first step from a state: what is not in it is computed. Again, after elements were taken out."""

    @abstractmethod
    def step(self, state: MotionState, t: float) -> None:
        """Go on to time `t`, in place; raises StepFailed if there is no state then, or StateError where numbers overflow."""


@dataclass(frozen=True)
class Integrator(ABC):
    """Options of an integrator, frozen, and what it promises with them: the conformance tests hold each one to that.

    Attributes
    ----------
    dt : time step [s].
    order : of the error in `dt`, of displacements and velocities.
    conserves : those of "linear momentum", "angular momentum" and "energy" that a free body keeps to round-off or to the tolerance
        of the solves.
    reversible : whether a step with opposite velocities leads back.
    explicit : whether it needs forces only, at steps below a limit.
    conserves_reduced : the same of a motion on the basis of a `ReducedSystem`, which is held and has no momenta to keep; None if it
        does not take one.
    """

    order: ClassVar[int]
    conserves: ClassVar[frozenset[str]]
    reversible: ClassVar[bool]
    explicit: ClassVar[bool]
    conserves_reduced: ClassVar[frozenset[str] | None] = None

    dt: float | None

    @property
    def name(self) -> str:
        """Name of the integrator: that of its class."""
        return type(self).__name__

    @abstractmethod
    def stepper(self, motion: Motion) -> Stepper:
        """An object that makes the steps of this motion."""


def checked_step(dt: float | None, optional: bool = False) -> float | None:
    """A time step in double precision, for times are sums of it; refuse one that is none, or whose square is no number."""
    if dt is None and optional:
        return None
    step = number("dt", dt, f"a time step in seconds, a positive number{', or None for a stable one' * optional}", low=0.0)
    return number("dt", step, "a time step between 1e-150 s and 1e150 s: choose other units", low=1e-150, high=1e150)
