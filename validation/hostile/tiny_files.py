"""Tiny mesh files that could exhaust the memory or cause endless reading, and paths of special files."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from skfem_stvk import ElementMesh
from skfem_stvk.mesh import read_mesh

from .case import Case
from .mesh_formats import FORMATS

INP = """*NODE
1, 0., 0., 0.
2, 1., 0., 0.
3, 0., 1., 0.
4, 0., 0., 1.
*ELEMENT, TYPE=C3D4
1, 1, 2, 3, 4
"""
MSH = (
    "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n{last} 0 0 1\n$EndNodes\n$Elements\n1\n1 4 2 1 1 "
    "1 2 3 {last}\n$EndElements\n"
)
MSH4 = (
    "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 4 1 {last}\n3 1 0 4\n1\n2\n3\n{last}\n0 0 0\n1 0 0\n0 1 0\n0 0 "
    "1\n$EndNodes\n$Elements\n1 1 1 1\n3 1 4 1\n1 1 2 3 {last}\n$EndElements\n"
)
XDMF = """<Xdmf Version="3.0"><Domain><Grid Name="Grid">
<Geometry GeometryType="XYZ">
<DataItem DataType="Float" Dimensions="{points} 3" Format="{form}" Precision="8">{name}</DataItem></Geometry>
<Topology TopologyType="Tetrahedron" NumberOfElements="1">
<DataItem DataType="Int" Dimensions="1 4" Format="XML" Precision="8">0 1 2 3</DataItem></Topology>
</Grid></Domain></Xdmf>"""
VTU = """<VTKFile type="UnstructuredGrid" version="0.1"><UnstructuredGrid><Piece NumberOfPoints="{points}" NumberOfCells="1">
<Points><DataArray type="Float64" NumberOfComponents="3" format="ascii">0 0 0 1 0 0 0 1 0 0 0 1</DataArray></Points>
<Cells><DataArray type="Int64" Name="connectivity" format="ascii">0 1 2 3</DataArray>
<DataArray type="Int64" Name="offsets" format="ascii">4</DataArray>
<DataArray type="Int64" Name="types" format="ascii">10</DataArray></Cells></Piece></UnstructuredGrid></VTKFile>"""

#: Text files by name of the case: the file that is read, its content, and the contents of its companion files.
FILES: dict[str, tuple[str, str, dict[str, str]]] = {
    "a node tag of 2^62": ("body.msh", MSH4.format(last=1 << 62), {}),
    "GENERATE to 1e8": ("body.inp", INP + "*ELSET, ELSET=all, GENERATE\n5, 100000000\n", {}),
    "GENERATE of nodes to 1e12": ("body.inp", INP + "*NSET, NSET=all, GENERATE\n5, 1000000000000, 1\n", {}),
    "GENERATE backwards": ("body.inp", INP + "*NSET, NSET=all, GENERATE\n4, 1\n", {}),
    "GENERATE in steps of 0": ("body.inp", INP + "*NSET, NSET=all, GENERATE\n1, 4, 0\n", {}),
    "GENERATE in steps of -1": ("body.inp", INP + "*NSET, NSET=all, GENERATE\n4, 1, -1\n", {}),
    "GENERATE of nothing": ("body.inp", INP + "*NSET, NSET=all, GENERATE\n,\n", {}),
    "a set of an element that is not there": ("body.inp", INP + "*ELSET, ELSET=all\n1, 77\n", {}),
    "a set of a node that is not there": ("body.inp", INP + "*NSET, NSET=all\n1, 77\n", {}),
    "five ids for a tetrahedron": ("body.inp", INP + "2, 1, 2, 3, 4, 1\n", {}),
    "ten ids for a tetrahedron": ("body.inp", INP + "2, 1, 2, 3, 4, 3, 1, 3, 2, 4\n", {}),
    "a node twice": ("body.inp", INP.replace("*ELEMENT", "4, 5., 5., 5.\n*ELEMENT"), {}),
    "an element twice": ("body.inp", INP + "1, 1, 2, 4, 3\n", {}),
    "INCLUDE of itself": ("body.inp", INP + "*INCLUDE, INPUT=body.inp\n", {}),
    "INCLUDE of itself, doubling": ("body.inp", 2 * "*INCLUDE, INPUT=body.inp\n" + INP, {}),
    "INCLUDE in a circle": ("body.inp", "*INCLUDE, INPUT=a.inp\n", {"a.inp": 9 * "*INCLUDE, INPUT=body.inp\n"}),
    "INCLUDE of many": ("body.inp", 10_000 * "*INCLUDE, INPUT=a.inp\n", {"a.inp": "** nothing\n"}),
    "INCLUDE of a device": ("body.inp", INP + "*INCLUDE, INPUT=/dev/zero\n", {}),
    "INCLUDE from another folder": ("body.inp", INP + "*INCLUDE, INPUT=../../../../../../../etc/hostname\n", {}),
    "INCLUDE of a folder": ("body.inp", INP + "*INCLUDE, INPUT=.\n", {}),
    "INCLUDE of nothing": ("body.inp", INP + "*INCLUDE\n", {}),
    "Gmsh's file with 1e12 nodes, version 2.2": ("body.msh", MSH.format(last=4).replace("$Nodes\n4", "$Nodes\n1000000000000"), {}),
    "Gmsh's file with 1e12 nodes, version 4.1": ("body.msh", MSH4.format(last=4).replace("3 1 0 4", "3 1 0 1000000000000"), {}),
    **{
        f"Gmsh's data with {name}": ("body.msh", MSH.format(last=4) + f"$NodeData\n{head}\n$EndNodeData\n", {})
        for name, head in {
            "1e9 texts": '1000000000\n"a"',
            "1e9 real tags": '1\n"a"\n1000000000\n0.0',
            "1e9 whole tags": '1\n"a"\n1\n0.0\n1000000000\n0',
            "1e12 values": '1\n"a"\n1\n0.0\n3\n0\n1\n1000000000000\n1 0.0',
            "1e12 components": '1\n"a"\n1\n0.0\n3\n0\n1000000000000\n4\n1 0.0',
        }.items()
    },
    "Geomview's file with 1e12 vertices": ("body.off", "OFF\n1000000000000 1 0\n0 0 0\n", {}),
    ".node with 1e12 nodes": ("body.node", "1000000000000 3 0 0\n0 0 0 0\n", {"body.ele": "1 4 0\n0 0 1 2 3\n"}),
    ".node of one newline": ("body.node", "\n", {"body.ele": "\n"}),
    ".ele of one newline": ("body.ele", "\n", {"body.node": "4 3 0 0\n0 0 0 0\n1 1 0 0\n2 0 1 0\n3 0 0 1\n"}),
    ".ele without .node": ("body.ele", "1 4 0\n0 0 1 2 3\n", {}),
    ".off of one newline": ("body.off", "OFF\n\n", {}),
    ".ply of one newline": ("body.ply", "ply\n\n", {}),
    "Nastran without an end": ("body.bdf", "BEGIN BULK\n", {}),
    "Nastran with other coordinates": ("body.bdf", "BEGIN BULK\nCORD2C,1\nGRID,1,1,1.,0.,0.\nENDDATA\n", {}),
    "XDMF with 1e12 points": ("body.xdmf", XDMF.format(points=10**12, form="XML", name="0 0 0"), {}),
    "XDMF with a device": ("body.xdmf", XDMF.format(points=4, form="Binary", name="/dev/zero"), {}),
    "XDMF with a device as HDF5": ("body.xdmf", XDMF.format(points=4, form="HDF", name="/dev/zero:/data"), {}),
    "VTU with 1e12 points": ("body.vtu", VTU.format(points=10**12), {}),
    "a bomb of XML": (
        "body.vtu",
        '<!DOCTYPE b [<!ENTITY a "'
        + 100 * "a"
        + '">'
        + "".join(f'<!ENTITY {b} "{100 * f"&{a};"}">' for a, b in zip("abcd", "bcde", strict=True))
        + "]><VTKFile>&e;</VTKFile>",
        {},
    ),
}


def cases() -> Iterator[Case]:
    """Yield tiny files and special files."""
    for name, (file, content, companions) in FILES.items():
        attempt = partial(read, file=file, content=content, companions=companions)
        yield Case(f"tiny: {name}", attempt, seconds=10, gigabytes=0.5, quick=True)
    for suffix in dict.fromkeys(form.suffix for form in FORMATS.values()):
        for what, make in {"a fifo": os.mkfifo, "/dev/zero": _device, "a folder": os.mkdir}.items():
            yield Case(
                f"{what} named {suffix}",
                partial(read_special, make=make, suffix=suffix),
                seconds=10,
                quick=suffix in (".msh", ".inp"),
            )
    for file, content in {
        "an INCLUDE": INP + "*INCLUDE, INPUT=pipe\n",
        "an .xdmf": XDMF.format(points=4, form="Binary", name="pipe"),
        "an .ele": "1 4 0\n0 0 1 2 3\n",
    }.items():
        yield Case(
            f"{file} that names a fifo", partial(read_with_fifo, content=content, suffix=_suffix(file)), seconds=10, quick=True
        )


def read(folder: Path, file: str, content: str, companions: dict[str, str]) -> ElementMesh:
    """Read a file with its companion files."""
    for name, text in (companions | {file: content}).items():
        (folder / name).write_text(text)
    return read_mesh(folder / file)


def read_special(folder: Path, make: Callable[[Path], None], suffix: str) -> ElementMesh:
    """Read a special file."""
    make(folder / f"body{suffix}")
    return read_mesh(folder / f"body{suffix}")


def read_with_fifo(folder: Path, content: str, suffix: str) -> ElementMesh:
    """Read a file that names another file, which is a pipe without a writer."""
    os.mkfifo(folder / ("body.node" if suffix == ".ele" else "pipe"))
    (folder / f"body{suffix}").write_text(content)
    return read_mesh(folder / f"body{suffix}")


def _suffix(what: str) -> str:
    return {"an INCLUDE": ".inp", "an .xdmf": ".xdmf", "an .ele": ".ele"}[what]


def _device(path: Path) -> None:
    path.symlink_to("/dev/zero")
