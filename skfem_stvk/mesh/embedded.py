"""The mesh that comes with the package."""

from __future__ import annotations

from importlib.resources import as_file, files

from .read import read_mesh
from .simplices import SimplexMesh


def embedded_mesh() -> SimplexMesh:
    """An angle bracket [m] with a fillet, a bolt hole and a bushing of its own subdomain, meshed by Gmsh.

    Subdomains 'bracket' and 'bushing'; boundaries 'bolt' (the wall of the hole in the base) and 'bore' (inside the
    bushing). Half of the elements are turned round. Made by `python -m validation.meshes`.
    """
    with as_file(files("skfem_stvk.mesh") / "data" / "bracket.msh") as path:
        return read_mesh(path)
