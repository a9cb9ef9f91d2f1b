"""Medit's text files (.mesh) of Gmsh, TetGen, Mmg and others: nodes, elements up to second order, and their references."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np

from .stream import CutOff, Damaged, Source, check_known, count_of

#: Types of cells in meshio's terms, and their nodes in VTK's order if the file has another one, by section.
CELLS: dict[str, tuple[str, int, tuple[int, ...]]] = {
    "Edges": ("line", 2, ()),
    "Triangles": ("triangle", 3, ()),
    "Quadrilaterals": ("quad", 4, ()),
    "Tetrahedra": ("tetra", 4, ()),
    "Pyramids": ("pyramid", 5, ()),
    "Prisms": ("wedge", 6, ()),
    "Hexahedra": ("hexahedron", 8, ()),
    "Hexaedra": ("hexahedron", 8, ()),
    "EdgesP2": ("line3", 3, ()),
    "TrianglesP2": ("triangle6", 6, ()),
    "QuadrilateralsQ2": ("quad9", 9, ()),
    "TetrahedraP2": ("tetra10", 10, ()),
}
#: Numbers of an entry of sections that mark some entities, or have vectors; `d` is the number of coordinates.
OTHERS = {
    **dict.fromkeys(("Corners", "RequiredVertices", "Ridges", "RequiredEdges", "RequiredTriangles", "RequiredQuadrilaterals"), "1"),
    **dict.fromkeys(("NormalAtVertices", "TangentAtVertices", "VertexOnGeometricVertex", "EdgeOnGeometricEdge"), "2"),
    "VertexOnGeometricEdge": "3",
    "SubDomainFromMesh": "4",
    **dict.fromkeys(("Normals", "Tangents"), "d"),
}


def read(path: Path) -> meshio.Mesh:
    """Read nodes and elements; the array `medit:ref` has the reference of each element."""
    with Source(path, comments=("#",)) as source:
        words: list[str] = []

        def word(what: str) -> str:
            """Return the next word of text, which may be on the line of the one before."""
            if not words:
                words.extend(source.line().split())
            if not words:
                raise CutOff(f"it ends where {what} is expected")
            return words.pop(0)

        if (first := word("MeshVersionFormatted")) != "MeshVersionFormatted":
            mfem = (
                " It is a mesh of MFEM: convert it in MFEM with ParaViewDataCollection, or mesh.PrintVTK" if first == "MFEM" else ""
            )
            raise Damaged(f"{first[:60]!r} was found; expected MeshVersionFormatted.{mfem}")
        word("the version")
        seen, d, points, cells, references = set[str](), 0, None, [], []
        while words or (line := source.line()):
            if not words:
                words.extend(line.split())
            name = word("a section")
            if name == "End":
                break
            if name in seen:
                raise Damaged(f"the section {name[:60]} occurs twice")
            seen.add(name)
            if name == "Dimension":
                d = count_of(word("the dimension"), "coordinates")
                continue
            if name in ("Identifier", "Geometry"):
                source.line()
                continue
            if name not in CELLS and name not in OTHERS and name != "Vertices":
                raise Damaged(f"{name[:60]!r} was found; expected the beginning of a section, or numbers")
            count = count_of(word(f"the number of {name}"), name)
            if words or d not in (2, 3):
                raise Damaged(
                    f"{' '.join(words)[:60]!r} follows the number of {name}" if words else f"its dimension is {d}; expected 2 or 3"
                )
            if name == "Vertices":
                points = source.numbers(name, count, d + 1)[:, :d]
            elif name in CELLS:
                kind, n, order = CELLS[name]
                table = source.numbers(name, count, n + 1, np.int64)
                cells.append((kind, table[:, :n] - 1 if not order else table[:, order] - 1))
                references.append(table[:, n])
            else:
                source.numbers(name, count, d if OTHERS[name] == "d" else int(OTHERS[name]))
    if points is None:
        raise Damaged("it has no Vertices")
    for _, nodes in cells:
        check_known(nodes + 1, np.arange(1, len(points) + 1), "vertex", "its elements")
    return meshio.Mesh(points, cells, cell_data={"medit:ref": references})
