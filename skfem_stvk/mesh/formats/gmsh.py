"""Gmsh's .msh files, of version 2.2, 4.0 and 4.1, as text or binary: checks of their consistency."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from meshio.gmsh import gmsh_to_meshio_type
from numpy.typing import NDArray

from ..groups import node_count
from .stream import LONGEST, Damaged, Source, check_known, check_unique, count_of

Ids = NDArray[np.int64]
#: meshio makes arrays as long as the largest tag of a node. Tags larger than this and the size of the file are refused.
LARGEST_TAG = 10_000_000


def check(path: Path) -> tuple[int, int]:
    """Return the number of nodes and of elements; each must occur once, and elements must refer to existing nodes."""
    with Source(path) as source:
        return Sections(source).check()


class Sections:
    """Sections of a file, each checked in its order."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self.nodes: Ids | None = None
        self.elements: Ids | None = None
        line = source.line()
        while line == "$Comments":
            self.skip("Comments")
            line = source.line()
        words = source.line().split()
        if line != "$MeshFormat" or len(words) != 3 or words[1] not in ("0", "1") or words[2] not in ("4", "8"):
            raise Damaged("it does not begin with $MeshFormat and a version")
        # `size` of the file's counters in bytes; some files say 2 for 2.2, and 4 for 4.1
        self.version, self.size = {"2": "2.2", "4": "4.1"}.get(words[0], words[0]), int(words[2])
        if self.version not in ("2.2", "4.0", "4.1"):
            raise Damaged(f"it is of version {words[0][:20]}; versions 2.2, 4.0 and 4.1 are read")
        source.binary = words[1] == "1"
        if source.binary and source.file.read(4) != np.int32(1).tobytes():
            raise Damaged("its byte order is not this machine's")
        source.expect("$EndMeshFormat", "its header")

    def check(self) -> tuple[int, int]:
        seen = set()
        while line := self.source.line():
            name = line.removeprefix("$")
            if name in seen and not name.endswith("Data"):
                raise Damaged(f"{line[:60]} occurs twice")
            seen.add(name)
            look = {
                "PhysicalNames": self.physical_names,
                "Entities": self.entities if self.version == "4.1" else None,
                "Nodes": self.nodes_22 if self.version == "2.2" else self.nodes_4,
                "Elements": self.elements_22 if self.version == "2.2" else self.elements_4,
            }.get(name)
            if not line.startswith("$"):
                raise Damaged(f"{line[:60]!r} was found; expected the beginning of a section")
            if look:
                look()
                self.source.expect(f"$End{name}", f"the entries that {line} declares")
            else:
                if name in ("NodeData", "ElementData", "ElementNodeData"):
                    self.head_of_data()
                self.skip(name)
        if self.nodes is None or self.elements is None:
            raise Damaged("$Nodes or $Elements is missing")
        return len(self.nodes), len(self.elements)

    def skip(self, name: str) -> None:
        """Skip a section that is not needed."""
        for raw in iter(lambda: self.source.file.readline(LONGEST), b""):  # binary numbers may have no end of a line
            if raw.strip() == f"$End{name}".encode():
                return
        raise Damaged(f"${name[:60]} not closed by $End{name[:60]}")

    def head_of_data(self) -> None:
        """Check the numbers of tags and of values, which meshio does not check."""
        words: list[list[str]] = []
        for what in ("texts", "real tags", "whole tags"):
            words = self.source.rows(what, count_of(self.source.line(), what))
        if len(words) > 2:
            components, items = (count_of(words[index][0], "values") for index in (1, 2))
            self.source.fits("values", items, 2 * (1 + components))

    def physical_names(self) -> None:
        count = count_of(self.source.line(), "physical names")
        if bad := [row for row in self.source.rows("physical names", count) if len(row) < 3]:
            raise Damaged(f"{' '.join(bad[0])[:60]} was found; expected a dimension, a tag and a name of a physical group")

    def counters(self, what: str, count: int) -> list[int]:
        """Return counts, such as of nodes: `size_t` in the format's terms."""
        dtype = f"u{self.size}" if self.source.binary else np.int64
        return [int(value) for value in self.source.numbers(what, 1, count, dtype)[0]]

    def whole(self, what: str, rows: int, columns: int = 1) -> Ids:
        """Return integers of 32 bits: `int` in the format's terms."""
        return self.source.numbers(what, rows, columns, np.int32 if self.source.binary else np.int64).astype(np.int64)

    def entities(self) -> None:
        for dim, count in enumerate(self.counters("kinds of entities", 4)):
            self.source.fits("entities", count, 8)
            for _ in range(count):
                self.whole("tags of entities", 1)
                self.source.numbers("coordinates of entities", 1, 3 if dim == 0 else 6)
                for what in ("physical groups", "bounding entities")[: 1 + (dim > 0)]:
                    self.whole(f"{what} of an entity", 1, self.counters(what, 1)[0])

    def nodes_22(self) -> None:
        count = count_of(self.source.line(), "nodes")
        self.set_nodes(self.node_ids(count), count)

    def nodes_4(self) -> None:
        blocks, count = self.counters("blocks of nodes", 4 if self.version == "4.1" else 2)[:2]
        self.source.fits("blocks of nodes", blocks, 8)
        parts = [np.empty(0)]
        for _ in range(blocks):
            self.whole("heads of blocks of nodes", 1, 3)
            of_block = self.counters("nodes in a block", 1)[0]
            if self.version == "4.1":
                parts.append(self.source.numbers("nodes", of_block, 1, f"u{self.size}" if self.source.binary else np.int64).ravel())
                self.source.numbers("nodes", of_block, 3)
            else:
                parts.append(self.node_ids(of_block))
        self.set_nodes(np.concatenate(parts), count)

    def node_ids(self, count: int) -> NDArray[Any]:
        """Return ids of the next nodes, each of which precedes its coordinates."""
        if self.source.binary:
            return self.source.numbers("nodes", count, 1, [("id", "i4"), ("x", "f8", 3)])["id"].ravel()
        return self.source.numbers("nodes", count, 4)[:, 0]

    def set_nodes(self, ids: NDArray[Any], count: int) -> None:
        if len(ids) and (ids.min() < 1 or ids.max() > LARGEST_TAG + self.source.size or (ids != np.floor(ids)).any()):
            raise Damaged(
                f"its nodes have tags from {ids.min():g} to {ids.max():g}; expected whole numbers from 1 (not 0) to at most "
                f"{LARGEST_TAG + self.source.size}, as Gmsh writes them"
            )
        check_unique(ids, "node")
        if len(ids) != count:
            raise Damaged(f"{count} nodes are declared, {len(ids)} were found")
        self.nodes = ids.astype(np.int64)

    def elements_22(self) -> None:
        count = count_of(self.source.line(), "elements")
        blocks = self.blocks_22(count) if self.source.binary else by_type(self.source.rows("elements", count))
        self.set_elements(blocks, count)

    def blocks_22(self, count: int) -> list[tuple[Ids, Ids]]:
        blocks, found = [], 0
        while found < count:
            kind, many, tags = self.whole("heads of blocks of elements", 1, 3)[0].tolist()
            if many < 1 or not 0 <= tags <= self.source.size:
                raise Damaged(f"a block of elements declares {many} of them with {tags} tags each")
            table = self.whole("elements", many, 1 + tags + nodes_of(kind))
            blocks.append((table[:, 0], table[:, 1 + tags :]))
            found += many
        return blocks

    def elements_4(self) -> None:
        numbers, count = self.counters("blocks of elements", 4 if self.version == "4.1" else 2)[:2]
        self.source.fits("blocks of elements", numbers, 8)
        blocks = []
        for _ in range(numbers):
            kind = int(self.whole("heads of blocks of elements", 1, 3)[0, 2])
            many = self.counters("elements in a block", 1)[0]
            dtype: Any = np.int64
            if self.source.binary:
                dtype = f"u{self.size}" if self.version == "4.1" else np.int32
            table = self.source.numbers("elements", many, 1 + nodes_of(kind), dtype).astype(np.int64)
            blocks.append((table[:, 0], table[:, 1:]))
        self.set_elements(blocks, count)

    def set_elements(self, blocks: list[tuple[Ids, Ids]], count: int) -> None:
        if self.nodes is None:
            raise Damaged("its $Elements come before its $Nodes")
        for _, nodes in blocks:
            check_known(nodes, np.sort(self.nodes), "node", "its elements")
        self.elements = np.concatenate([np.empty(0, dtype=np.int64), *(ids for ids, _ in blocks)])
        check_unique(self.elements, "element")
        if len(self.elements) != count:
            raise Damaged(f"{count} elements are declared, {len(self.elements)} were found")


def nodes_of(kind: int) -> int:
    """Return the number of nodes of an element of the type."""
    if not (count := node_count(gmsh_to_meshio_type.get(kind, ""))):
        raise Damaged(f"it has elements of Gmsh's type {kind}, which is not supported")
    return count


def by_type(rows: list[list[str]]) -> list[tuple[Ids, Ids]]:
    """Return ids and nodes of the elements, one row for each: id, type, number of tags, tags, nodes."""
    numbers = np.array([int(word) for row in rows for word in row], dtype=np.int64)
    widths = np.array([len(row) for row in rows], dtype=np.int64)
    starts = np.cumsum(widths) - widths
    short = np.flatnonzero(widths < 3)
    kinds, tags = (numbers[starts + index] for index in (1, 2)) if not len(short) else (widths, widths)
    known, found = np.unique(kinds, return_inverse=True)
    nodes = np.array([0 if len(short) else nodes_of(int(kind)) for kind in known], dtype=np.int64)[found]
    if len(bad := np.append(short, np.flatnonzero((widths != 3 + tags + nodes) | (tags < 0)))):
        raise Damaged(f"the element {' '.join(rows[bad[0]])[:60]!r} has not as many nodes as its type")
    blocks = []
    for kind in range(len(known)):
        of_kind = np.flatnonzero(found == kind)
        first = starts[of_kind] + widths[of_kind] - nodes[of_kind]
        blocks.append((numbers[starts[of_kind]], numbers[first[:, None] + np.arange(nodes[of_kind[0]])]))
    return blocks
