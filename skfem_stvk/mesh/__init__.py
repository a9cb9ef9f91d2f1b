"""Simplices, their geometry, what is wrong with them, and how they are read."""

from .embedded import embedded_mesh
from .read import read_mesh
from .simplices import MeshLike, SimplexMesh

__all__ = ["MeshLike", "SimplexMesh", "embedded_mesh", "read_mesh"]
