"""A hard case in motion: a body, how long it moves and in which steps, and where it has to be in the end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from skfem_stvk import System
from skfem_stvk.dynamics import Rayleigh

from ..case import Array, Case, Truth


@dataclass(frozen=True)
class Ending(Truth):
    """Where a body has to be in the end, with which energy.

    Parameters
    ----------
    energy : how far the energy of displacements and velocities is off, as a part of the largest there was; None where none is
        asked for.
    """

    energy: Callable[[System, Array, Array], float] | None = None


@dataclass(frozen=True, kw_only=True)
class Scene(Case):
    """A row of the table; its `steps` are those of the methods that take the same.

    Parameters
    ----------
    truth, with_volume : without and with the volume term.
    until : the end [s].
    damping : what acts besides.
    right : names of the methods that have to be right where there is a right motion; the others may say that they are not.
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
