"""Files of reduced systems and of precomputed responses: bases, each solve of a grid as it is found, and the complete table."""

from __future__ import annotations

from dataclasses import dataclass
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


@dataclass(frozen=True)
class SavedTable:
    """Record of the table of a response."""

    __pydantic_config__: ClassVar[dict[str, Any]] = STRICT

    axes: list[Numbers]
    nodes: Ids
    table: Annotated[Array, Stored(None)]
    basis: Annotated[Array, Stored(2, (np.float32, np.float64))]
    solved: Annotated[Array, Stored(None, (np.bool_,))]
    error_points: Matrix
    error_force: Numbers
    error_u: Numbers
    holes: dict[str, str]
    compression: Annotated[float, Within(0.0)]
    unsolved: list[str]

    def check(self, nv: int, d: int) -> None:
        """Raise ValueError if this cannot be a table on a mesh with `nv` nodes in `d` dimensions."""
        nodes, shape = self.nodes, tuple(map(len, self.axes))
        if len(nodes) == 0 or len(np.unique(nodes)) < len(nodes) or nodes.min() < 0 or nodes.max() >= nv:
            raise ValueError(f"the array 'nodes' does not hold different numbers of nodes from 0 to {nv - 1}")
        if len(shape) != d or any(len(axis) == 0 or (np.diff(axis) <= 0).any() for axis in self.axes):
            raise ValueError("the displacements of an axis are not ascending")
        count = len(self.error_points)
        expected = {
            "table": (*shape, d + self.basis.shape[1]),
            "basis": (nv * d, self.basis.shape[1]),
            "solved": shape,
            "error_points": (count, d),
            "error_force": (count,),
            "error_u": (count,),
        }
        for name, size in expected.items():
            if (got := getattr(self, name).shape) != size:
                raise ValueError(f"the array '{name}' has shape {got}; expected {size}")
        if self.holes.keys() != set(map(str, np.flatnonzero(~self.solved))) or not all(self.holes.values()):
            raise ValueError("the holes in its header are not those of the array 'solved'")


class TableFile(Store[SavedTable]):
    """File of the table of a response."""

    known, schema = ("precomputed response of skfem-stvk", 1), SavedTable
    remedy = "Compute it again."
