"""Bodies that analyses accept: a `System`, or a reduced body made of one."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

from ..arguments import shown
from ..errors import StvkError
from .coordinates import Coordinates
from .divided import refuse_divided
from .system import System


@runtime_checkable
class ReducedLike(Protocol):
    """Body with displacements in a few coordinates, which `solve_static` and `simulate` accept like a `System`."""

    @property
    def in_coordinates(self) -> Coordinates:
        """Body in coordinates, the form that equations use.

        Its `system` is the full body, and results are on the mesh of that body.
        """


def checked_system(system: Any, name: str = "system") -> System:
    """Return the system; raise StvkError, with `name`, for any other object."""
    if not isinstance(system, System):
        raise StvkError(f"{name} = {shown(system)}; expected a System: System(mesh, terms, fixed=..., prescribed=...).")
    return system


def checked_whole(system: Any, analysis: str, name: str = "system") -> System:
    """Return the system as `checked_system` does; refuse a body that is divided into parts, for this `analysis`."""
    system = checked_system(system, name)
    factors = "it needs all elements, or factors of the whole K, which no part has."
    refuse_divided(system.space.comm, analysis, "a body on one machine", factors)
    return system
