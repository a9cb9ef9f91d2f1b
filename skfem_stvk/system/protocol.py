"""Bodies that analyses accept: a `System`, or a reduced body made of one."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

from ..arguments import shown
from ..errors import StvkError
from .system import System


@runtime_checkable
class ReducedLike(Protocol):
    """A body whose displacements are those of a few coordinates, which `solve_static` and `simulate` accept like a `System`.

    `body` is the one with all its displacements; results are on its mesh. The problems are on the coordinates: `equilibrium(watch)`
    is a `statics.equilibrium.StaticProblem`, `motion(mass, damping)` a `dynamics.motion.Motion`. `signature` are a few numbers by
    which files know the basis again.
    """

    @property
    def body(self) -> System: ...
    @property
    def signature(self) -> list[float]: ...
    def equilibrium(self, watch: Any) -> Any: ...
    def motion(self, mass: str | None, damping: Any) -> Any: ...


def checked_system(system: Any) -> System:
    """Return the system; raise StvkError if it is none."""
    if not isinstance(system, System):
        raise StvkError(f"system = {shown(system)}; expected a System: System(mesh, terms, fixed=..., prescribed=...).")
    return system
