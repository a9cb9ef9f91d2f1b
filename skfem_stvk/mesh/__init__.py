"""Meshes of elements, their geometry, what is wrong with them, and how they are read."""

from .mesh import ElementMesh, MeshLike
from .quality import Extreme, MeshQuality, mesh_quality
from .read import embedded_mesh, read_mesh

__all__ = ["ElementMesh", "Extreme", "MeshLike", "MeshQuality", "embedded_mesh", "mesh_quality", "read_mesh"]
