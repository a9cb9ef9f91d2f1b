"""Files of a precomputed response: each solve as it is found, and the table that is made of them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from ..arguments import Array
from ..results.archive import Checkpoint, CheckpointHeader, NotOurs, finite, read_archive, write_archive
from ..system.signature import Fingerprint
from .handle_solves import HandleState

POINT, TABLE = ("point of a precomputed response of skfem-stvk", 1), ("precomputed response of skfem-stvk", 1)
FILES = "point_*.npz"
Count = Annotated[int, Field(ge=0)]


class PointHeader(CheckpointHeader):
    """The header of a file of one point: its number, and what `HandleState` says in words."""

    number: Count
    message: str
    warning: str


class TableHeader(CheckpointHeader):
    """The header of the file of a table: what is not in its arrays."""

    holes: dict[str, str]
    compression: Annotated[float, Field(ge=0)]
    unsolved: list[str]


class PointsCheckpoint(Checkpoint[PointHeader]):
    """A folder with a file for each solve of a grid: what is there is not solved again, `kept` by number."""

    known = POINT
    schema = PointHeader
    remedy = "Remove it: its point is solved anew then."

    def __init__(self, folder: Path, problem: Fingerprint, size: tuple[int, int], last: int) -> None:
        super().__init__(folder)
        self.problem, self._size, self._last = problem, size, last
        self.kept: dict[int, HandleState] = {}

    def opened(self) -> None:
        for file in sorted(self.folder.glob(FILES)):
            header, arrays = self.read_file(file)
            self.problem.refuse_other(header.problem, file, "Name another folder, or remove what is there.")
            try:
                if header.number > self._last or file.name != _name(header.number):
                    raise ValueError(f"it is of point {header.number}, of {self._last + 1}")
                u, force = (finite(arrays, name, (n,)) for name, n in zip(("u", "force"), self._size, strict=True))
            except (ValueError, KeyError) as error:
                raise NotOurs(f"{file} is damaged: {error.args[0]}. {self.remedy}") from None
            self.kept[header.number] = HandleState(u, force, header.message, header.warning)

    def add(self, number: int, state: HandleState) -> None:
        """Write a state."""
        about = {"number": number, "message": state.message, "warning": state.warning}
        self.write_file(self.folder / _name(number), about, {"u": state.u, "force": state.force})


def _name(number: int) -> str:
    return f"point_{number:06d}.npz"


def write_table(path: Path, problem: Fingerprint, about: dict[str, Any], arrays: dict[str, Array]) -> None:
    """Replace the file of a table."""
    write_archive(path, {"format": TABLE[0], "version": TABLE[1], **about, "problem": problem.signature.model_dump()}, arrays)


def read_table(path: Path) -> tuple[TableHeader, dict[str, Array]]:
    """Header and arrays of the file of a table."""
    return read_archive(path, TableHeader, TABLE, "Compute it anew.")
