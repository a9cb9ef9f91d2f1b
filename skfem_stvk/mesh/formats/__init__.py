"""Mesh files by format: a file is refused unless its content matches its declarations.

This package reads the formats in which meshio misreads damaged files or loses content. Files of other formats are checked before
meshio reads them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import meshio

from . import abaqus, binary, exodus, gmsh, med, medit, nastran, surfaces, texts, vtk, xml_files
from .stream import Counts, CutOff, Damaged, Source

#: Readers of this package, by the ending of a file.
READERS: dict[str, Callable[[Path], meshio.Mesh]] = {
    ".inp": abaqus.read,
    **dict.fromkeys((".e", ".ex2", ".exo", ".exii", ".g", ".gen"), exodus.read),
    **dict.fromkeys((".med", ".mmed"), med.read),
    ".mesh": medit.read,
    ".msh": gmsh.read,
    **dict.fromkeys((".bdf", ".fem", ".nas"), nastran.read),
    ".obj": surfaces.obj,
    ".off": surfaces.off,
    ".vtk": vtk.read,
    ".vtu": xml_files.read,
}
#: Checks of a file before meshio reads it, by its ending: numbers of nodes and of elements.
CHECKS: dict[str, Callable[[Path], Counts]] = {
    ".meshb": binary.medit,
    ".ele": texts.tetgen,
    ".node": texts.tetgen,
    ".su2": texts.counted,
    ".ply": binary.ply,
    ".stl": binary.stl,
    ".xdmf": xml_files.xdmf,
    ".xmf": xml_files.xdmf,
}
#: Other files that belong to a mesh file, by its ending.
PARTS: dict[str, Callable[[Path], Iterable[Path]]] = {
    ".inp": abaqus.included,
    **dict.fromkeys((".bdf", ".fem", ".nas"), nastran.parts),
    ".ele": texts.tetgen_files,
    ".node": texts.tetgen_files,
    ".xdmf": xml_files.xdmf_data,
    ".xmf": xml_files.xdmf_data,
}
#: Refused formats, by the ending of a file: meshio misreads damaged files of them as other bodies, or never ends.
REFUSED = {
    ".avs": "AVS-UCD",
    **dict.fromkeys((".dat", ".tec"), "Tecplot"),
    **dict.fromkeys((".dato", ".dato.gz", ".post", ".post.gz"), "Permas"),
    ".f3grid": "FLAC3D",
    ".mdpa": "Kratos",
    ".ugrid": "UGRID",
    **dict.fromkeys((".vol", ".vol.gz"), "Netgen"),
    ".wkt": "WKT",
    ".xml": "DOLFIN XML",
}

#: Formats that are not read, and what makes a mesh of their files, by the ending; {new} is the new file.
CONVERTED = {
    ".unv": ("I-DEAS universal", "gmsh {file} -save -o {new}.msh"),
    **dict.fromkeys((".step", ".stp", ".iges", ".igs", ".brep"), ("CAD geometry", "gmsh -3 {file} -o {new}.msh")),
    **dict.fromkeys((".vti", ".vtr", ".vts", ".vtp", ".vtm"), ("VTK XML", "ParaView's Save Data, as {new}.vtk")),
    ".veg": ("VegaFEM", "its loader VolumetricMeshLoader, as {new}.vtk"),
    ".feb": ("FEBio", "FEBio Studio, as an Abaqus file {new}.inp"),
    **dict.fromkeys((".glb", ".gltf", ".dae", ".3mf"), ("scene", "trimesh: trimesh.load(FILE, force='mesh').export('{new}.obj')")),
}


def refused(path: Path) -> str | None:
    """Return the name of the format of a file if the format is refused."""
    if path.suffix.lower() == ".msh":
        with Source(path) as source:
            return "Fluent" if source.file.read(1000).lstrip().startswith(b"(") else None
    return REFUSED.get(path.suffix.lower(), REFUSED.get("".join(path.suffixes[-2:]).lower()))


__all__ = ["CHECKS", "CONVERTED", "PARTS", "READERS", "REFUSED", "Counts", "CutOff", "Damaged", "refused"]
