"""Binary formats that meshio reads, each checked before for the content that it declares: Medit, PLY and STL."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from .stream import Counts, CutOff, Damaged, Source
from .texts import TEXTS, counted, heads

#: Numbers per entry of Medit's sections of cells, by their keywords.
MEDIT_CELLS = {5: 3, 6: 4, 7: 5, 8: 5, 9: 7, 10: 9, 49: 6}
MEDIT_VERTICES, MEDIT_END = 4, 54
#: NumPy's types for the types of polygon files.
PLY = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4", "double": "f8"}
PLY |= {f"{word}{8 * size}": f"{word[:1]}{size}" for word in ("int", "uint", "float") for size in (1, 2, 4, 8)}


def medit(path: Path) -> Counts:
    """Return the number of vertices and cells of Medit's binary file, in which each section states the start of the next."""
    with Source(path, binary=True) as source:

        def whole(kind: str) -> int:
            return int(source.numbers("heads of sections", 1, 1, kind)[0, 0])

        code = whole("<i4")
        order = {1: "<", 16777216: ">"}.get(code, "<")
        word, version = f"{order}i4", whole(f"{order}i4")
        if code not in (1, 16777216) or version not in (1, 2, 3, 4):
            raise Damaged(f"it begins with the code {code} and the version {version}")
        offset_type, size, real = f"{order}i{4 if version < 3 else 8}", 8 if version == 4 else 4, 4 if version == 1 else 8
        keyword, _, dimension = whole(word), whole(offset_type), whole(word)
        if keyword != 3 or dimension not in (2, 3):
            raise Damaged(f"its dimension is {dimension}; expected 2 or 3")
        widths = {MEDIT_VERTICES: dimension * real + size} | {of: columns * size for of, columns in MEDIT_CELLS.items()}
        counts: dict[int, int] = {}
        while (keyword := whole(word)) != MEDIT_END:
            end = whole(offset_type)
            if keyword in counts:
                raise Damaged(f"the section {keyword} occurs twice")
            counts[keyword] = whole(f"{order}i{size}") if keyword in widths else 0
            after = source.file.tell() + counts[keyword] * widths.get(keyword, 0)
            if not after <= end <= source.size or (keyword in widths and after != end):
                raise Damaged(f"its section {keyword} of {counts[keyword]} entries ends at byte {end} of {source.size}")
            source.file.seek(end)
    return counts.get(MEDIT_VERTICES, 0), sum(counts.get(of, 0) for of in MEDIT_CELLS)


def ply(path: Path) -> Counts:
    """Return the number of vertices and faces of a polygon file, text or binary; each face states its number of indices."""
    text = TEXTS[".ply"]
    with Source(path, comments=text.comments) as source:
        head = next((match for _, match in heads(source, text.sections)), None)
        if head is None or head["form"] == "ascii":
            return counted(path)
        order = {"binary_little_endian": "<", "binary_big_endian": ">"}.get(head["form"], "")
        kinds = [word for line in head["of_vertex"].splitlines() for word in line.split()[1:2]] + head["of_face"].split()
        if not order or head["more"] or set(kinds) - set(PLY):
            raise Damaged("its faces have more than vertex_indices, or its numbers have unsupported types")
        *of_vertex, length, index = (np.dtype(order + PLY[kind]) for kind in kinds)
        vertices, faces = int(head["nodes"]), int(head["cells"])
        before = vertices * sum(kind.itemsize for kind in of_vertex)
        source.fits("vertices and faces", 1, before + faces * length.itemsize)
        source.file.seek(before, 1)
        found = faces_of(source.file.read(), faces, length, index)
    return vertices, found


def faces_of(data: bytes, faces: int, length: np.dtype[Any], index: np.dtype[Any]) -> int:
    """Return the number of faces, each its number of indices and the indices, that take all of the data; refuse others."""
    offset = 0
    for face in range(faces):
        if offset + length.itemsize > len(data):
            raise CutOff(f"{faces} faces are declared, {face} were found")
        corners = int(np.frombuffer(data, length, 1, offset)[0])
        if corners < 3:
            raise Damaged(f"its face {face} has {corners} vertices")
        offset += length.itemsize + index.itemsize * corners
    if offset != len(data):
        raise Damaged(f"its {faces} faces take {offset} bytes, {len(data)} were found")
    return faces


def stl(path: Path) -> Counts:
    """Return the number of triangles of stereolithography, as text, or in binary with their number."""
    size = path.stat().st_size
    with Source(path, binary=True) as source:
        source.file.seek(min(80, size))
        count = int(np.frombuffer(source.file.read(4), "<u4")[0]) if size >= 84 else -1
        if size == 84 + 50 * count:
            return None, count
        source.file.seek(0)
        words = [line.split() for line in iter(source.line, "")]
        if words[:1] and words[0][0] != "solid":
            raise Damaged(f"it is binary and declares {count} triangles, which take {84 + 50 * count} bytes; {size} were found")
    shape = ["facet", "outer", "vertex", "vertex", "vertex", "endloop", "endfacet"]
    faces = (len(words) - 2) // 7
    odd = any(len(row) != 4 for row in words if row[0] == "vertex")
    if odd or [row[0] for row in words] != ["solid", *faces * shape, "endsolid"]:
        raise Damaged("its lines are not facets of three vertices each between one solid and one endsolid")
    return None, faces
