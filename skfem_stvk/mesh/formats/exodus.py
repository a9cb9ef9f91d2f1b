"""Exodus files (.e, .exo, .g, ...) of Cubit, MOOSE and libMesh, through netCDF4: blocks, side sets and node sets by name or ID."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import numpy as np

from ...errors import warn
from ..groups import node_count
from .sides import CellsOfFile, Ids, Sides, joined, mesh_of, parts_of
from .stream import CutOff, Damaged, check_known

#: Types of cells in meshio's terms by the beginning of Exodus' names of elements, and by their number of nodes.
KINDS = {
    **{name: {2: "line", 3: "line3"} for name in ("BAR", "BEAM", "TRUSS", "EDGE")},
    "TRI": {3: "triangle", 6: "triangle6"},
    **{name: {4: "quad", 8: "quad8", 9: "quad9"} for name in ("QUAD", "SHELL")},
    "TET": {4: "tetra", 10: "tetra10"},
    "HEX": {8: "hexahedron", 20: "hexahedron20", 27: "hexahedron27"},
    "WED": {6: "wedge", 15: "wedge15"},
    "PYR": {5: "pyramid", 13: "pyramid13"},
}
#: Elements without volume, which are left out with a note.
WITHOUT_VOLUME = ("SPHERE", "CIRCLE", "NODE", "POINT", "SPRING")
#: Nodes in VTK's order, where Exodus has another one: vertical edges before those on top, the centre before the faces.
ORDERS = {
    "hexahedron20": [*range(12), *range(16, 20), *range(12, 16)],
    "hexahedron27": [*range(12), *range(16, 20), *range(12, 16), 23, 24, 25, 26, 21, 22, 20],
    "wedge15": [*range(9), 12, 13, 14, 9, 10, 11],
}
#: Corners of the sides of a cell, from 1. Surface elements in space have two sides, 1 and 2, and edges from 3 on.
SIDES = {
    "triangle": ((1, 2), (2, 3), (3, 1)),
    "quad": ((1, 2), (2, 3), (3, 4), (4, 1)),
    "tetra": ((1, 2, 4), (2, 3, 4), (1, 4, 3), (1, 3, 2)),
    "hexahedron": ((1, 2, 6, 5), (2, 3, 7, 6), (3, 4, 8, 7), (1, 5, 8, 4), (1, 4, 3, 2), (5, 6, 7, 8)),
    "wedge": ((1, 2, 5, 4), (2, 3, 6, 5), (1, 4, 6, 3), (1, 3, 2), (4, 5, 6)),
    "pyramid": ((1, 2, 5), (2, 3, 5), (3, 4, 5), (1, 5, 4), (1, 4, 3, 2)),
}


def read(path: Path) -> meshio.Mesh:
    """Read nodes, blocks of elements as sets of cells, side sets as sets of facets, and node sets."""
    from netCDF4 import Dataset

    try:
        file = Dataset(path)
    except OSError as error:
        raise CutOff("it is not a netCDF file, or a part of one") from error
    with file:
        file.set_auto_mask(False)
        data = dict(file.variables)
        points = np.stack(
            [data[f"coord{x}"][:] for x in "xyz" if f"coord{x}" in data] if "coord" not in data else data["coord"][:], axis=-1
        )
        blocks, places, first = list[CellsOfFile](), dict[str, Sides](), 0
        for i, name in enumerate(names(data, "eb"), start=1):
            if f"connect{i}" not in data:
                continue  # a block without elements
            type, nodes = (
                data[f"connect{i}"].getncattr("elem_type").strip("\0 ").upper(),
                data[f"connect{i}"][:].astype(np.int64) - 1,
            )
            if type.startswith(WITHOUT_VOLUME):
                warn(f"{len(nodes)} {type} elements of the block {name!r} are left out: they have no volume.")
            else:
                blocks.append(block_of(type, first, nodes))
                places[name] = {"elements": first + np.arange(len(nodes))}
            first += len(nodes)
        for i, name in enumerate(names(data, "ss"), start=1):
            if f"elem_ss{i}" in data:
                elements, sides = data[f"elem_ss{i}"][:].astype(np.int64) - 1, data[f"side_ss{i}"][:]
                check_known(elements, np.arange(first), "element", f"Side set {name!r}")
                places[name] = joined([places.get(name, {}), sides_of(blocks, elements, sides, name, points.shape[1])])
        node_sets = {
            name: np.unique(data[f"node_ns{i}"][:]).astype(np.int64) - 1
            for i, name in enumerate(names(data, "ns"), start=1)
            if f"node_ns{i}" in data
        }
        for name, ids in node_sets.items():
            check_known(ids, np.arange(len(points)), "node", f"Node set {name!r}")
    return mesh_of(points, blocks, node_sets, places)


def names(data: dict[str, Any], of: str) -> list[str]:
    """Return the names of blocks (eb), side sets (ss) or node sets (ns).

    One without a name has its ID, and a block 'block_' and its index.
    """
    written = [
        bytes(row).partition(b"\0")[0].decode(errors="replace").strip() for row in data.get(f"{of}_names", np.empty((0, 0)))[:]
    ]
    ids = [str(number) for number in data[f"{of}_prop1"][:]] if f"{of}_prop1" in data else []
    count = max(
        len(written), len(ids), sum(name.startswith({"eb": "connect", "ss": "elem_ss", "ns": "node_ns"}[of]) for name in data)
    )
    written, ids = written + [""] * (count - len(written)), ids + [str(i + 1) for i in range(len(ids), count)]
    return [name or (f"block_{i}" if of == "eb" else id) for i, (name, id) in enumerate(zip(written, ids, strict=True), start=1)]


def block_of(type: str, first: int, nodes: Ids) -> CellsOfFile:
    """Return elements in VTK's order of nodes."""
    found = next((kinds for beginning, kinds in KINDS.items() if type.startswith(beginning)), {})
    if (kind := found.get(nodes.shape[1], "")) == "" or nodes.shape[1] != node_count(kind):
        raise Damaged(f"its elements {type} with {nodes.shape[1]} nodes are not read. Write the mesh without them")
    return CellsOfFile(kind, first, nodes[:, ORDERS[kind]] if kind in ORDERS else nodes)


def sides_of(blocks: list[CellsOfFile], elements: Ids, sides: Ids, name: str, d: int) -> Sides:
    """Return the facets, and the shells, of the sides with these numbers of elements."""
    parts: list[Sides] = []
    for number in np.unique(sides):
        for block, rows in parts_of(blocks, np.unique(elements[sides == number])):
            faces, shift = SIDES.get(block.family, ()), 2 if d == 3 and block.family in ("triangle", "quad") else 0
            if shift and number <= shift:
                parts.append({"elements": block.first + rows})
            elif shift < number <= shift + len(faces):
                parts.append(block.sides(rows, faces[number - 1 - shift]))
            else:
                raise Damaged(f"side set {name!r} has the side {number} of a {block.kind}, which has {shift + len(faces)} sides")
    return joined(parts)
