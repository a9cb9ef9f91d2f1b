"""Gmsh's .msh files, of versions 2.0 - 2.2, 4.0 and 4.1, as text or binary: nodes, elements, and their physical groups."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import meshio
import numpy as np
from meshio.gmsh import gmsh_to_meshio_type
from numpy.typing import NDArray

from ..groups import node_count
from .sides import LAGRANGE
from .stream import LONGEST, CutOff, Damaged, Source, check_known, check_unique, count_of

Ids = NDArray[np.int64]
Points = NDArray[np.float64]
#: Nodes in VTK's order, where Gmsh has another one.
ORDERS = {
    "tetra10": [0, 1, 2, 3, 4, 5, 6, 7, 9, 8],
    "hexahedron20": [0, 1, 2, 3, 4, 5, 6, 7, 8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15],
    "hexahedron27": [*range(8), 8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15, 22, 23, 21, 24, 20, 25, 26],
    "wedge15": [0, 1, 2, 3, 4, 5, 6, 9, 7, 12, 14, 13, 8, 10, 11],
    "pyramid13": [0, 1, 2, 3, 4, 5, 8, 10, 6, 7, 9, 11, 12],
}


class RowsOfType(NamedTuple):
    """Elements of one type: their type in Gmsh's terms, ids, nodes, and for each the number of its row of physical groups."""

    kind: int
    ids: Ids
    nodes: Ids
    groups: Ids


def read(path: Path) -> meshio.Mesh:
    """Read nodes and elements. Physical groups are sets of cells by name, or by tag if they have none."""
    with Source(path) as source:
        return Sections(source).mesh()


class Sections:
    """Sections of a file, each checked in its order."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self.nodes: Ids | None = None
        self.points = np.empty((0, 3))
        self.blocks: list[RowsOfType] | None = None
        self.values: dict[str, tuple[Ids, Points]] = {}  # ids of elements, and a number of each, by name
        self.names: dict[tuple[int, int], str] = {}
        self.groups: dict[tuple[int, int], list[int]] = {}  # physical groups of each entity, by dimension and tag
        line = source.line()
        while line == "$Comments":
            self.skip("Comments")
            line = source.line()
        words = source.line().split()
        if line == "$NOD":
            raise Damaged(
                "it is of version 1; versions 2.0 - 2.2, 4.0 and 4.1 are read. Convert it: gmsh FILE -save -format msh41 -o NEW.msh"
            )
        if line != "$MeshFormat" or len(words) != 3 or words[1] not in ("0", "1") or words[2] not in ("4", "8"):
            raise Damaged("it does not begin with $MeshFormat and a version")
        # `size` of the file's counters in bytes; 2, 2.0 and 2.1 are as 2.2, and Gmsh wrote 4 for 4.0
        self.version, self.size = {"2": "2.2", "2.0": "2.2", "2.1": "2.2", "4": "4.0"}.get(words[0], words[0]), int(words[2])
        if self.version not in ("2.2", "4.0", "4.1"):
            raise Damaged(f"it is of version {words[0][:20]}; versions 2.0 - 2.2, 4.0 and 4.1 are read")
        source.binary = words[1] == "1"
        if source.binary and source.file.read(4) != np.int32(1).tobytes():
            raise Damaged("its byte order is not this machine's")
        source.expect("$EndMeshFormat", "its header")

    def mesh(self) -> meshio.Mesh:
        """Return the mesh, after all sections are read."""
        seen = set()
        while line := self.source.line():
            name = line.removeprefix("$")
            if name in seen and not name.endswith("Data"):
                raise Damaged(f"{line[:60]} occurs twice")
            seen.add(name)
            if not line.startswith("$"):
                raise Damaged(f"{line[:60]!r} was found; expected the beginning of a section")
            if name in ("ParametricNodes", "PartitionedEntities"):
                option = "Mesh.SaveParametric" if name == "ParametricNodes" else "Mesh.PartitionCreateTopology"
                raise Damaged(f"it has ${name}, which is not read. Write it from Gmsh with {option} = 0")
            look = {
                "PhysicalNames": self.physical_names,
                "Entities": self.entities if self.version != "2.2" else None,
                "Nodes": self.nodes_22 if self.version == "2.2" else self.nodes_4,
                "Elements": self.elements_22 if self.version == "2.2" else self.elements_4,
            }.get(name)
            if look:
                look()
                self.source.expect(f"$End{name}", f"the entries that {line} declares")
            elif name in ("NodeData", "ElementData", "ElementNodeData"):
                self.data(name)
            else:
                self.skip(name)
        if self.nodes is None or self.blocks is None:
            raise CutOff("$Nodes or $Elements is missing")
        return self.combined(self.nodes, self.blocks)

    def combined(self, nodes: Ids, blocks: list[RowsOfType]) -> meshio.Mesh:
        """Return the mesh, with the blocks of each type as one, and the physical groups as sets."""
        order, rows, cells, sets = np.argsort(nodes), list(self.groups.items()), [], dict[str, list[Ids]]()
        kinds = sorted({block.kind for block in blocks})
        ids = [np.concatenate([block.ids for block in blocks if block.kind == kind]) for kind in kinds]
        for number, kind in enumerate(kinds):
            of_kind = [block for block in blocks if block.kind == kind]
            name, table = gmsh_to_meshio_type[kind], np.concatenate([block.nodes for block in of_kind])
            table = order[np.searchsorted(nodes[order], table)]
            cells.append((LAGRANGE.get(name, name), table[:, ORDERS[name]] if name in ORDERS else table))
            groups = np.concatenate([block.groups for block in of_kind])
            of_tag: dict[str, list[int]] = {}
            for row in np.unique(groups[groups >= 0]).tolist():
                (dimension, _), tags = rows[row]
                for tag in tags:
                    of_tag.setdefault(self.names.get((dimension, tag), str(tag)), []).append(row)
            for group, found in of_tag.items():
                members = sets.setdefault(group, [np.empty(0, dtype=np.int64)] * len(kinds))
                members[number] = np.flatnonzero(np.isin(groups, found))
        data = {name: [given(*values, of_kind) for of_kind in ids] for name, values in self.values.items()}
        return meshio.Mesh(self.points, cells, cell_sets=sets, cell_data=data, info={"format": "gmsh"})

    def skip(self, name: str) -> None:
        """Skip a section that is not needed."""
        for raw in iter(lambda: self.source.file.readline(LONGEST), b""):  # binary numbers may have no end of a line
            if raw.rstrip().endswith(f"$End{name}".encode()):
                return
        raise CutOff(f"${name[:60]} not closed by $End{name[:60]}")

    def data(self, name: str) -> None:
        """Read numbers of elements, such as those by which scikit-fem marks subdomains; skip numbers of nodes."""
        texts = count_of(self.source.line(), "texts")
        self.source.fits("texts", texts, 2)
        label = "".join([self.source.line() for _ in range(texts)][:1]).strip('"')
        self.source.rows("real tags", count_of(self.source.line(), "real tags"))
        words = self.source.rows("whole tags", count_of(self.source.line(), "whole tags"))
        if len(words) < 3:
            raise Damaged(
                f"${name} has {len(words)} whole tags; expected at least a step, a number of components, and one of values"
            )
        components, items = (count_of(words[index][0], "values") for index in (1, 2))
        self.source.fits("values", items, 2 * (1 + components))
        if name != "ElementData" or components != 1:
            self.skip(name)
            return
        if self.source.binary:
            rows = self.source.numbers("values", items, 1, [("id", "i4"), ("x", "f8")])
            self.values[label] = rows["id"].ravel(), rows["x"].ravel()
        else:
            table = self.source.numbers("values", items, 2)
            self.values[label] = table[:, 0].astype(np.int64), table[:, 1]
        self.source.expect(f"$End{name}", f"the values that ${name} declares")

    def physical_names(self) -> None:
        count = count_of(self.source.line(), "physical names")
        for row in self.source.rows("physical names", count):
            if len(row) < 3 or not row[0].isdigit() or not row[1].isdigit():
                raise Damaged(f"{' '.join(row)[:60]} was found; expected a dimension, a tag and a name of a physical group")
            self.names[int(row[0]), int(row[1])] = " ".join(row[2:]).strip('"')

    def counters(self, what: str, count: int) -> list[int]:
        """Return counts, such as of nodes: `size_t` in the format's terms."""
        dtype = f"u{self.size}" if self.source.binary else np.int64
        return [int(value) for value in self.source.numbers(what, 1, count, dtype)[0]]

    def whole(self, what: str, rows: int, columns: int = 1) -> Ids:
        """Return integers of 32 bits: `int` in the format's terms."""
        return self.source.numbers(what, rows, columns, np.int32 if self.source.binary else np.int64).astype(np.int64)

    def entities(self) -> None:
        for dimension, count in enumerate(self.counters("kinds of entities", 4)):
            self.source.fits("entities", count, 8)
            for _ in range(count):
                tag = int(self.whole("tags of entities", 1)[0, 0])
                self.source.numbers("coordinates of entities", 1, 3 if dimension == 0 and self.version == "4.1" else 6)
                tags = self.whole("physical groups of an entity", 1, self.counters("physical groups", 1)[0])[0]
                self.groups[dimension, tag] = np.abs(tags).tolist()  # the sign is an orientation
                if dimension:
                    self.whole("bounding entities of an entity", 1, self.counters("bounding entities", 1)[0])

    def nodes_22(self) -> None:
        count = count_of(self.source.line(), "nodes")
        self.set_nodes([self.rows_of_nodes(count, 3)], count)

    def nodes_4(self) -> None:
        blocks, count = self.counters("blocks of nodes", 4 if self.version == "4.1" else 2)[:2]
        self.source.fits("blocks of nodes", blocks, 8)
        parts: list[tuple[NDArray[Any], Points]] = []
        for _ in range(blocks):
            first, second, parametric = self.whole("heads of blocks of nodes", 1, 3)[0].tolist()
            of_block = self.counters("nodes in a block", 1)[0]
            dimension = first if self.version == "4.1" else second
            width = 3 + (dimension if parametric and 0 <= dimension <= 3 else 0)
            if self.version == "4.1":
                ids = self.source.numbers("nodes", of_block, 1, f"u{self.size}" if self.source.binary else np.int64).ravel()
                parts.append((ids, self.source.numbers("nodes", of_block, width)[:, :3]))
            else:
                parts.append(self.rows_of_nodes(of_block, width))
        self.set_nodes(parts, count)

    def rows_of_nodes(self, count: int, width: int) -> tuple[NDArray[Any], Points]:
        """Return ids and coordinates of the next nodes, each of which has its id before `width` numbers."""
        if self.source.binary:
            rows = self.source.numbers("nodes", count, 1, [("id", "i4"), ("x", "f8", width)])
            return rows["id"].ravel(), rows["x"].reshape(count, width)[:, :3]
        table = self.source.numbers("nodes", count, 1 + width)
        return table[:, 0], table[:, 1:4]

    def set_nodes(self, parts: list[tuple[NDArray[Any], Points]], count: int) -> None:
        ids = np.concatenate([np.empty(0), *(part[0] for part in parts)])
        if len(ids) and (ids.min() < 1 or ids.max() > 2.0**53 or (ids != np.floor(ids)).any()):
            raise Damaged(
                f"its nodes have tags from {ids.min():g} to {ids.max():g}; expected whole numbers from 1, as Gmsh writes them"
            )
        check_unique(ids, "node")
        if len(ids) != count:
            raise Damaged(f"{count} nodes are declared, {len(ids)} were found")
        self.nodes, self.points = ids.astype(np.int64), np.concatenate([np.empty((0, 3)), *(part[1] for part in parts)])

    def elements_22(self) -> None:
        count = count_of(self.source.line(), "elements")
        tables = self.tables_22(count) if self.source.binary else by_type(self.source.rows("elements", count))
        blocks = []
        for kind, tags, table in tables:
            physical = table[:, 1] if tags else np.zeros(len(table), dtype=np.int64)
            dimension, row = (
                meshio.CellBlock(LAGRANGE.get(gmsh_to_meshio_type[kind], gmsh_to_meshio_type[kind]), table[:0]).dim,
                np.full(len(table), -1),
            )
            for tag in np.unique(physical[physical != 0]).tolist():
                self.groups.setdefault((dimension, tag), [tag])
                row[physical == tag] = list(self.groups).index((dimension, tag))
            blocks.append(RowsOfType(kind, table[:, 0], table[:, 1 + tags :], row))
        self.set_blocks(blocks, count)

    def tables_22(self, count: int) -> list[tuple[int, int, Ids]]:
        """Return type, number of tags, and rows of binary elements. Elements with equal heads of their own are read together."""
        tables: dict[tuple[int, int], list[Ids]] = {}
        found = 0
        while found < count:
            kind, many, tags = self.whole("heads of blocks of elements", 1, 3)[0].tolist()
            if many < 1 or not 0 <= tags <= self.source.size:
                raise Damaged(f"a block of elements declares {many} of them with {tags} tags each")
            width, rows = 1 + tags + nodes_of(kind), tables.setdefault((kind, tags), [])
            rows.append(self.whole("elements", many, width))
            found, window = found + many, 64
            while many == 1 and found < count:  # the rows that follow, as long as they have the same head
                start, window = self.source.file.tell(), min(2 * window, count - found)
                at_most = min(window, self.source.left // (4 * (3 + width)))
                block = self.whole("elements", at_most, 3 + width)
                same = np.append((block[:, :3] == [kind, 1, tags]).all(axis=1), False)
                equal = int(np.argmin(same))
                rows.append(block[:equal, 3:])
                found += equal
                if equal < window:
                    self.source.file.seek(start + 4 * equal * (3 + width))
                    break
        return [(kind, tags, np.concatenate(rows)) for (kind, tags), rows in tables.items()]

    def elements_4(self) -> None:
        numbers, count = self.counters("blocks of elements", 4 if self.version == "4.1" else 2)[:2]
        self.source.fits("blocks of elements", numbers, 8)
        blocks, rows = [], {entity: row for row, entity in enumerate(self.groups)}
        for _ in range(numbers):
            first, second, kind = self.whole("heads of blocks of elements", 1, 3)[0].tolist()
            entity = (first, second) if self.version == "4.1" else (second, first)
            many = self.counters("elements in a block", 1)[0]
            dtype: Any = np.int64
            if self.source.binary:
                dtype = f"u{self.size}" if self.version == "4.1" else np.int32
            table = self.source.numbers("elements", many, 1 + nodes_of(kind), dtype).astype(np.int64)
            blocks.append(RowsOfType(kind, table[:, 0], table[:, 1:], np.full(many, rows.get(entity, -1))))
        self.set_blocks(blocks, count)

    def set_blocks(self, blocks: list[RowsOfType], count: int) -> None:
        if self.nodes is None:
            raise Damaged("its $Elements come before its $Nodes")
        known = np.sort(self.nodes)
        for block in blocks:
            check_known(block.nodes, known, "node", "its elements")
        ids = np.concatenate([np.empty(0, dtype=np.int64), *(block.ids for block in blocks)])
        check_unique(ids, "element")
        if len(ids) != count:
            raise Damaged(f"{count} elements are declared, {len(ids)} were found")
        self.blocks = blocks


def given(ids: Ids, values: Points, of: Ids) -> Points:
    """Return the values of elements `of` by their ids; NaN for those without a value."""
    order = np.argsort(ids)
    at = order[np.minimum(np.searchsorted(ids[order], of), len(ids) - 1)] if len(ids) else np.zeros(len(of), dtype=np.int64)
    return np.where(ids[at] == of, values[at], np.nan) if len(ids) else np.full(len(of), np.nan)


def nodes_of(kind: int) -> int:
    """Return the number of nodes of an element of the type."""
    if not (count := node_count(gmsh_to_meshio_type.get(kind, ""))):
        raise Damaged(f"it has elements of Gmsh's type {kind}, which is not supported")
    return count


def by_type(rows: list[list[str]]) -> list[tuple[int, int, Ids]]:
    """Return type, number of tags, and rows (id, tags, nodes) of elements: id, type, number of tags, tags, nodes."""
    try:
        numbers = np.array([int(word) for row in rows for word in row], dtype=np.int64)
    except ValueError as error:
        raise Damaged("its elements contain other text than whole numbers") from error
    widths = np.array([len(row) for row in rows], dtype=np.int64)
    starts = np.cumsum(widths) - widths
    short = np.flatnonzero(widths < 3)
    kinds, tags = (numbers[starts + index] for index in (1, 2)) if not len(short) else (widths, widths)
    known, found = np.unique(np.stack([kinds, tags]), axis=1, return_inverse=True)
    nodes = np.array([0 if len(short) else nodes_of(int(kind)) for kind in known[0]], dtype=np.int64)[np.ravel(found)]
    if len(bad := np.append(short, np.flatnonzero((widths != 3 + tags + nodes) | (tags < 0)))):
        raise Damaged(f"the element {' '.join(rows[bad[0]])[:60]!r} has not as many nodes as its type")
    tables = []
    for number, (kind, count) in enumerate(known.T.tolist()):
        of_kind = np.flatnonzero(np.ravel(found) == number)
        columns = np.append(0, np.arange(3, 3 + count + nodes[of_kind[0]]))
        tables.append((kind, count, numbers[starts[of_kind][:, None] + columns]))
    return tables
