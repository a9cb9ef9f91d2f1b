"""Formats in sections that declare their entries, which meshio reads: Medit's, and Fluent's as meshio writes them.

Each function gives the number of nodes and of elements that are declared, if the file holds as many.
"""

from __future__ import annotations

import re
from pathlib import Path

from .source import Damaged, Source, count_of

#: Numbers of an entry of each section, its tag included; of those that depend on the dimension, without it.
MEDIT_CELLS = {"Edges": 3, "Triangles": 4, "Quadrilaterals": 5, "Tetrahedra": 5, "Pyramids": 6, "Prisms": 7}
MEDIT_CELLS |= {"Hexahedra": 9, "Hexaedra": 9}
MEDIT_OTHERS = {
    **dict.fromkeys(("Corners", "RequiredVertices", "Ridges", "RequiredEdges"), 1),
    **dict.fromkeys(("NormalAtVertices", "TangentAtVertices", "VertexOnGeometricVertex", "EdgeOnGeometricEdge"), 2),
    **{"VertexOnGeometricEdge": 3, "SubDomainFromMesh": 4},
}
MEDIT_BY_DIMENSION = {"Vertices": 1, "Normals": 0, "Tangents": 0}
#: The same by the keywords of binary files, which begin with Vertices.
MEDIT_CODES = {5: 3, 6: 4, 7: 5, 8: 5, 9: 7, 10: 9, 49: 6}
MEDIT_VERTICES, MEDIT_END = 4, 54
#: Nodes of the cells by their types.
FLUENT_CELLS = {1: 3, 2: 4, 3: 4, 4: 8, 5: 5, 6: 6}
#: A section: 10 for points, 12 for cells, after 20 or 30 if its numbers are binary in 32 or 64 bits; its zone, first and last
#: number in hexadecimals, type of the zone, and dimension or type of the cells.
FLUENT_SECTION = re.compile(r"\((20|30|)(10|12) \((\w+) (\w+) (\w+) (\w+)(?: (\w+))?\)(\()?\)?\)?")


def medit(path: Path) -> tuple[int, int]:
    """Number of vertices and cells of a file of text."""
    dim, nodes, cells, seen = 0, 0, 0, set[str]()
    with Source(path, comments=("#",)) as source:
        while line := source.line():
            name, *words = line.split()
            if name in seen:
                raise Damaged(f"{name[:60]} stands twice")
            seen.add(name)
            if name == "End":
                source.expect("", "End")
                return nodes, cells
            if name == "MeshVersionFormatted":
                continue
            if name in ("Identifier", "Geometry"):
                source.line()
                continue
            if name == "Dimension":
                dim = count_of(words[0] if words else source.line(), "dimensions")
                continue
            known = MEDIT_CELLS | MEDIT_OTHERS | {of: more + dim for of, more in MEDIT_BY_DIMENSION.items()}
            columns = known.get(name, 0)
            if columns < 1 or words:
                raise Damaged(f"{line[:60]!r} stands where a section should begin")
            count = count_of(source.line(), name)
            source.numbers(name, count, columns)
            nodes += count if name == "Vertices" else 0
            cells += count if name in MEDIT_CELLS else 0
    raise Damaged("it has no End")


def medit_binary(path: Path) -> tuple[int, int]:
    """Number of vertices and cells of a binary file, where each section says where the next one begins."""
    with Source(path, binary=True) as source:
        code = int(source.numbers("codes", 1, 1, "<i4")[0, 0])
        order = {1: "<", 16777216: ">"}.get(code)
        version = int(source.numbers("versions", 1, 1, f"{order or '<'}i4")[0, 0])
        if order is None or version not in (1, 2, 3, 4):
            raise Damaged(f"it begins with the code {code} and the version {version}")
        place, real = f"{order}i{4 if version < 3 else 8}", 4 if version == 1 else 8
        whole = 8 if version == 4 else 4
        word = f"{order}i4"
        head = [int(source.numbers("heads", 1, 1, kind)[0, 0]) for kind in (word, place, word)]
        if head[0] != 3 or head[2] not in (2, 3):
            raise Damaged(f"its dimension is {head[2]}; expected 2 or 3")
        nodes, cells, seen = 0, 0, set[int]()
        while True:
            keyword, end = (int(source.numbers("heads of sections", 1, 1, kind)[0, 0]) for kind in (word, place))
            if keyword == MEDIT_END:
                return nodes, cells
            if keyword in seen:
                raise Damaged(f"the section {keyword} stands twice")
            seen.add(keyword)
            if keyword == MEDIT_VERTICES or keyword in MEDIT_CODES:
                count = int(source.numbers("numbers of entries", 1, 1, f"{order}i{whole}")[0, 0])
                width = head[2] * real + whole if keyword == MEDIT_VERTICES else MEDIT_CODES[keyword] * whole
                source.fits("entries", count, width)
                source.file.seek(count * width, 1)
                nodes, cells = (nodes + count, cells) if keyword == MEDIT_VERTICES else (nodes, cells + count)
                if end != source.file.tell():
                    raise Damaged(f"its section {keyword} declares {count} entries, which do not end where the next section begins")
            elif not source.file.tell() < end <= source.size:
                raise Damaged(f"its section {keyword} ends at byte {end} of {source.size}")
            source.file.seek(end)


def fluent(path: Path) -> tuple[int, int]:
    """Number of points and cells."""
    declared, found = {"10": 0, "12": 0}, {"10": 0, "12": 0}
    with Source(path) as source:
        while line := source.line():
            section = FLUENT_SECTION.fullmatch(line)
            if section is None:
                if not re.fullmatch(r"\([012] .*\)", line):
                    raise Damaged(
                        f"{line[:60]!r} stands where points or cells should; Fluent's own files hold faces, not cells: convert them"
                    )
                continue
            binary, kind, _, *ends, _, shape, opens = section.groups()
            first, last = (int(number, 16) for number in ends)
            if not opens:
                declared[kind] = last
                continue
            columns = int(shape or "0", 16) if kind == "10" else FLUENT_CELLS.get(int(shape or "0", 16), 0)
            if not columns:
                raise Damaged(f"{line[:60]!r} is of a type that is not known here")
            fluent_entries(source, last - first + 1, columns, binary, kind)
            found[kind] += last - first + 1
    for what, kind in (("points", "10"), ("cells", "12")):
        if declared[kind] != found[kind]:
            raise Damaged(f"{declared[kind]} {what} are declared, {found[kind]} are there")
    return found["10"], found["12"]


def fluent_entries(source: Source, count: int, columns: int, binary: str, kind: str) -> None:
    """The numbers of a section and its end."""
    what = "points" if kind == "10" else "cells"
    source.binary = bool(binary)
    if binary:
        size = {"20": 4, "30": 8}[binary]
        source.numbers(what, count, columns, f"{'f' if kind == '10' else 'i'}{size}")
        source.expect(f")End of Binary Section {binary}{kind})", f"its {count} {what}")
        return
    if any(len(row) != columns or "))" in row for row in source.rows(what, count)):
        raise Damaged(f"its {what} have not {columns} numbers in each row")
    source.expect("))", f"its {count} {what}")
