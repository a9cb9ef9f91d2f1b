"""Polygon files (.ply), which meshio reads: whether they hold what they declare."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .source import Damaged, Source, check_last_line, count_of

TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4", "double": "f8"}
TYPES |= {
    f"{name}{8 * size}": f"{kind}{size}" for name, kind in (("int", "i"), ("uint", "u"), ("float", "f")) for size in (1, 2, 4, 8)
}


def check(path: Path) -> tuple[int, int]:
    """Number of vertices and faces."""
    with Source(path, comments=("comment", "obj_info")) as source:
        source.expect("ply", "the beginning")
        form = source.line()
        counts: dict[str, int] = {}
        properties: dict[str, list[list[str]]] = {}
        name = ""
        while (line := source.line()) and line != "end_header":
            words = line.split()
            if words[0] == "element" and len(words) == 3 and words[1] not in counts:
                name = words[1]
                counts[name], properties[name] = count_of(words[2], name), []
            elif words[0] == "property" and name and not set(words[1:-1]) - {"list", *TYPES}:
                properties[name].append(words[1:])
            else:
                raise Damaged(f"{line[:60]!r} stands in its header")
        if set(counts) != {"vertex", "face"} or list(counts) != ["vertex", "face"]:
            raise Damaged(f"it holds {', '.join(counts)[:60] or 'nothing'}; expected vertices and faces")
        lists = [number for number, words in enumerate(properties["face"]) if words[0] == "list"]
        if len(lists) != 1 or properties["face"][lists[0]][-1] != "vertex_indices":
            raise Damaged("its faces have not one list, vertex_indices")
        if form == "format ascii 1.0":
            text(source, counts, len(properties["vertex"]), len(properties["face"]), lists[0])
        else:
            order = {"format binary_little_endian 1.0": "<", "format binary_big_endian 1.0": ">"}.get(form)
            if order is None or len(properties["face"]) != 1:
                raise Damaged(
                    "its faces have more than vertex_indices; write it as text" if order else f"{form[:60]!r} is not known here"
                )
            vertex = sum(np.dtype(TYPES[words[0]]).itemsize for words in properties["vertex"])
            binary(source, counts, vertex, *(np.dtype(order + TYPES[kind]) for kind in properties["face"][0][1:3]))
    return counts["vertex"], counts["face"]


def text(source: Source, counts: dict[str, int], of_vertex: int, of_face: int, place: int) -> None:
    """A row for each vertex and for each face, whose list begins with its length."""
    bad = [row for row in source.rows("vertices", counts["vertex"]) if len(row) != of_vertex]
    bad += [
        row
        for row in source.rows("faces", counts["face"])
        if len(row) != of_face + count_of((*row, *" " * of_face)[place], "vertices")
    ]
    if bad:
        raise Damaged(f"the row {' '.join(bad[0])[:60]!r} has not as many numbers as its header says")
    source.expect("", f"its {counts['face']} faces")
    check_last_line(source.file)


def binary(source: Source, counts: dict[str, int], of_vertex: int, length: np.dtype, index: np.dtype) -> None:
    """Vertices of equal size, and faces of which each says how many indices it has."""
    source.fits("vertices", counts["vertex"], of_vertex)
    source.fits("faces", counts["face"], length.itemsize)
    source.file.seek(counts["vertex"] * of_vertex, 1)
    data, place = source.file.read(), 0
    for face in range(counts["face"]):
        if place + length.itemsize > len(data):
            raise Damaged(f"{counts['face']} faces are declared, {face} are there")
        corners = int(np.frombuffer(data, length, 1, place)[0])
        if corners < 3:
            raise Damaged(f"its face {face} has {corners} vertices")
        place += length.itemsize + index.itemsize * corners
    if place != len(data):
        raise Damaged(f"its {counts['face']} faces take {place} bytes, {len(data)} are there")
