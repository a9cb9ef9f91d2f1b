"""Mesh files by format: what each declares is what is read of it, or it is refused.

Formats whose reader cannot be asked are read here; of the others the file is counted before meshio reads it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import meshio

from . import abaqus, counted, gmsh, sections, uncounted, vtk, xml_files
from .source import Counts, Damaged, Source


def msh(path: Path) -> Counts:
    """Gmsh's files, or Fluent's, which begin with a bracket; meshio writes the latter unless it is told which."""
    with Source(path) as source:
        fluent = source.line().startswith("(")
    return sections.fluent(path) if fluent else gmsh.check(path)


#: Readers of this package, by the ending of a file.
READERS: dict[str, Callable[[Path], meshio.Mesh]] = {".inp": abaqus.read, ".vtk": vtk.read, ".vtu": xml_files.read}
#: What looks through a file before meshio reads it, by its ending: numbers of nodes and of elements.
CHECKS: dict[str, Callable[[Path], Counts]] = {
    ".msh": msh,
    ".ele": counted.tetgen,
    ".node": counted.tetgen,
    ".su2": counted.su2,
    ".off": counted.off,
    ".avs": counted.avs,
    ".ugrid": counted.ugrid,
    ".ply": counted.ply,
    ".mesh": sections.medit,
    ".meshb": sections.medit_binary,
    ".bdf": uncounted.nastran,
    ".fem": uncounted.nastran,
    ".nas": uncounted.nastran,
    ".stl": uncounted.stl,
    ".obj": uncounted.obj,
    ".wkt": uncounted.wkt,
    ".f3grid": uncounted.flac3d,
    ".post": uncounted.permas,
    ".dato": uncounted.permas,
    ".mdpa": uncounted.mdpa,
    ".vol": uncounted.netgen,
    ".dat": uncounted.tecplot,
    ".tec": uncounted.tecplot,
    ".xml": xml_files.dolfin,
    ".xdmf": xml_files.xdmf,
    ".xmf": xml_files.xdmf,
}
#: Other files that belong to a mesh file, by its ending.
PARTS: dict[str, Callable[[Path], Iterable[Path]]] = {
    ".inp": abaqus.included,
    ".ele": counted.tetgen_files,
    ".node": counted.tetgen_files,
    ".xml": xml_files.dolfin_data,
    ".xdmf": xml_files.xdmf_data,
    ".xmf": xml_files.xdmf_data,
}

__all__ = ["CHECKS", "PARTS", "READERS", "Counts", "Damaged"]
