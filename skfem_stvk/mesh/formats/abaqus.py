"""Abaqus input files (.inp): nodes, elements and their sets, with the files that they include."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import meshio
import numpy as np
from numpy.typing import NDArray

from ...errors import name_ids
from ..groups import node_count
from .stream import Damaged, Source, check_known, check_last_line, check_unique

Ids = NDArray[np.int64]
#: Keyword, options and data lines in words.
Section = tuple[str, dict[str, str], list[list[str]]]
#: Types of elements by the type of their cells in meshio's terms.
TYPES = {
    "line": "T2D2 T2D2H T3D2 T3D2H B21 B21H B31 B31H",
    "line3": "T2D3 T2D3H T3D3 T3D3H B22 B22H B32 B32H B33 B33H",
    "triangle": "CPS3 CPE3 CPE3H M3D3 STRI3 S3 S3R S3RS R3D3",
    "triangle6": "CPS6 CPS6M CPE6 CPE6H CPE6M CPE6MH M3D6 S6 STRI65",
    "quad": "CPS4 CPS4R CPS4I CPE4 CPE4H CPE4I CPE4IH CPE4R CPE4RH M3D4 M3D4R CAX4P S4 S4R S4RS S4RSW S4R5",
    "quad8": "CPS8 CPS8R CPE8 CPE8H CPE8R CPE8RH M3D8 M3D8R S8R S8R5",
    "quad9": "S9R5",
    "tetra": "C3D4 C3D4H",
    "tetra10": "C3D10 C3D10H C3D10HS C3D10I C3D10M C3D10MH C3D10MT C3D10T",
    "hexahedron": "C3D8 C3D8H C3D8I C3D8IH C3D8R C3D8RH",
    "hexahedron20": "C3D20 C3D20H C3D20R C3D20RH",
    "wedge": "C3D6",
    "wedge15": "C3D15",
}
KINDS = {name: kind for kind, names in TYPES.items() for name in names.split()}
#: Maximum depth of included files, and their maximum number.
DEEPEST, MOST_FILES = 8, 100
INCLUDE = re.compile(rb"[ \t]*\*[ \t]*INCLUDE\b", re.IGNORECASE)


def read(path: Path) -> meshio.Mesh:
    """Read nodes, elements, and their sets as `point_sets` and `cell_sets`.

    Sets are named by `*NODE, NSET=`, `*ELEMENT, ELSET=`, `*NSET` and `*ELSET`. They consist of ids, ranges (`GENERATE`) or other
    sets.
    """
    parts = list(Files(path).sections())
    nodes, points = nodes_of(parts)
    cells, ids = elements_of(parts, nodes)
    every = np.concatenate([np.empty(0, dtype=np.int64), *ids])
    check_unique(every, "element")
    order = np.argsort(nodes)
    data = [(kind, order[np.searchsorted(nodes, table, sorter=order)]) for kind, table in cells]
    data = [(kind, middle_last(table, points) if kind == "line3" else table) for kind, table in data]
    named, blocks = sets_of(parts, "ELSET", every), [(block, np.argsort(block)) for block in ids]
    return meshio.Mesh(
        points,
        data,
        point_sets={name: indices_of(nodes, order, members) for name, members in sets_of(parts, "NSET", nodes).items()},
        cell_sets={name: [indices_of(*block, members) for block in blocks] for name, members in named.items()},
    )


def indices_of(ids: Ids, order: Ids, members: Ids) -> Ids:
    """Return the ascending indices, among different ids in ascending `order`, of those that are members."""
    found = order[np.minimum(np.searchsorted(ids, members, sorter=order), len(ids) - 1)]
    return np.sort(found[ids[found] == members])


def included(path: Path) -> Iterator[Path]:
    """Yield the files that a file includes, also within others."""
    return Files(path).every(path)


def nodes_of(parts: list[Section]) -> tuple[Ids, NDArray[np.float64]]:
    """Return ids of the nodes and their coordinates."""
    tables = [lines for keyword, _, lines in parts if keyword == "NODE"]
    if len(tables) != 1:
        raise Damaged(
            f"it has {len(tables)} *NODE sections; expected one. An assembly of several parts? Export one part, or merge the "
            "parts into one"
        )
    rows = [line[:-1] if line[-1] == "" else line for line in tables[0]]
    if len({len(row) for row in rows}) > 1:
        raise Damaged("its nodes have different numbers of coordinates")
    ids = np.array(whole([row[0] for row in rows]), dtype=np.int64)
    check_unique(ids, "node")
    return ids, np.array([row[1:] for row in rows], dtype=float)


def elements_of(parts: list[Section], nodes: Ids) -> tuple[list[tuple[str, Ids]], list[Ids]]:
    """Return type and nodes of the elements of each section, and their ids."""
    cells, ids = [], []
    for keyword, options, lines in parts:
        if keyword != "ELEMENT":
            continue
        kind = KINDS.get(options.get("TYPE", "").upper())
        if kind is None:
            raise Damaged(f"Element type not available: {options.get('TYPE', 'none')[:40]}")
        rows, n = [whole(record) for record in records(lines)], node_count(kind) or 0
        if bad := [row[0] for row in rows if len(row) != 1 + n]:
            raise Damaged(f"{name_ids(bad, 'element')}: not the {n} nodes of the type {options['TYPE'][:40]}")
        table = np.array(rows, dtype=np.int64).reshape(-1, 1 + n)
        check_known(table[:, 1:], np.sort(nodes), "node", "its elements")
        cells.append((kind, table[:, 1:]))
        ids.append(table[:, 0])
    return cells, ids


def middle_last(t: Ids, points: NDArray[np.float64]) -> Ids:
    """Return segments of second order (n, 3) with the middle last; some programs write it between the ends.

    The middle is the node that is nearest to the midpoint of the other two.
    """
    x = points[t]
    off = np.stack([np.linalg.norm(x[:, i] - (x[:, i - 1] + x[:, i - 2]) / 2, axis=1) for i in range(3)])
    orders = np.array([[1, 2, 0], [0, 2, 1], [0, 1, 2]])
    return np.take_along_axis(t, orders[off.argmin(axis=0)], axis=1)


def records(lines: list[list[str]]) -> Iterator[list[str]]:
    """Yield the words of each element, which continues in the next line after a comma at the end of a line."""
    record: list[str] = []
    for line in lines:
        if line[-1]:
            yield record + line if record else line
            record = []
        else:
            record += line[:-1]
    if record:
        yield record


def sets_of(parts: list[Section], kind: str, known: Ids) -> dict[str, Ids]:
    """Return ids of the members of each set by name."""
    sets, known = SetsByName(), np.sort(known)
    for keyword, options, lines in parts:
        members: Ids = np.empty(0, dtype=np.int64)
        if kind not in options:
            continue
        if keyword == {"ELSET": "ELEMENT", "NSET": "NODE"}[kind]:
            whole_lines = records(lines) if kind == "ELSET" else lines
            members = np.array(whole([line[0] for line in whole_lines]), dtype=np.int64)
        elif keyword == kind:
            members = members_of(kind, options, lines, sets, known)
        else:
            continue
        name = sets.written(options[kind])
        sets[name] = np.union1d(sets.get(name, members), members).astype(np.int64)
    return sets


def members_of(kind: str, options: dict[str, str], lines: list[list[str]], sets: SetsByName, known: Ids) -> Ids:
    """Return ids of an `*ELSET` or `*NSET` section."""
    what = "element" if kind == "ELSET" else "node"
    members = [np.empty(0, dtype=np.int64)]
    for line in lines:
        words = [word.strip() for word in line if word.strip()]
        if "GENERATE" in options:
            members.append(generated(words, what, known))
            continue
        named = [word for word in words if not word.lstrip("+-").isdigit()]
        for word in named:
            if sets.written(word) not in sets:
                raise Damaged(
                    f"{what.capitalize()} set {options[kind][:60]!r} names the set {word[:60]!r}, which is not defined above it. "
                    f"Move or add its *{kind}"
                )
            members.append(sets[sets.written(word)])
        others = [word for word in words if word not in named]
        members.append(np.array(whole(others) if others else [], dtype=np.int64))
    found = np.concatenate(members)
    check_known(found, known, what, f"{what.capitalize()} set {options[kind][:60]!r}")
    return found


def generated(words: list[str], what: str, known: Ids) -> Ids:
    """Return the known ids from a known first one to a known last one, in steps."""
    numbers = whole(words)
    first, last, step = [*numbers, 1][:3] if len(numbers) in (2, 3) else (0, -1, 0)
    if last < first or step < 1:
        raise Damaged(f"GENERATE has {', '.join(words)[:60]!r}; expected the first {what}, the last one, and a step")
    check_known(np.array([first, last - (last - first) % step]), known, what, "GENERATE")
    return known[(known >= first) & (known <= last) & ((known - first) % step == 0)]


class SetsByName(dict[str, Ids]):
    """Sets by the name that was written first: upper and lower case count as the same."""

    def __init__(self) -> None:
        self._first: dict[str, str] = {}

    def written(self, name: str) -> str:
        """Return the name as it was first written."""
        return self._first.setdefault(name.upper(), name)


def whole(words: list[str]) -> list[int]:
    """Return ids of at most 18 digits."""
    together = "".join("".join(words).split())
    if not (together.isascii() and together.isdigit() and max(map(len, words)) <= 18):
        raise Damaged(f"{', '.join(words)[:60]!r} was found; expected ids")
    return [int(word) for word in words]


class Files:
    """File with the files that it includes: from its folder or below, with limits on depth and number."""

    def __init__(self, path: Path) -> None:
        self.path, self.count = path, 0

    def sections(self) -> Iterator[Section]:
        """Yield the sections of the file and of the files that it includes, in their order."""
        keyword, options, lines = "", dict[str, str](), list[list[str]]()
        for line in self.lines(self.path, 0):
            if not line.startswith("*"):
                lines.append(line.split(","))
                continue
            yield keyword, options, lines
            keyword, options = head_of(line)
            if not keyword[:1].isalpha():
                raise Damaged(f"{line[:60]!r} was found; expected a keyword")
            lines = []
        yield keyword, options, lines

    def lines(self, path: Path, depth: int) -> Iterator[str]:
        """Yield the lines except comments; `*INCLUDE` yields the lines of the included file."""
        self.enter(path, depth)
        with Source(path) as source:
            check_last_line(source.file)
            source.file.seek(0)
            for raw in iter(source.raw_line, b""):
                line = raw.decode(errors="replace").strip()
                if not line or line.startswith("**"):
                    continue
                if line[0] == "*" and head_of(line)[0] == "INCLUDE":
                    yield from self.lines(self.included(head_of(line)[1].get("INPUT", "")), depth + 1)
                else:
                    yield line

    def every(self, path: Path, depth: int = 0) -> Iterator[Path]:
        """Yield the files that a file includes, and the files that these include."""
        self.enter(path, depth)
        with Source(path) as source:
            lines = [raw for raw in iter(source.raw_line, b"") if INCLUDE.match(raw)]
        for line in lines:
            found = self.included(head_of(line.decode(errors="replace").strip())[1].get("INPUT", ""))
            yield found
            yield from self.every(found, depth + 1)

    def enter(self, path: Path, depth: int) -> None:
        """Count a file, and refuse files that are included too deep, or too many."""
        self.count += 1
        if depth > DEEPEST or self.count > MOST_FILES:
            raise Damaged(f"it includes files more than {DEEPEST} deep, or more than {MOST_FILES}: itself? {path.name[:60]}")

    def included(self, name: str) -> Path:
        """Return a regular file in the folder of the mesh file, or below."""
        folder = self.path.resolve().parent
        path = (folder / name).resolve()
        if not name or not path.is_relative_to(folder):
            raise Damaged(f"it includes {name[:80]!r}, which is not in its folder {folder}: copy it there")
        return path


def head_of(line: str) -> tuple[str, dict[str, str]]:
    """Return the keyword in upper case, and the options.

    >>> head_of("*Element, type=C3D4, ELSET=Steel")
    ('ELEMENT', {'TYPE': 'C3D4', 'ELSET': 'Steel'})
    """
    head, *rest = line[1:].split(",")
    pairs = (word.partition("=") for word in rest)
    return head.strip().upper(), {key.strip().upper(): value.strip() for key, _, value in pairs}
