"""Hard case in motion: a body, the duration and steps of its motion, and the right final state."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from skfem_stvk import System
from skfem_stvk.solvers.dynamics import Rayleigh

from ..case import Array, Case, Truth


@dataclass(frozen=True)
class Ending(Truth):
    """Right final state and energy of a body.

    Parameters
    ----------
    energy
        Function that returns the error of the energy of displacements and velocities relative to its maximum; None if the energy is
        not checked.
    """

    energy: Callable[[System, Array, Array], float] | None = None


@dataclass(frozen=True, kw_only=True)
class Scene(Case):
    """Row of the table; its `steps` are those of the methods with a given step.

    Parameters
    ----------
    truth, with_volume
        Right final states without and with the volume term.
    until
        Duration [s].
    damping
        Rayleigh damping; None for none.
    right
        Names of the methods that must be right if there is a right motion. The other methods may report a failure.
    """

    truth: Ending
    with_volume: Ending
    until: float
    damping: Rayleigh | None = None
    right: tuple[str, ...] = ("energy-momentum", "energy-momentum + volume")

    @property
    def dt(self) -> float:
        """Length of the steps [s]."""
        return self.until / self.steps
