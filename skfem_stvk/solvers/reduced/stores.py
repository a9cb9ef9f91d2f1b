"""Files of reduced systems and of precomputed responses: bases, each solve of a grid as it is found, and the complete table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import NonNegativeFloat, NonNegativeInt

from ...arguments import Array
from ...results.complete_files import output_folder
from ...results.store import FolderStore, Header, Store, expect, refusing_damage
from ...system.signature import Fingerprint
from .handle_solves import HandleState


class ReducedFile(Store[Header]):
    """File of a reduced system: its fields and coefficients."""

    known = "reduced body of skfem-stvk", 1
    schema = Header
    remedy = "Reduce the body again: ReducedSystem(body, ...)."


class PointHeader(Header):
    """Header of the file of one point: its number, and the messages of its `HandleState`."""

    number: NonNegativeInt
    message: str
    warning: str


class TableHeader(Header):
    """Header of the file of a table: all data except the arrays."""

    holes: dict[str, str]
    compression: NonNegativeFloat
    unsolved: list[str]


class PointsCheckpoint(FolderStore[PointHeader]):
    """Folder with a file for each solve of a grid: its states, `stored` by number, are not solved again."""

    known, name = ("point of a precomputed response of skfem-stvk", 1), "point_{:06d}.npz"
    schema = PointHeader
    remedy = "Remove it, so that its point is solved again."

    def __init__(self, folder: Path, problem: Fingerprint, size: tuple[int, int], last: int) -> None:
        super().__init__(output_folder(folder))
        self.problem, self._size, self._last = problem, size, last
        self.stored: dict[int, HandleState] = {}

    def opened(self) -> None:
        for file in self.existing():
            header, arrays = self.read_own(file, "Name another folder, or remove its files.")
            with refusing_damage(file, self.remedy):
                if header.number > self._last or file != self.numbered(header.number):
                    raise ValueError(f"its number is {header.number}; expected that of its name, at most {self._last}")
                u, force = (expect(arrays, name, (n,)) for name, n in zip(("u", "force"), self._size, strict=True))
            self.stored[header.number] = HandleState(u, force, header.message, header.warning)

    def add(self, number: int, state: HandleState) -> None:
        """Write a state."""
        about = {"number": number, "message": state.message, "warning": state.warning}
        self.write_file(self.numbered(number), self.problem, about, {"u": state.u, "force": state.force})


class TableFile(Store[TableHeader]):
    """File of the table of a response."""

    known = "precomputed response of skfem-stvk", 1
    schema = TableHeader
    remedy = "Compute it again."


def nodes_of(path: Path, arrays: dict[str, Array]) -> NDArray[np.int64]:
    """Return the nodes of the handle of a table."""
    with refusing_damage(path, TableFile.remedy):
        return expect(arrays, "nodes", (None,), (np.int64,))


def check_table(path: Path, header: TableHeader, arrays: dict[str, Array], nv: int, d: int) -> None:
    """Refuse a file whose arrays cannot be those of a table on a mesh with `nv` nodes in `d` dimensions."""
    with refusing_damage(path, TableFile.remedy):
        nodes = arrays["nodes"]
        if len(nodes) == 0 or len(np.unique(nodes)) < len(nodes) or nodes.min() < 0 or nodes.max() >= nv:
            raise ValueError(f"the array 'nodes' does not hold different numbers of nodes from 0 to {nv - 1}")
        axes = [expect(arrays, f"axis {c}", (None,)) for c in range(d)]
        if any(len(axis) == 0 or (np.diff(axis) <= 0).any() for axis in axes):
            raise ValueError("the displacements of an axis are not ascending")
        rank = expect(arrays, "basis", (nv * d, None), (np.float32, np.float64)).shape[1]
        shape, count = tuple(map(len, axes)), len(expect(arrays, "error points", (None, d)))
        expect(arrays, "table", (*shape, d + rank))
        for name in ("error force", "error u"):
            expect(arrays, name, (count,))
        holes = np.flatnonzero(~expect(arrays, "solved", shape, (np.bool_,)))
        if header.holes.keys() != set(map(str, holes)) or not all(header.holes.values()):
            raise ValueError("the holes in its header are not those of the array 'solved'")
