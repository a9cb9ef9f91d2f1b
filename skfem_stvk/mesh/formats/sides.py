"""Sides of elements in files that name them by element and number: facets, and whole elements, as cells with sets."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import meshio
import numpy as np
from numpy.typing import NDArray

Ids = NDArray[np.int64]
#: Nodes (n, m) of facets by their type in meshio's terms, and 'elements' by their ascending indices in the file.
Sides = dict[str, Ids]
#: Types of facets in meshio's terms by their number of corners.
FACETS = {2: "line", 3: "triangle", 4: "quad"}
#: Names for meshio of cells of second order that it does not know.
LAGRANGE = {"wedge15": "VTK_LAGRANGE_WEDGE", "pyramid13": "VTK_LAGRANGE_PYRAMID"}
NO_IDS = np.empty(0, dtype=np.int64)


class CellsOfFile(NamedTuple):
    """Elements of one type: their type in meshio's terms, the index of the first one in the file, and their nodes (n, m)."""

    kind: str
    first: int
    cells: Ids

    @property
    def family(self) -> str:
        """Kind without the number of nodes."""
        return self.kind.rstrip("0123456789")

    def sides(self, rows: Ids, corners: tuple[int, ...]) -> Sides:
        """Return the side of some elements that has these corners, by local numbers from 1."""
        return {FACETS[len(corners)]: self.cells[rows][:, np.array(corners) - 1]}


def parts_of(blocks: list[CellsOfFile], elements: Ids) -> Iterator[tuple[CellsOfFile, Ids]]:
    """Yield each block that has some of the elements, which ascend, with its rows of these."""
    for block in blocks:
        if (inside := within(block, elements)).size:
            yield block, inside


def within(block: CellsOfFile, elements: Ids) -> Ids:
    """Return the rows in a block of the elements, which ascend, that are in it."""
    return elements[slice(*np.searchsorted(elements, [block.first, block.first + len(block.cells)]))] - block.first


def joined(parts: list[Sides]) -> Sides:
    """Return the facets of all parts by type, and their elements, ascending."""
    found = {kind: np.concatenate([part[kind] for part in parts if kind in part]) for part in parts for kind in part}
    return {kind: np.unique(ids) if kind == "elements" else ids for kind, ids in found.items()}


def mesh_of(
    points: NDArray[np.float64], blocks: list[CellsOfFile], node_sets: Mapping[str, Ids], places: Mapping[str, Sides]
) -> meshio.Mesh:
    """Return a mesh with the places, by name, as sets of cells: of the elements, and of facets, which are added as cells."""
    cells = [(LAGRANGE.get(block.kind, block.kind), block.cells) for block in blocks]
    sets = {name: [within(block, sides.get("elements", NO_IDS)) for block in blocks] for name, sides in places.items()}
    for kind in FACETS.values():
        tables = {name: sides[kind] for name, sides in places.items() if len(sides.get(kind, NO_IDS))}
        if tables:
            ends = np.cumsum([0, *map(len, tables.values())])
            ranges = dict(zip(tables, map(np.arange, ends[:-1], ends[1:]), strict=True))
            cells.append((kind, np.concatenate(list(tables.values()))))
            for name, of_blocks in sets.items():
                of_blocks.append(ranges.get(name, NO_IDS))
    return meshio.Mesh(points, cells, point_sets=dict(node_sets), cell_sets=sets)
