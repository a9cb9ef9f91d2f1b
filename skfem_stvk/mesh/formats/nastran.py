"""Bulk data of Nastran (.bdf, .nas, .fem) in fixed, wide and free fields: nodes, coordinate systems, elements, properties."""

from __future__ import annotations

import re
from array import array
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import meshio
import numpy as np
from numpy.typing import NDArray

from ...errors import name_ids, warn
from ..groups import node_count
from .exodus import ORDERS
from .sides import LAGRANGE, Ids
from .stream import CutOff, Damaged, Included, Source, check_known, check_unique, real

Points = NDArray[np.float64]
#: Types of cells in meshio's terms, with corners alone and with all middle nodes, by the names of cards.
KINDS = {
    **dict.fromkeys(("CBAR", "CBEAM", "CROD", "CTUBE"), ("line", "line")),
    "CONROD": ("line", "line"),
    **dict.fromkeys(("CTRIA3", "CTRIAR"), ("triangle", "triangle")),
    "CTRIA6": ("triangle", "triangle6"),
    **dict.fromkeys(("CQUAD4", "CQUADR", "CSHEAR"), ("quad", "quad")),
    "CQUAD8": ("quad", "quad8"),
    "CQUAD": ("quad", "quad9"),
    "CTETRA": ("tetra", "tetra10"),
    "CHEXA": ("hexahedron", "hexahedron20"),
    "CPENTA": ("wedge", "wedge15"),
    **dict.fromkeys(("CPYRAM", "CPYRA"), ("pyramid", "pyramid13")),
}
#: Cards of elements that are not read: their matter would be missing.
REFUSED = re.compile(
    r"C(TRIA|TRAX|QUAD|QUADX|IHEX|HEX|TETRA|PENTA|PYRA|BEND|HACAB|BEAM3|TRIAX)\w*|GRIDB|SPOINT[GB]|EGRID|CGEN|SESET|CSUPER"
)
#: Cards of elements without volume, which are left out with a note.
WITHOUT_VOLUME = re.compile(r"C(ELAS|BUSH|GAP|DAMP|MASS|ONM|VISC|WELD|FAST|SEAM)\w*|CON(M|V)\w*")


def read(path: Path) -> meshio.Mesh:
    """Read nodes and elements; the array `nastran:ref` has the number of the property of each element."""
    grids, systems, tables, left_out = Grids(), dict[int, list[str]](), dict[str, Any](), Counter[str]()
    for name, *fields in cards(path):
        if name == "GRID":
            grids.add(fields)
        elif name == "GRDSET":
            grids.system = whole(fields[1])
        elif re.fullmatch(r"CORD[12][RCS]", name):
            for one in (fields[:4], fields[4:8]) if name[4] == "1" else (fields,):
                if one and one[0]:
                    systems[whole(one[0])] = [name, *one]
        elif name in KINDS:
            kind, row = element(name, fields)
            tables.setdefault(kind, array("q")).extend(row)
        elif REFUSED.fullmatch(name):
            raise Damaged(f"it has the card {name}, which is not read. Write the mesh without it")
        elif WITHOUT_VOLUME.fullmatch(name):
            left_out[name] += 1
    if left_out:
        warn(f"{' and '.join(f'{count} {name}' for name, count in left_out.items())} elements are left out: they have no volume.")
    ids, points = grids.placed(systems)
    rows = {kind: np.array(table).reshape(-1, 2 + (node_count(kind) or 0)) for kind, table in tables.items()}
    check_unique(np.concatenate([np.empty(0, dtype=np.int64), *(table[:, 0] for table in rows.values())]), "element")
    order = np.argsort(ids)
    cells, properties = [], []
    for kind, table in rows.items():
        check_known(table[:, 2:], ids[order], "node", "its elements")
        nodes = order[np.searchsorted(ids[order], table[:, 2:])]
        cells.append((LAGRANGE.get(kind, kind), nodes[:, ORDERS[kind]] if kind in ORDERS else nodes))
        properties.append(table[:, 1])
    return meshio.Mesh(points, cells, cell_data={"nastran:ref": properties})


def element(name: str, fields: list[str]) -> tuple[str, list[int]]:
    """Return the type of cells, and id, property and nodes of an element; without all middle nodes, its corners."""
    linear, quadratic = KINDS[name]
    if name == "CONROD":
        fields = [fields[0], "0", *fields[1:3]]
    corners, all_nodes = node_count(linear) or 0, node_count(quadratic) or 0
    nodes = [*fields[2 : 2 + all_nodes], *[""] * all_nodes][:all_nodes]
    middle = [word for word in nodes[corners:] if word]
    if middle and len(middle) < all_nodes - corners:
        raise Damaged(f"element {fields[0][:20]} has {len(middle)} of {all_nodes - corners} middle nodes; expected all or none")
    try:
        row = [whole(word) for word in (fields[0], fields[1] or fields[0], *(nodes if middle else nodes[:corners]))]
    except Damaged as error:
        raise Damaged(f"the card {name} {fields[0][:20]}: {error}; it needs {corners} or {all_nodes} nodes") from error
    if name != "CONROD" and row[1] == 0:
        raise Damaged(f"the card {name} {fields[0][:20]} has the property 0; expected an id from 1")
    return (quadratic if middle else linear), row


class Grids:
    """Nodes: their ids, coordinate systems and coordinates; `system` is that of nodes without one."""

    def __init__(self) -> None:
        self.system, self.numbers, self.coordinates = 0, array("q"), array("d")

    def add(self, fields: list[str]) -> None:
        """Add a node: its id, coordinate system, and coordinates."""
        self.numbers.extend((whole(fields[0]), whole(fields[1]) if fields[1] else self.system))
        self.coordinates.extend(real(word) for word in fields[2:5])

    def placed(self, systems: dict[int, list[str]]) -> tuple[Ids, Points]:
        """Return the ids, and the points in the basic coordinate system."""
        numbers, points = np.array(self.numbers).reshape(-1, 2), np.array(self.coordinates).reshape(-1, 3)
        check_unique(numbers[:, 0], "node")
        frames: dict[int, Callable[[Points], Points]] = {0: lambda x: x}
        raw, index = points.copy(), {int(id): i for i, id in enumerate(numbers[:, 0])} if systems else {}

        def frame(number: int, depth: int = 0) -> Callable[[Points], Points]:
            """Return the map from a coordinate system to the basic one."""
            if number in frames:
                return frames[number]
            if number not in systems or depth > len(systems):
                raise Damaged(f"coordinate system {number} {'refers to itself' if number in systems else 'is not defined'}")
            name, _, *fields = systems[number]
            if name[4] == "1":
                nodes = [index.get(whole(word), -1) for word in fields[:3]]
                if min(nodes) < 0:
                    raise Damaged(f"coordinate system {number} is on {name_ids(fields[:3], 'node')} not defined")
                a, b, c = (frame(int(numbers[i, 1]), depth + 1)(raw[i : i + 1])[0] for i in nodes)
            else:
                a, b, c = frame(whole(fields[0] or "0"), depth + 1)(np.array([real(word) for word in fields[1:10]]).reshape(3, 3))
            z = (b - a) / np.linalg.norm(b - a)
            y = np.cross(z, c - a)
            if not np.isfinite(z).all() or not (size := np.linalg.norm(y)):
                raise Damaged(f"coordinate system {number} has its three points on a line")
            axes = np.stack([np.cross(y / size, z), y / size, z])
            frames[number] = lambda x: cartesian(name[-1], x) @ axes + a
            return frames[number]

        for number in np.unique(numbers[:, 1]):
            rows = numbers[:, 1] == number
            points[rows] = frame(int(number))(raw[rows])
        return numbers[:, 0], points


def cartesian(kind: str, x: Points) -> Points:
    """Return x, y, z of cylindrical (radius, angle, z) or spherical coordinates (radius, angles from and about z)."""
    if kind == "R":
        return x
    r, second, third = x[:, 0], np.deg2rad(x[:, 1]), np.deg2rad(x[:, 2])
    if kind == "C":
        return np.stack([r * np.cos(second), r * np.sin(second), x[:, 2]], axis=1)
    return np.stack([r * np.sin(second) * np.cos(third), r * np.sin(second) * np.sin(third), r * np.cos(second)], axis=1)


def cards(path: Path) -> Iterator[list[str]]:
    """Yield each card with its continuation lines: its name in capital letters, and at least nine fields."""
    card: list[str] = []
    for line in bulk(path, Included(path), 0):
        name, data = fields_of(line)
        if name == "" or name[0] in "+*":
            card += data
            continue
        if card:
            yield card + [""] * 9
        if not re.fullmatch(r"[A-Z][A-Z0-9_]*", name):
            raise Damaged(f"{line[:60]!r} was found; expected the name of a card")
        card = [name, *data]
    if card:
        yield card + [""] * 9


def fields_of(line: str) -> tuple[str, list[str]]:
    """Return the name of a card, and the 8 fields of a line; 4 of one with wide fields, which is marked by a star.

    >>> fields_of("GRID,7,,1.,2.")
    ('GRID', ['7', '', '1.', '2.', '', '', '', ''])
    """
    if "," in line:
        words = [word.strip() for word in line.split(",")]
        count = 4 if "*" in words[0] else 8
        name, data = words[0], words[1 : 1 + count]
    else:
        line = line.expandtabs(8)
        count = 4 if "*" in line[:8] else 8
        width, name = 64 // count, line[:8].strip()
        data = [line[at : at + width].strip() for at in range(8, 72, width)]
    name = name.upper()
    return ("+" if name[:1] in ("+", "*") else name.rstrip("*")), data + [""] * (count - len(data))


def bulk(path: Path, included: Included, depth: int) -> Iterator[str]:
    """Yield the lines of the bulk data, also of included files."""
    included.enter(path, depth)
    with Source(path) as source:
        texts = iter(source.raw_line, b"")
        heads = [raw.upper().split()[:2] for raw in iter(source.raw_line, b"")]
        begins = [i for i, words in enumerate(heads) if words[:2] == [b"BEGIN", b"BULK"]]
        ends = any(words[:1] == [b"ENDDATA"] for words in heads)
        if begins and not ends:
            raise CutOff("BEGIN BULK has no ENDDATA")
        source.file.seek(0)
        for number, raw in enumerate(texts):
            line = raw.decode(errors="replace").partition("$")[0].rstrip()
            if (begins and number <= begins[0]) or not line.strip():
                continue
            word = line.split(maxsplit=1)[0].upper()
            if word == "ENDDATA":
                return
            if word == "INCLUDE":
                yield from bulk(included.path(file_of(line)), included, depth + 1)
            else:
                if raw[-1:] not in b"\n\r\x1a\0":
                    raise CutOff(
                        "its last line has no end, so it may be cut within a number (end it with a newline if it is complete)"
                    )
                yield line


def file_of(line: str) -> str:
    """Return the path of a file that a line includes."""
    return line.split(maxsplit=1)[-1].strip("'\" \r\n")


def parts(path: Path) -> list[Path]:
    """Return the files that a file includes."""
    with Source(path) as source:
        lines = [raw.decode(errors="replace") for raw in iter(source.raw_line, b"") if raw.upper().lstrip().startswith(b"INCLUDE")]
    files = [Included(path).path(file_of(line)) for line in lines]
    return [found for file in files for found in (file, *parts(file))]


def whole(word: str) -> int:
    """Return an id."""
    if not (word.isascii() and word.isdigit() and len(word) <= 18):
        raise Damaged(f"{word[:40]!r} was found; expected an id")
    return int(word)
