"""Files of reduced systems and of precomputed responses: bases, each solve of a grid as it is found, and the complete table."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeAlias

import numpy as np

from ...arguments import Array
from ...npz import Count, Ids, Numbers, Stored, Within
from ...results.complete_files import output_folder
from ...system.signature import Fingerprint
from ..runs.archive import STRICT, FolderStore, Store, refusing_damage
from .handle_solves import HandleState

Matrix: TypeAlias = Annotated[Array, Stored(2)]


@dataclass(frozen=True)
class SavedReduced:
    """Record of a reduced system: its fields and coefficients."""

    __pydantic_config__: ClassVar[dict[str, Any]] = STRICT

    basis: Matrix
    lifts: Matrix
    T: Numbers


class ReducedFile(Store[SavedReduced]):
    """File of a reduced system."""

    known, schema = ("reduced body of skfem-stvk", 1), SavedReduced
    remedy = "Reduce the body again: ReducedSystem(body, ...)."


@dataclass(frozen=True)
class SavedPoint:
    """Record of one point of a grid, by its number."""

    __pydantic_config__: ClassVar[dict[str, Any]] = STRICT

    number: Count
    state: HandleState


class PointsCheckpoint(FolderStore[SavedPoint]):
    """Folder with a file for each solve of a grid: its states, `stored` by number, are not solved again."""

    known, name, schema = ("point of a precomputed response of skfem-stvk", 1), "point_{:06d}.npz", SavedPoint
    remedy = "Remove it, so that its point is solved again."

    def __init__(self, folder: Path, problem: Fingerprint, size: tuple[int, int], last: int) -> None:
        super().__init__(output_folder(folder))
        self.problem, self._size, self._last = problem, size, last
        self.stored: dict[int, HandleState] = {}

    def opened(self) -> None:
        for file in self.existing():
            saved = self.read_own(file, "Name another folder, or remove its files.")
            with refusing_damage(file, self.remedy):
                if saved.number > self._last or file != self.numbered(saved.number):
                    raise ValueError(f"its number is {saved.number}; expected that of its name, at most {self._last}")
                if (saved.state.u.size, saved.state.force.size) != self._size:
                    raise ValueError(f"its state has {saved.state.u.size} displacements; expected {self._size[0]}")
            self.stored[saved.number] = saved.state

    def add(self, number: int, state: HandleState) -> None:
        """Write a state."""
        self.write(self.numbered(number), SavedPoint(number, state))


@dataclass(frozen=True, eq=False)
class BetweenPoints:
    """Errors of the answers in the middle of cells, from solves outside the table.

    Attributes
    ----------
    points
        (m, d) displacements of the handle of these solves [m].
    force
        (m,) error of the force, as a fraction of the largest force in the table.
    u
        (m,) largest error of a node's displacement, as a fraction of the largest displacement in the table.
    unsolved
        Messages on midpoints without a stable equilibrium.
    """

    points: Matrix
    force: Numbers
    u: Numbers
    unsolved: list[str] = field(default_factory=list)

    @property
    def largest_force(self) -> float:
        """Largest error of a force; NaN without a measurement."""
        return float(self.force.max()) if len(self.force) else float("nan")

    @property
    def largest_u(self) -> float:
        """Largest error of displacements; NaN without a measurement."""
        return float(self.u.max()) if len(self.u) else float("nan")

    def __str__(self) -> str:
        if not len(self.points):
            return "errors between points were not measured"
        at_force, at_u = (point_text(self.points[int(np.argmax(errors))]) for errors in (self.force, self.u))
        lost = f"; {len(self.unsolved)} more have no stable equilibrium: {self.unsolved[0]}" if self.unsolved else ""
        return (
            f"at {len(self.points)} midpoints wrong by at most {self.largest_force:.2g} of the largest force, at {at_force}, and "
            f"{self.largest_u:.2g} of the largest displacement, at {at_u}{lost}"
        )


@dataclass(frozen=True)
class ResponseTable:
    """Table of a precomputed response: forces and amounts of the basis at each point of the grid, and reasons of its holes."""

    __pydantic_config__: ClassVar[dict[str, Any]] = STRICT

    axes: list[Numbers]
    nodes: Ids
    values: Annotated[Array, Stored(None)]
    basis: Annotated[Array, Stored(2, (np.float32, np.float64))]
    holes: dict[str, str]
    compression: Annotated[float, Within(0.0)]
    error: BetweenPoints = field(default_factory=lambda: BetweenPoints(np.empty((0, 1)), np.empty(0), np.empty(0)))

    def check(self, nv: int, d: int) -> None:
        """Raise ValueError if this cannot be a table on a mesh with `nv` nodes in `d` dimensions."""
        nodes, shape, count = self.nodes, tuple(map(len, self.axes)), len(self.error.points)
        if len(nodes) == 0 or len(np.unique(nodes)) < len(nodes) or nodes.min() < 0 or nodes.max() >= nv:
            raise ValueError(f"the array 'nodes' does not hold different numbers of nodes from 0 to {nv - 1}")
        if len(shape) != d or any(len(axis) == 0 or (np.diff(axis) <= 0).any() for axis in self.axes):
            raise ValueError("the displacements of an axis are not ascending")
        expected = (*shape, d + self.basis.shape[1]), (nv * d, self.basis.shape[1]), (count, d), (count,), (count,)
        arrays = self.values, self.basis, self.error.points, self.error.force, self.error.u
        if (got := tuple(array.shape for array in arrays)) != expected:
            raise ValueError(f"its arrays have shapes {got}; expected {expected}")
        if not all(self.holes.values()) or not self.holes.keys() <= set(map(str, range(self.values[..., 0].size))):
            raise ValueError("the holes in its header are not those of the grid")


class TableFile(Store[ResponseTable]):
    """File of the table of a response."""

    known, schema = ("precomputed response of skfem-stvk", 1), ResponseTable
    remedy = "Compute it again."


def point_text(point: Array | tuple[float, ...]) -> str:
    """Return a displacement as text."""
    return f"({', '.join(f'{one:.4g}' for one in point)})"
