"""Files of a precomputed response: each solve as it is found, and the table that is made of them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from ..arguments import Array
from ..results.archive import Checkpoint, CheckpointHeader, NotOurs, finite, read_archive, write_archive
from ..system.signature import Fingerprint
from .handle_solves import HandleState

POINT, TABLE = ("point of a precomputed response of skfem-stvk", 1), ("precomputed response of skfem-stvk", 1)
FILES = "point_*.npz"
REMEDY = "Compute it again."
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
    header, arrays = read_archive(path, TableHeader, TABLE, REMEDY)
    with _damaged(path):
        _expect(arrays, "nodes", (np.int64,), (None,))
    return header, arrays


def check_table(path: Path, header: TableHeader, arrays: dict[str, Array], nv: int, d: int) -> None:
    """Refuse a file whose arrays cannot be those of a table on a mesh with `nv` nodes in `d` dimensions."""
    with _damaged(path):
        nodes = arrays["nodes"]
        if len(nodes) == 0 or len(np.unique(nodes)) < len(nodes) or nodes.min() < 0 or nodes.max() >= nv:
            raise ValueError(f"the array 'nodes' does not hold different numbers of nodes from 0 to {nv - 1}")
        axes = [_expect(arrays, f"axis {c}", (np.float64,), (None,)) for c in range(d)]
        if any(len(axis) == 0 or (np.diff(axis) <= 0).any() for axis in axes):
            raise ValueError("the displacements of an axis are not ascending")
        rank = _expect(arrays, "basis", (np.float32, np.float64), (nv * d, None)).shape[1]
        shape, count = tuple(map(len, axes)), len(_expect(arrays, "error points", (np.float64,), (None, d)))
        _expect(arrays, "table", (np.float64,), (*shape, d + rank))
        for name in ("error force", "error u"):
            _expect(arrays, name, (np.float64,), (count,))
        holes = np.flatnonzero(~_expect(arrays, "solved", (np.bool_,), shape))
        if header.holes.keys() != set(map(str, holes)) or not all(header.holes.values()):
            raise ValueError("the holes in its header are not those of the array 'solved'")


def _expect(arrays: dict[str, Array], name: str, types: tuple[type, ...], shape: tuple[int | None, ...]) -> Array:
    """Return the array of finite numbers of one of these types and of this shape, in which None stands for any length."""
    if name not in arrays:
        raise KeyError(f"it has no array '{name}'")
    array = arrays[name]
    fits = len(array.shape) == len(shape) and all(want in (None, got) for want, got in zip(shape, array.shape, strict=True))
    if array.dtype not in types or not fits or not np.isfinite(array).all():
        expected = f"{' or '.join(one.__name__ for one in types)} of shape {shape}".replace("None", "any")
        raise ValueError(f"the array '{name}' is {array.dtype} of shape {array.shape}; expected finite {expected}")
    return array


@contextmanager
def _damaged(path: Path) -> Iterator[None]:
    """Raise NotOurs with the path for a KeyError or a ValueError in words."""
    try:
        yield
    except (KeyError, ValueError) as error:
        raise NotOurs(f"{path} is damaged: {error.args[0]}. {REMEDY}") from None
