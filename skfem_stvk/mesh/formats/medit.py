"""Medit's meshes, as text (.mesh) and binary (.meshb), which meshio reads: whether they hold what they declare."""

from __future__ import annotations

from pathlib import Path

from .source import Damaged, Source, count_of

#: Numbers of an entry of each section, its tag included; of those that depend on the dimension, without it.
CELLS = {
    "Edges": 3,
    "Triangles": 4,
    "Quadrilaterals": 5,
    "Tetrahedra": 5,
    "Prisms": 7,
    "Pyramids": 6,
    "Hexahedra": 9,
    "Hexaedra": 9,
}
OTHERS = {
    "Corners": 1,
    "RequiredVertices": 1,
    "Ridges": 1,
    "RequiredEdges": 1,
    "NormalAtVertices": 2,
    "TangentAtVertices": 2,
    "SubDomainFromMesh": 4,
    "VertexOnGeometricVertex": 2,
    "VertexOnGeometricEdge": 3,
    "EdgeOnGeometricEdge": 2,
}
WITH_DIMENSION = {"Vertices": 1, "Normals": 0, "Tangents": 0}
#: The same by the keywords of binary files, which begin with Vertices.
BINARY = {5: 3, 6: 4, 7: 5, 8: 5, 9: 7, 10: 9, 49: 6}
VERTICES, END = 4, 54


def text(path: Path) -> tuple[int, int]:
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
            columns = CELLS.get(name, OTHERS.get(name, WITH_DIMENSION.get(name, -1) + dim if name in WITH_DIMENSION else 0))
            if columns < 1 or words:
                raise Damaged(f"{line[:60]!r} stands where a section should begin")
            count = count_of(source.line(), name)
            source.numbers(name, count, columns)
            nodes += count if name == "Vertices" else 0
            cells += count if name in CELLS else 0
    raise Damaged("it has no End")


def binary(path: Path) -> tuple[int, int]:
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
            if keyword == END:
                return nodes, cells
            if keyword in seen:
                raise Damaged(f"the section {keyword} stands twice")
            seen.add(keyword)
            if keyword == VERTICES or keyword in BINARY:
                count = int(source.numbers("numbers of entries", 1, 1, f"{order}i{whole}")[0, 0])
                width = head[2] * real + whole if keyword == VERTICES else BINARY[keyword] * whole
                source.fits("entries", count, width)
                source.file.seek(count * width, 1)
                nodes, cells = (nodes + count, cells) if keyword == VERTICES else (nodes, cells + count)
                if end != source.file.tell():
                    raise Damaged(f"its section {keyword} declares {count} entries, which do not end where the next section begins")
            elif not source.file.tell() < end <= source.size:
                raise Damaged(f"its section {keyword} ends at byte {end} of {source.size}")
            source.file.seek(end)
