"""Meshes of elements, their geometry, what is wrong with them, and how they are read."""

from .mesh import ElementMesh, MeshLike
from .read import embedded_mesh, read_mesh

__all__ = ["ElementMesh", "MeshLike", "embedded_mesh", "read_mesh"]
