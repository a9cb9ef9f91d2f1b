"""Mesh files that are cut, changed, or not files at all: what is read is the mesh that was written, or the file is refused."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from functools import lru_cache, partial
from pathlib import Path
from typing import NamedTuple

import meshio
import numpy as np
import skfem

from skfem_stvk import SimplexMesh
from skfem_stvk.mesh import read_mesh

from .case import Case, Verdict, Wrong

#: Formats by name: the ending, and the options of `meshio.write`.
FORMATS: dict[str, tuple[str, dict[str, object]]] = {
    "msh 2.2": (".msh", {"file_format": "gmsh22", "binary": False}),
    "msh 2.2 binary": (".msh", {"file_format": "gmsh22", "binary": True}),
    "msh 4.1": (".msh", {"file_format": "gmsh", "binary": False}),
    "msh 4.1 binary": (".msh", {"file_format": "gmsh", "binary": True}),
    "vtk": (".vtk", {"file_format": "vtk42", "binary": False}),
    "vtk binary": (".vtk", {"file_format": "vtk42", "binary": True}),
    "vtk 5.1": (".vtk", {"file_format": "vtk51", "binary": False}),
    "vtu": (".vtu", {"binary": False}),
    "vtu binary": (".vtu", {"binary": True}),
    "inp": (".inp", {}),
    "medit": (".mesh", {}),
    "nastran": (".bdf", {}),
    "su2": (".su2", {}),
    "avs": (".avs", {}),
    "off": (".off", {}),
    "ply": (".ply", {"binary": False}),
    "obj": (".obj", {}),
}
#: Formats that hold surfaces only.
SURFACES = ("off", "ply", "obj")


class Written(NamedTuple):
    """A whole file, and the mesh that it holds."""

    suffix: str
    content: bytes
    mesh: SimplexMesh


def cases() -> Iterator[Case]:
    """All mesh files."""
    yield from cuts()
    yield from special()


def cuts() -> Iterator[Case]:
    """Files cut off at every twentieth of their length, and by just a few bytes."""
    for name in FORMATS:
        for percent in range(5, 100, 5):
            yield mutated(f"{name}: cut at {percent} %", name, partial(cut, part=percent / 100), quick=percent == 85)


def cut(content: bytes, part: float) -> bytes:
    """The first part of a file."""
    return content[: int(part * len(content))]


def mutated(name: str, file: str, change: Callable[[bytes], bytes], quick: bool = False) -> Case:
    """A changed file of a format: refused, or read as the mesh that it held before the change."""

    def attempt(folder: Path) -> SimplexMesh:
        whole = written(file)
        path = folder / f"body{whole.suffix}"
        path.write_bytes(change(whole.content))
        return read_mesh(path)

    return Case(name, attempt, partial(same_mesh, file=file), quick=quick)


def same_mesh(mesh: SimplexMesh, file: str) -> None:
    """The judge: vertices, elements and names are those that were written."""
    whole = written(file).mesh
    if not (mesh.nt == whole.nt and np.array_equal(mesh.t, whole.t) and np.array_equal(mesh.p, whole.p)):
        raise Wrong(
            Verdict.SILENT, f"read {mesh.nt} elements on {mesh.nv} vertices; {whole.nt} on {whole.nv} were written, or others"
        )


@lru_cache
def written(file: str) -> Written:
    """A whole file of a format, and what is read of it."""
    from tempfile import TemporaryDirectory

    suffix, options = FORMATS[file]
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"body{suffix}"
        mesh = skfem.MeshTri().refined(2) if file in SURFACES else skfem.MeshTet().refined(1)
        points = np.vstack([mesh.p, 0 * mesh.p[:1]]).T if file in SURFACES else mesh.p.T
        kind = "triangle" if file in SURFACES else "tetra"
        with open(os.devnull, "w"):
            meshio.write(path, meshio.Mesh(points, [(kind, mesh.t.T)]), **options)
        return Written(suffix, path.read_bytes(), read_mesh(path))


def special() -> Iterator[Case]:
    """Paths that are no regular files."""

    def fifo(folder: Path, suffix: str) -> SimplexMesh:
        os.mkfifo(folder / f"body{suffix}")
        return read_mesh(folder / f"body{suffix}")

    def device(folder: Path, suffix: str) -> SimplexMesh:
        (folder / f"body{suffix}").symlink_to("/dev/zero")
        return read_mesh(folder / f"body{suffix}")

    for suffix in dict.fromkeys(suffix for suffix, _ in FORMATS.values()):
        yield Case(f"a fifo named {suffix}", partial(fifo, suffix=suffix), seconds=5)
        yield Case(f"/dev/zero named {suffix}", partial(device, suffix=suffix), seconds=5)
