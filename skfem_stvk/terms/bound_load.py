"""Loads before there is a body, and their abilities on one."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar, TypeGuard

from ..arguments import Array, own
from ..edges import NodeBlocks
from ..edges.bound_term import Bound, PlainBound
from ..mesh import ElementMesh
from .body import Body
from .loads.load import Time, Value, check_constants
from .term import TermOrLoad


class BoundLoad(Bound, ABC):
    """Load on a body at displacements `u` (nv, d) and load factor or time `t`.

    Attributes
    ----------
    has_potential
        Whether its force is minus the gradient of a potential; otherwise its stiffness is not symmetric.
    dead
        Whether its force does not depend on the displacements: its potential is linear in `u`, and it has no stiffness.
    steady
        Whether the load is constant in time, that is, not a function.
    """

    has_potential: bool = True
    dead: bool = True
    steady: bool = True

    @abstractmethod
    def potential(self, u: Array, t: Time) -> float:
        """Return the potential [J] of the load at `u` (nv, d); the force is `-d potential/du`."""

    @abstractmethod
    def add_force(self, u: Array, t: Time, out: Array) -> None:
        """Add the external force [N] to `out` (nv, d)."""

    def add_blocks(self, u: Array, t: Time, blocks: NodeBlocks) -> None:
        """Add the blocks of `-d force/du` [N/m] at `u` (nv, d); a dead load has none."""


class PlainLoad(PlainBound, BoundLoad):
    """Load of a user's class that does not inherit from `BoundLoad`."""

    def potential(self, u: Array, t: Time) -> float:
        return float(self.of.potential(u, t))

    def add_force(self, u: Array, t: Time, out: Array) -> None:
        self.of.add_force(u, t, out)


def bound_load(load: Any) -> BoundLoad:
    """Return the load with all members of `BoundLoad`."""
    return load if isinstance(load, BoundLoad) else PlainLoad(load)


class Load(TermOrLoad, ABC):
    """A load without a mesh, usable in many systems; as a dataclass it copies its arguments."""

    external: ClassVar[bool] = True
    #: Name of the attribute with its values, for loads that are checked before a mesh exists.
    given_by: ClassVar[str] = ""
    #: Whether it requires densities of the materials.
    needs_density: ClassVar[bool] = False
    #: Whether `where` selects elements if the mesh is a surface in space.
    on_elements: ClassVar[bool] = False

    def __post_init__(self) -> None:
        own(self)
        if self.given_by:
            check_constants(getattr(self, self.given_by), f"{type(self).__name__}: {self.given_by}")

    @abstractmethod
    def bind(self, body: Body) -> BoundLoad:
        """Return the load on this body; raise RegionError or LoadError if it does not apply there."""

    def value(self, mesh: ElementMesh, x: Array, what: str, shape: tuple[int, ...] | None = None) -> Value:
        """Return its values at the nodes `x` (d, n) as a function of time; by default components. Messages begin with `what`."""
        given, divided = getattr(self, self.given_by), mesh.space.comm.divided
        return Value(given, (mesh.d,) if shape is None else shape, x, what, name=self.given_by, divided=divided)


def is_load(term: Any) -> TypeGuard[Load]:
    """Return whether a term is an external load: a `Load`, or an object with a true attribute `external`."""
    return bool(getattr(term, "external", False))
