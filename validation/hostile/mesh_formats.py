"""A good file of every mesh format, and where in it counts, ids, coordinates and rows stand."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from contextlib import redirect_stderr
from dataclasses import dataclass, field
from functools import lru_cache
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import meshio
import numpy as np
import skfem

from skfem_stvk import ElementMesh
from skfem_stvk.mesh import read_mesh

#: A number with an exponent or a point, as coordinates are written.
REAL = r"-?\d+\.\d*(?:[eE][-+]?\d+)?"


@dataclass(frozen=True)
class Format:
    """A format.

    Attributes
    ----------
    suffix : of its files.
    options : of `meshio.write`.
    flat : whether it holds triangles only.
    second : whether the elements are of second order.
    counts : expressions whose group is a number of entries, of files of text.
    ids : expressions whose group is the id of a node or an element, where it is defined.
    references : expressions whose group is the id of a node that an element names.
    element : expression of a whole row of an element.
    counted : whether its header says how many elements there are.
    edit : makes the file right, where meshio writes it wrongly.
    """

    suffix: str
    options: dict[str, Any] = field(default_factory=dict)
    flat: bool = False
    counts: tuple[str, ...] = ()
    ids: tuple[str, ...] = ()
    references: tuple[str, ...] = ()
    element: str = ""
    counted: bool = True
    edit: Callable[[bytes], bytes] = bytes
    second: bool = False


def without_types(content: bytes) -> bytes:
    """Without the types of NumPy, which meshio writes to .ugrid files."""
    for name in (b"np.int64(", b"np.int32(", b"np.float64("):
        content = content.replace(name, b"")
    return content.replace(b")", b"")


FORMATS: dict[str, Format] = {
    "msh 2.2": Format(
        ".msh",
        {"file_format": "gmsh22", "binary": False},
        counts=(r"\$Nodes\n(\d+)", r"\$Elements\n(\d+)", r"\n3 4 (2) "),
        ids=(rf"\n(3) {REAL}", r"\n(3) 4 2", r"\n3 (4) 2 "),
        references=(r"\n3 4 2 \d+ \d+ (\d+)",),
        element=r"\n(?=3 4 2)[^\n]+",
    ),
    "msh 2.2 binary": Format(".msh", {"file_format": "gmsh22", "binary": True}),
    "msh 4.1": Format(
        ".msh",
        {"file_format": "gmsh", "binary": False},
        counts=(
            r"\$Nodes\n(\d+)",
            r"\$Nodes\n\d+ (\d+)",
            r"\n3 0 0 (\d+)",
            r"\$Elements\n(\d+)",
            r"\$Elements\n\d+ (\d+)",
            r"\n3 \d+ 4 (\d+)\n",
        ),
        ids=(r"\n2\n(3)\n", r"\n(3)(?: \d+){4}\n", r"\n3 \d+ (4) \d+\n"),
        references=(r"\n3 (\d+) \d+ \d+ \d+",),
        element=r"\n(?=3 \d+ \d+ \d+ \d+)[^\n]+",
    ),
    "msh 4.1 binary": Format(".msh", {"file_format": "gmsh", "binary": True}),
    "msh of Fluent": Format(
        ".msh",
        {"file_format": "ansys", "binary": False},
        counts=(r"\(10 \(0 1 (\w+)", r"\(12 \(0 1 (\w+)", r"\(10 \(1 1 (\w+)", r"\(12 \(1 0 (\w+)", r"\(12 \(1 0 \w+ 1 (2)"),
        references=(r"\(12 \(1 0 [^\n]+\n(\w+) ",),
        element=r"(?<=\n)\w+ \w+ \w+ \w+\n",
    ),
    "msh of Fluent, binary": Format(
        ".msh", {"file_format": "ansys", "binary": True}, counts=(r"\(12 \(0 1 (\w+)", r"\(2012 \(1 0 (\w+)")
    ),
    "vtk": Format(
        ".vtk",
        {"file_format": "vtk42", "binary": False},
        counts=(
            r"POINTS (\d+)",
            r"CELLS (\d+)",
            r"CELLS \d+ (\d+)",
            r"CELL_TYPES (\d+)",
            r"CELL_DATA (\d+)",
            r"CELLS[^\n]*\n(4)",
            r"material 1 (\d+)",
            r"FieldData (1)",
        ),
        ids=(r"CELL_TYPES \d+\n(10)",),
        references=(r"CELLS[^\n]*\n4\n(\d+)",),
    ),
    "vtk binary": Format(
        ".vtk",
        {"file_format": "vtk42", "binary": True},
        counts=(r"POINTS (\d+)", r"CELLS (\d+)", r"CELLS \d+ (\d+)", r"CELL_TYPES (\d+)", r"CELL_DATA (\d+)", r"material 1 (\d+)"),
    ),
    "vtk 5.1": Format(
        ".vtk",
        {"file_format": "vtk", "binary": False},
        counts=(
            r"POINTS (\d+)",
            r"CELLS (\d+)",
            r"CELLS \d+ (\d+)",
            r"CELL_TYPES (\d+)",
            r"CELL_DATA (\d+)",
            r"OFFSETS \w+\n0\n(4)",
        ),
        ids=(r"CELL_TYPES \d+\n(10)",),
        references=(r"CONNECTIVITY \w+\n(\d+)",),
    ),
    "vtk 5.1 binary": Format(
        ".vtk",
        {"file_format": "vtk", "binary": True},
        counts=(r"POINTS (\d+)", r"CELLS (\d+)", r"CELLS \d+ (\d+)", r"CELL_TYPES (\d+)", r"CELL_DATA (\d+)"),
    ),
    "vtu": Format(
        ".vtu",
        {"binary": False},
        counts=(r'NumberOfPoints="(\d+)"', r'NumberOfCells="(\d+)"', r'NumberOfComponents="(\d+)"', r'"offsets"[^>]*>\s*(4)\s'),
        ids=(r'"types"[^>]*>\s*(10)\s',),
        references=(r'"connectivity"[^>]*>\s*(\d+)\s',),
    ),
    "vtu binary": Format(
        ".vtu", {"binary": True}, counts=(r'NumberOfPoints="(\d+)"', r'NumberOfCells="(\d+)"', r'NumberOfComponents="(\d+)"')
    ),
    "vtu in base64": Format(
        ".vtu",
        {"binary": True, "compression": None},
        counts=(r'NumberOfPoints="(\d+)"', r'NumberOfCells="(\d+)"', r'NumberOfComponents="(\d+)"'),
    ),
    "inp": Format(
        ".inp",
        ids=(rf"\n(3), {REAL}", r"\n(3),\d+,", r"TYPE=(C3D4)"),
        references=(r"\n3,(\d+),",),
        element=r"\n(?=3,\d+)[^\n]+",
        counted=False,
    ),
    "inp second order": Format(
        ".inp",
        ids=(rf"\n(3), {REAL}", r"\n(3),\d+,", r"TYPE=(C3D10\w*)"),
        references=(r"\n3,(\d+),",),
        element=r"\n(?=3,\d+)[^\n]+",
        counted=False,
        second=True,
    ),
    "vtk second order": Format(
        ".vtk",
        {"binary": False},
        counts=(r"POINTS (\d+)", r"CELLS (\d+)", r"CELL_TYPES (\d+)"),
        second=True,
    ),
    "medit": Format(
        ".mesh",
        counts=(r"Vertices\n(\d+)", r"Tetrahedra\n(\d+)", r"Dimension (\d)"),
        references=(r"Tetrahedra\n\d+\n(\d+) ",),
        element=r"\n\d+ \d+ \d+ \d+ \d+(?=\n)",
    ),
    "medit binary": Format(".meshb"),
    "nastran": Format(
        ".bdf",
        ids=(r"\nGRID\*   (3)   ", r"\nCTETRA  (3)  ", r"\n(CTETRA)  3"),
        references=(r"\nCTETRA  3       +(\d+) ",),
        element=r"\n(?=CTETRA  3 )[^\n]+",
        counted=False,
    ),
    "su2": Format(
        ".su2",
        counts=(r"NPOIN= (\d+)", r"NELEM= (\d+)", r"NDIME= (\d)", r"NMARK= (\d+)"),
        ids=(r"NELEM[^\n]*\n(10) ",),
        references=(r"\n10 (\d+) ",),
        element=r"\n10 [^\n]+",
    ),
    "avs": Format(
        ".avs",
        counts=(r"\n(\d+) \d+ 0 0 0", r"\n\d+ (\d+) 0 0 0", r"\n\d+ \d+ (0) 0 0", r"\n\d+ \d+ 0 (0) 0"),
        ids=(rf"\n(3) {REAL} ", r"\n(3) \d+ tet", r"\n3 \d+ (tet)"),
        references=(r"\n3 \d+ tet (\d+)",),
        element=r"\n(?=3 \d+ tet)[^\n]+",
    ),
    "tetgen": Format(
        ".ele",
        counts=(r"\n(\d+) 4 1\n", r"\n\d+ (4) 1\n", r"\n\d+ 4 (1)\n"),
        ids=(r"\n(3) \d+ \d+ \d+ \d+ \d+",),
        references=(r"\n3 (\d+) ",),
        element=r"\n(?=3 \d+ \d+ \d+ \d+ \d+)[^\n]+",
    ),
    "tetgen nodes": Format(
        ".node", counts=(r"\n(\d+) 3 0 0", r"\n\d+ (3) 0 0", r"\n\d+ 3 (0) 0", r"\n\d+ 3 0 (0)"), ids=(rf"\n(3) {REAL}",)
    ),
    "netgen": Format(
        ".vol",
        counts=(r"volumeelements\n(\d+)", r"\npoints\n(\d+)", r"volumeelements\n\d+\n\d+ (4) ", r"dimension\n(\d)"),
        references=(r"volumeelements\n\d+\n\d+ 4 (\d+) ",),
        element=r"(?<=\n)\d+ 4 \d+ \d+ \d+ \d+\n",
    ),
    "netgen, packed": Format(".vol.gz", edit=lambda content: content if content[:2] == b"\x1f\x8b" else gzip.compress(content)),
    "flac3d": Format(
        ".f3grid",
        {"binary": False},
        ids=(r"\nG\s+(3)\s", r"\nZ T4 (3) ", r"\nZ (T4) 3 "),
        references=(r"\nZ T4 3 (\d+)",),
        element=r"\nZ T4 3 [^\n]+",
        counted=False,
    ),
    "flac3d binary": Format(".f3grid", {"binary": True}),
    "permas": Format(
        ".dato",
        ids=(rf"\n(3) {REAL}", r"TYPE=(TET4)"),
        references=(r"\n3 (\d+) \d+ \d+ \d+\n",),
        element=r"\n(?=3 \d+ \d+ \d+ \d+\n)[^\n]+",
        counted=False,
    ),
    "mdpa": Format(
        ".mdpa",
        ids=(rf"\n (3) {REAL}", r"\n (3) \d+  \d+", r"Elements (Tetrahedra3D4)"),
        references=(r"\n 3 \d+  (\d+) ",),
        element=r"\n(?= 3 \d+  \d+)[^\n]+",
        counted=False,
    ),
    "ugrid": Format(
        ".ugrid",
        counts=(r"^(\d+) ", r"^\d+ (\d+) ", r"^\d+ \d+ \d+ (\d+)", r"^\d+ \d+ \d+ \d+ (\d+)"),
        references=(r"\n(\d+) \d+ \d+ \d+\n",),
        element=r"(?<=\n)\d+ \d+ \d+ \d+\n",
        edit=without_types,
    ),
    "ugrid binary": Format(".lb8.ugrid"),
    "tecplot": Format(
        ".dat",
        counts=(r"NODES = (\d+)", r"ELEMENTS = (\d+)"),
        references=(r"\n(\d+) \d+ \d+ \d+\n",),
        element=r"(?<=\n)\d+ \d+ \d+ \d+\n",
    ),
    "dolfin": Format(
        ".xml",
        counts=(r'vertices size="(\d+)"', r'cells size="(\d+)"'),
        ids=(r'<vertex index="(3)"', r'<tetrahedron index="(3)"'),
        references=(r'<tetrahedron index="3" v0="(\d+)"',),
        element=r'\s*<tetrahedron index="3"[^\n]+',
    ),
    "off": Format(
        ".off",
        {},
        True,
        counts=(r"\n(\d+) \d+ 0\n", r"\n\d+ (\d+) 0\n", r"\n(3) \d+ \d+ \d+"),
        references=(r"\n3 (\d+) ",),
        element=r"\n3 \d+ \d+ \d+",
    ),
    "ply": Format(
        ".ply",
        {"binary": False},
        True,
        counts=(r"element vertex (\d+)", r"element face (\d+)", r"\n(3) \d+ \d+ \d+"),
        references=(r"\n3 (\d+) ",),
        element=r"\n3 \d+ \d+ \d+",
    ),
    "ply binary": Format(".ply", {"binary": True}, True, counts=(r"element vertex (\d+)", r"element face (\d+)")),
    "obj": Format(".obj", {}, True, references=(r"\nf (\d+) ",), element=r"\nf [^\n]+", counted=False),
    "stl": Format(".stl", {"binary": False}, True),
    "stl binary": Format(".stl", {"binary": True}, True),
    "wkt": Format(".wkt", {}, True),
}


class Written(NamedTuple):
    """A whole file with those beside it by their endings, and the mesh that it holds."""

    suffix: str
    content: bytes
    beside: dict[str, bytes]
    mesh: ElementMesh


@lru_cache
def written(name: str) -> Written:
    """A whole file of a format, and what is read of it."""
    form = FORMATS[name]
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"body{form.suffix}"
        with redirect_stderr(StringIO()):
            meshio.write(path, _body(form), **form.options)
        path.write_bytes(form.edit(path.read_bytes()))
        beside = {file.suffix: file.read_bytes() for file in Path(folder).iterdir() if file != path}
        return Written(form.suffix, path.read_bytes(), beside, read_mesh(path))


def _body(form: Format) -> meshio.Mesh:
    """Tetrahedra or triangles of two materials, as the format holds them."""
    mesh = skfem.MeshTri().refined(2) if form.flat else skfem.MeshTet().refined(1)
    if form.second:
        mesh = skfem.MeshTet2.from_mesh(mesh)
        return meshio.Mesh(mesh.doflocs.T.copy(), [("tetra10", mesh.dofs.element_dofs.T)])
    points = np.vstack([mesh.p, 0 * mesh.p[:1]]).T if form.flat else mesh.p.T
    number = np.arange(mesh.nelements) % 2
    data = {"material": [number]}
    if form.suffix == ".msh" and form.options["file_format"] != "ansys":
        data = {"gmsh:physical": [number + 1], "gmsh:geometrical": [number + 1]}
    if form.flat or form.suffix in (".dato", ".mdpa", ".xml", ".avs", ".inp"):
        data = {}
    return meshio.Mesh(points.copy(), [("triangle" if form.flat else "tetra", mesh.t.T)], cell_data=data)
