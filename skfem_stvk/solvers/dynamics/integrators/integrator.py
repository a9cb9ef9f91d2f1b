"""Interface of integrators: their options, their declared properties, and their steppers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from ....arguments import number
from ....linear import LinearSolver
from ....linear.dense import DenseSolver
from ...newton.stopwatch import Stopwatch
from ..motion import Motion
from ..record import Counts, HierarchyOrigin, MotionState

LINEAR_MOMENTUM, ANGULAR_MOMENTUM, ENERGY = "linear momentum", "angular momentum", "energy"


class StepFailed(Exception):
    """Error for a step that found no state. The message has the reason. The state is not changed."""


class Stepper(ABC):
    """Stepper of an integrator for one motion, with the arrays that it needs.

    Attributes
    ----------
    counts
        Iterations of its steps so far.
    watch
        Stopwatch of its steps.
    """

    def __init__(self, motion: Motion) -> None:
        self.motion, self.watch, self.counts = motion, Stopwatch("write"), Counts()

    @property
    def remark(self) -> str:
        """Remark on the steps so far, for the message of the run; empty by default."""
        return ""

    @property
    def solver(self) -> LinearSolver | DenseSolver | None:
        """Linear solver of the steps; None without one."""
        return None

    @property
    def origin(self) -> HierarchyOrigin | None:
        """Origin of multigrid's present hierarchy; None without one."""
        return None

    def rebuild(self, origin: HierarchyOrigin) -> None:  # noqa: B027
        """Build the hierarchy of multigrid that another run had."""

    @abstractmethod
    def start(self, state: MotionState) -> None:
        """Prepare for the first step from a state, and compute quantities that the state does not store.

        It is called again after elements were removed.
        """

    @abstractmethod
    def step(self, state: MotionState, t: float) -> None:
        """Advance the state to time `t`, in place. Raise StepFailed if no state is found, or StateError if numbers overflow."""

    def store_forces(self, before: MotionState, state: MotionState) -> None:
        """Store the forces of contacts and foundations on the body in the state, as the last step from `before` used them.

        By default they are those at its end.
        """
        self.motion.store_forces(state)

    @abstractmethod
    def strain_energy(self, state: MotionState) -> float:
        """Return the strain energy of the last state [J], of the terms that have one."""


@dataclass(frozen=True)
class Integrator(ABC):
    """Options of an integrator, frozen, and its properties with these options. The conformance tests check the properties.

    Attributes
    ----------
    dt
        Time step [s].
    order
        Order in `dt` of the error of displacements and velocities.
    conserves
        Quantities among "linear momentum", "angular momentum" and "energy" that a free body conserves, to round-off or to the
        tolerance of the solves.
    reversible
        Whether a step with opposite velocities leads back.
    explicit
        Whether it needs forces only, at steps below a limit.
    mean
        Whether forces are means over the step; otherwise they are those at its ends.
    conserves_reduced
        Value of `conserves` for a motion on the basis of a `ReducedSystem`, which is constrained and does not conserve momenta;
        None if the integrator does not support such motions.
    """

    order: ClassVar[int]
    conserves: ClassVar[frozenset[str]]
    reversible: ClassVar[bool]
    explicit: ClassVar[bool]
    mean: ClassVar[bool] = False
    conserves_reduced: ClassVar[frozenset[str] | None] = None

    dt: float | None

    @property
    def name(self) -> str:
        """Name of the integrator: that of its class."""
        return type(self).__name__

    @abstractmethod
    def stepper(self, motion: Motion) -> Stepper:
        """Return the stepper for this motion."""


def checked_step(dt: float | None, optional: bool = False) -> float | None:
    """Return a time step in double precision, because times are sums of it.

    Refuse values that are not numbers, or whose square overflows or underflows.
    """
    if dt is None and optional:
        return None
    step = number("dt", dt, f"a time step in seconds, a positive number{', or None for a stable one' * optional}", low=0.0)
    return number("dt", step, "a time step between 1e-150 s and 1e150 s: choose other units", low=1e-150, high=1e150)
