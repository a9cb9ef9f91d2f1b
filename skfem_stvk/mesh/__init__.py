"""Simplices, their geometry, what is wrong with them, and how they are read."""

from .read import embedded_mesh, read_mesh
from .simplices import MeshLike, SimplexMesh

__all__ = ["MeshLike", "SimplexMesh", "embedded_mesh", "read_mesh"]
