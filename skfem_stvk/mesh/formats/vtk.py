"""VTK's legacy files (.vtk) up to version 5.1, as text or binary; and the complete list of cells of VTK's files."""

from __future__ import annotations

import re
from pathlib import Path

import meshio
import numpy as np
from numpy.typing import NDArray

from ...arguments import Array
from ...errors import name_ids
from ..groups import node_count
from .stream import CutOff, Damaged, Source, check_last_line, count_of

#: Types of cells in meshio's words, by VTK's numbers.
VTK = {1: "vertex", 3: "line", 5: "triangle", 7: "polygon", 9: "quad", 10: "tetra", 12: "hexahedron", 13: "wedge", 14: "pyramid"}
VTK |= {21: "line3", 22: "triangle6", 23: "quad8", 24: "tetra10", 25: "hexahedron20", 28: "quad9", 29: "hexahedron27"}
VTK |= {
    8: "quad",
    11: "hexahedron",
    32: "wedge18",
    35: "line4",
    68: "VTK_LAGRANGE_CURVE",
    69: "VTK_LAGRANGE_TRIANGLE",
    70: "VTK_LAGRANGE_QUADRILATERAL",
}
VTK |= {71: "VTK_LAGRANGE_TETRAHEDRON", 72: "VTK_LAGRANGE_HEXAHEDRON", 73: "VTK_LAGRANGE_WEDGE", 74: "VTK_LAGRANGE_PYRAMID"}
#: NumPy's types for VTK's. vtkIdType is written with 32 bits.
TYPES = {"bit": "u1", "vtkidtype": "i4", "float": "f4", "double": "f8"}
for word, size in (("char", 1), ("short", 2), ("int", 4), ("long", 8)):
    TYPES |= {word: f"i{size}", f"unsigned_{word}": f"u{size}"}
    TYPES |= {f"vtktypeint{8 * size}": f"i{size}", f"vtktypeuint{8 * size}": f"u{size}"}
#: Datasets whose cells follow from their dimensions.
STRUCTURED = ("STRUCTURED_POINTS", "RECTILINEAR_GRID", "STRUCTURED_GRID")
#: Numbers per point or cell, for the attributes whose name determines it.
ATTRIBUTES = {"VECTORS": 3, "NORMALS": 3, "TENSORS": 9, "TENSORS6": 6, "GLOBAL_IDS": 1, "PEDIGREE_IDS": 1, "EDGE_FLAGS": 1}


def read(path: Path) -> meshio.Mesh:
    """Read a grid, or the faces and lines of polygons, with the cell data of numbers."""
    with Source(path) as source:
        if not source.line().startswith("# vtk DataFile Version"):
            raise Damaged("it does not begin with '# vtk DataFile Version'")
        source.raw_line()  # the title
        form = source.line().upper()
        if form not in ("ASCII", "BINARY"):
            raise Damaged(f"{form[:20]!r} was found; expected ASCII or BINARY")
        source.binary = form == "BINARY"
        return Grid(source).mesh()


class Grid:
    """A grid, section by section."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self.points: Array | None = None
        self.connectivity = self.ends = self.types = np.empty(0, dtype=np.int64)
        self.cell_data: dict[str, Array] = {}
        self.kind = ""
        self.sizes, self.axes = [0, 0, 0], dict[str, Array]()  # of a structured grid: its dimensions, and what places its points
        self.of = ""  # POINT_DATA or CELL_DATA
        self.count = 0

    def mesh(self) -> meshio.Mesh:
        seen = set()
        while line := self.source.line():
            words = line.split()
            word = words[0].upper()
            if word in ("POINTS", "CELLS", "CELL_TYPES", "POINT_DATA", "CELL_DATA"):
                if word in seen:
                    raise Damaged(f"{word} occurs twice")
                seen.add(word)
            if word in ("POINT_DATA", "CELL_DATA"):
                self.make_structured()
            self.section(word, words)
        self.make_structured()
        if self.points is None or (self.kind == "UNSTRUCTURED_GRID" and not {"CELLS", "CELL_TYPES"} <= seen):
            raise CutOff("POINTS, CELLS or CELL_TYPES are missing")
        if not self.source.binary:
            check_last_line(self.source.file)
        return mesh_of(self.points, self.connectivity, self.ends, self.types, self.cell_data)

    def section(self, word: str, words: list[str]) -> None:
        if word == "DATASET":
            self.kind = " ".join(words[1:]).upper()
            if self.kind not in ("UNSTRUCTURED_GRID", "POLYDATA", *STRUCTURED):
                raise Damaged(f"it holds a {self.kind[:40]}; expected a grid or POLYDATA")
        elif self.kind in STRUCTURED and word == "DIMENSIONS":
            self.sizes = [self.count_in(words, i, "points along an axis") for i in (1, 2, 3)]
        elif self.kind in STRUCTURED and word in ("ORIGIN", "SPACING", "ASPECT_RATIO"):
            self.axes["SPACING" if word == "ASPECT_RATIO" else word] = np.array([float(number) for number in words[1:4]])
        elif self.kind in STRUCTURED and word in ("X_COORDINATES", "Y_COORDINATES", "Z_COORDINATES"):
            self.axes[word[0]] = self.array(word, self.count_in(words, 1, "coordinates"), 1, words[2]).ravel()
        elif self.kind == "POLYDATA" and word in ("VERTICES", "LINES", "POLYGONS"):
            self.polygons(word, words)
        elif word == "POINTS":
            self.points = self.array("points", self.count_in(words, 1, "points"), 3, words[2])
        elif word == "CELLS":
            self.cells(self.count_in(words, 1, "cells"), self.count_in(words, 2, "numbers of cells"))
        elif word == "CELL_TYPES":
            self.types = self.array("types of cells", self.count_in(words, 1, "types of cells"), 1, "int").ravel()
        elif word in ("POINT_DATA", "CELL_DATA"):
            self.of, self.count = word, self.count_in(words, 1, "values")
            expected = len(self.types) if word == "CELL_DATA" else len(self.points if self.points is not None else ())
            if self.count != expected:
                raise Damaged(f"{word} declares {self.count} values for {expected} points or cells")
        elif word == "METADATA":
            while self.source.raw_line().strip():
                pass
        else:
            self.attribute(word, words)

    def polygons(self, word: str, words: list[str]) -> None:
        """Add the vertices, lines or faces of POLYDATA to its cells; lines and faces of several parts become all of them."""
        before, self.ends = (self.connectivity, self.ends, self.types), np.empty(0, dtype=np.int64)
        self.cells(self.count_in(words, 1, "cells"), self.count_in(words, 2, "numbers of cells"))
        sizes = np.diff(self.ends, prepend=0)
        if (bad := sizes[(sizes < 1) | (sizes > {"VERTICES": 1, "LINES": 2, "POLYGONS": 4}[word])]).size:
            raise Damaged(
                f"its {word} have a cell of {bad[0]} points, which is not read. Split it into "
                f"{'triangles' if word == 'POLYGONS' else 'parts'}"
            )
        shift = before[1][-1] if len(before[1]) else 0
        self.types = np.append(before[2], np.array([0, 1, 3, 5, 9])[sizes]).astype(np.int64)
        self.ends, self.connectivity = (
            np.append(before[1], self.ends + shift).astype(np.int64),
            np.append(before[0], self.connectivity),
        )

    def make_structured(self) -> None:
        """Make the points and the cells of a structured grid; points and cells count along x first."""
        if self.kind not in STRUCTURED or len(self.types):
            return
        x, y, z = (np.arange(size, dtype=np.float64) for size in self.sizes)
        if self.kind == "STRUCTURED_POINTS":
            origin, spacing = self.axes.get("ORIGIN", np.zeros(3)), self.axes.get("SPACING", np.ones(3))
            x, y, z = (o + h * n for o, h, n in zip(origin, spacing, (x, y, z), strict=True))
        elif self.kind == "RECTILINEAR_GRID":
            x, y, z = (self.axes.get(axis, np.empty(0)) for axis in "XYZ")
        if self.kind != "STRUCTURED_GRID":
            self.points = np.stack([values.ravel("F") for values in np.meshgrid(x, y, z, indexing="ij")], axis=1)
        if self.points is None or len(self.points) != np.prod(self.sizes) or not np.prod(self.sizes):
            raise Damaged(f"its DIMENSIONS are {self.sizes}, for {len(self.points if self.points is not None else ())} points")
        number = np.arange(len(self.points)).reshape(self.sizes, order="F")
        wide = [axis for axis in range(3) if self.sizes[axis] > 1]
        steps = [np.zeros(3, dtype=int)]
        for axis in wide:  # the corners of a line, a pixel or a voxel
            steps += [step + np.eye(3, dtype=int)[axis] for step in steps]
        cells = np.stack(
            [
                number[tuple(slice(s, n - (a in wide) + s) for a, (s, n) in enumerate(zip(step, self.sizes, strict=True)))].ravel(
                    "F"
                )
                for step in steps
            ],
            axis=1,
        )
        self.connectivity, self.ends = cells.ravel(), len(steps) * np.arange(1, len(cells) + 1)
        self.types = np.full(len(cells), {0: 1, 1: 3, 2: 8, 3: 11}[len(wide)])

    def count_in(self, words: list[str], index: int, what: str) -> int:
        """Return a count on the line of a section."""
        return count_of(words[index] if len(words) > index else "", what)

    def array(self, what: str, rows: int, columns: int, kind: str) -> Array:
        """Return numbers (rows, columns) of a type of VTK's."""
        kind = kind.lower()
        if kind not in TYPES:
            raise Damaged(f"its {what[:60]} are of the type {kind[:40]!r}, which is not supported")
        dtype = np.dtype(TYPES[kind])
        if kind == "bit" and self.source.binary:
            packed = self.source.numbers(what, (rows * columns + 7) // 8, 1, dtype)
            return np.unpackbits(packed)[: rows * columns].reshape(rows, columns)
        if not self.source.binary:
            wide = {"f": np.float64, "i": np.int64, "u": np.int64}[dtype.kind]
            return self.source.numbers(what, rows, columns, wide)
        return self.source.numbers(what, rows, columns, dtype.newbyteorder(">")).astype(dtype)

    def cells(self, count: int, numbers: int) -> None:
        """Read the cells: in version 5.1 from offsets and connectivity, in earlier ones from rows that begin with their length."""
        start = self.source.file.tell()
        line = self.source.line().split()
        if line[:1] == ["OFFSETS"] and len(line) == 2:
            ends = self.array("offsets", count, 1, line[1]).ravel()
            line = self.source.line().split()
            if line[:1] != ["CONNECTIVITY"] or len(line) != 2 or (count and ends[0] != 0):
                raise Damaged("its OFFSETS do not begin with 0, or no CONNECTIVITY follows")
            self.connectivity, self.ends = self.array("nodes of cells", numbers, 1, line[1]).ravel(), ends[1:]
            return
        self.source.file.seek(start)
        table = self.array("numbers of cells", numbers, 1, "int").ravel()
        heads, begin = list[int](), 0
        for _ in range(count):
            if begin >= numbers or table[begin] < 0:
                raise CutOff(f"{count} cells are declared, {len(heads)} were found")
            heads.append(begin)
            begin += 1 + int(table[begin])
        if begin != numbers:
            raise Damaged(f"{count} cells with {numbers} numbers are declared, the cells take {begin}")
        inner = np.ones(numbers, dtype=bool)
        inner[heads] = False
        self.connectivity, self.ends = table[inner], np.cumsum(table[heads])

    def attribute(self, word: str, words: list[str]) -> None:
        """Read an array of point or cell data, or of the whole grid."""
        if word == "FIELD":
            self.field(self.count_in(words, 2, "arrays"))
        elif word == "SCALARS":
            columns = self.count_in(words, 3, "components") if len(words) > 3 else 1
            start = self.source.file.tell()
            if not self.source.line().upper().startswith("LOOKUP_TABLE"):
                self.source.file.seek(start)
            self.keep(words[1], self.array(words[1], self.count, columns, words[2]))
        elif word in ATTRIBUTES:
            self.array(words[1], self.count, ATTRIBUTES[word], words[2])
        elif word == "TEXTURE_COORDINATES":
            self.array(words[1], self.count, self.count_in(words, 2, "components"), words[3])
        elif word == "COLOR_SCALARS":
            self.array(
                words[1], self.count, self.count_in(words, 2, "components"), "unsigned_char" if self.source.binary else "float"
            )
        elif word == "LOOKUP_TABLE":
            self.array(words[1], self.count_in(words, 2, "colours"), 4, "unsigned_char" if self.source.binary else "float")
        else:
            raise Damaged(f"{' '.join(words)[:60]!r} was found; expected the beginning of a section")

    def field(self, arrays: int) -> None:
        for _ in range(arrays):
            words = self.source.line().split()
            if words[:1] == ["METADATA"]:
                self.section("METADATA", words)
                words = self.source.line().split()
            columns, rows = self.count_in(words, 1, "components"), self.count_in(words, 2, "values")
            if len(words) != 4:
                raise Damaged(f"{' '.join(words)[:60]!r} was found; expected the name, size and type of an array")
            if words[3].lower() in ("string", "utf8_string"):
                self.skip_strings(rows * columns)
            else:
                self.keep(words[0], self.array(words[0], rows, columns, words[3]))

    def keep(self, name: str, values: Array) -> None:
        """Store the array if it is of the cells."""
        if self.of == "CELL_DATA":
            name = re.sub("%([0-9a-fA-F]{2})", lambda code: chr(int(code[1], 16)), name)
            self.cell_data[name] = values[:, 0] if values.shape[1] == 1 else values

    def skip_strings(self, count: int) -> None:
        """Skip text: one line each, or in binary after its length, whose first two bits give the size of the length."""
        self.source.fits("lines of text", count, 1)
        for _ in range(count):
            if not self.source.binary:
                self.source.raw_line()
                continue
            head = self.source.file.read(1) or b"\xc0"  # the end of the file counts as a length of 0
            more = 2 ** (3 - (head[0] >> 6)) - 1
            length = int.from_bytes(bytes([head[0] & 63]) + self.source.file.read(more), "big")
            self.source.fits("bytes of text", length, 1)
            self.source.file.read(length)


def mesh_of(points: Array, connectivity: Array, ends: Array, types: Array, cell_data: dict[str, Array]) -> meshio.Mesh:
    """Return the mesh whose cell `i` has the type `types[i]` and the nodes `connectivity[ends[i - 1]:ends[i]]`."""
    sizes = sizes_of(connectivity, ends, types)
    for name, values in cell_data.items():
        if len(values) != len(types):
            raise Damaged(f"the array {name!r} has {len(values)} values for {len(types)} cells")
    breaks = np.flatnonzero((np.diff(types) != 0) | (np.diff(sizes) != 0)) + 1
    blocks = np.split(np.arange(len(types)), breaks) if len(types) else []
    starts = ends.astype(np.int64) - sizes
    cells = [(VTK[types[ids[0]]], connectivity[starts[ids, None] + order(types[ids[0]], sizes[ids[0]])]) for ids in blocks]
    return meshio.Mesh(points, cells, cell_data={name: [values[ids] for ids in blocks] for name, values in cell_data.items()})


def sizes_of(connectivity: Array, ends: Array, types: Array) -> NDArray[np.int64]:
    """Return the number of nodes of each cell, as many as its type has."""
    if len(ends) != len(types):
        raise Damaged(f"{len(types)} types of cells were found for {len(ends)} cells")
    sizes = np.diff(ends, prepend=0).astype(np.int64)
    if sizes.sum() != len(connectivity) or (sizes < 0).any():
        raise Damaged(f"its cells have {sizes.sum()} nodes in all, {len(connectivity)} were found")
    unknown = ~np.isin(types, list(VTK))
    if unknown.any():
        kinds = ", ".join(map(str, np.unique(types[unknown])[:5]))
        raise Damaged(f"{unknown.sum()} cells are of VTK's types {kinds}, which are not supported: convert them first")
    expected = np.array([node_count(VTK.get(kind, "")) or -1 for kind in range(max(VTK) + 1)])[types]
    if len(bad := np.flatnonzero((expected >= 0) & (expected != sizes))):
        raise Damaged(f"{name_ids(bad, 'cell')}: not as many nodes as the type has")
    return sizes


#: Nodes of a cell in meshio's order, where it is another one: pixels and voxels count along the axes, and wedges are reversed.
ORDERS = {8: [0, 1, 3, 2], 11: [0, 1, 3, 2, 4, 5, 7, 6], 13: [0, 2, 1, 3, 5, 4]}


def order(kind: int, size: int) -> Array:
    """Return the order of a cell's nodes in meshio."""
    return np.array(ORDERS.get(kind, range(size)))
