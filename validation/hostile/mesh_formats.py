"""Good files of all mesh formats, and the positions of counts, ids, coordinates and rows in them."""

from __future__ import annotations

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

#: Expression of a coordinate: a number with a decimal point and perhaps an exponent.
REAL = r"-?\d+\.\d*(?:[eE][-+]?\d+)?"


@dataclass(frozen=True)
class Format:
    """Mesh format.

    Attributes
    ----------
    suffix
        Suffix of the files.
    options
        Options of `meshio.write`.
    flat
        Whether the format contains triangles only.
    second
        Whether the elements have second order.
    counts
        Expressions for text files; the group is a number of entries.
    ids
        Expressions whose group is the id of a node or an element at its definition.
    references
        Expressions whose group is the id of a node in an element.
    element
        Expression of the whole row of an element.
    counted
        Whether the header contains the number of elements.
    """

    suffix: str
    options: dict[str, Any] = field(default_factory=dict)
    flat: bool = False
    counts: tuple[str, ...] = ()
    ids: tuple[str, ...] = ()
    references: tuple[str, ...] = ()
    element: str = ""
    counted: bool = True
    second: bool = False


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
    "stl": Format(".stl", {"binary": False}, True),
    "stl binary": Format(".stl", {"binary": True}, True),
}


class Written(NamedTuple):
    """Complete file, its companion files by suffix, and the mesh in the file."""

    suffix: str
    content: bytes
    companions: dict[str, bytes]
    mesh: ElementMesh


@lru_cache
def written(name: str) -> Written:
    """Return a complete file of a format, and the mesh that `read_mesh` returns for it."""
    form = FORMATS[name]
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"body{form.suffix}"
        with redirect_stderr(StringIO()):
            meshio.write(path, _body(form), **form.options)
        companions = {file.suffix: file.read_bytes() for file in Path(folder).iterdir() if file != path}
        return Written(form.suffix, path.read_bytes(), companions, read_mesh(path))


def _body(form: Format) -> meshio.Mesh:
    """Return tetrahedra or triangles of two materials, with the data that the format supports."""
    mesh = skfem.MeshTri().refined(2) if form.flat else skfem.MeshTet().refined(1)
    if form.second:
        mesh = skfem.MeshTet2.from_mesh(mesh)
        return meshio.Mesh(mesh.doflocs.T.copy(), [("tetra10", mesh.dofs.element_dofs.T)])
    points = np.vstack([mesh.p, 0 * mesh.p[:1]]).T if form.flat else mesh.p.T
    number = np.arange(mesh.nelements) % 2
    data = {"material": [number]}
    if form.suffix == ".msh":
        data = {"gmsh:physical": [number + 1], "gmsh:geometrical": [number + 1]}
    if form.flat or form.suffix == ".inp":
        data = {}
    return meshio.Mesh(points.copy(), [("triangle" if form.flat else "tetra", mesh.t.T)], cell_data=data)
