"""Meshes of elements, their geometry, faults, readers and generators."""

from .generators import bar, box, cylinder
from .locations import Box, NearestNode, Plane
from .mesh import ElementMesh, MeshLike
from .quality import Extreme, MeshQuality, mesh_quality
from .read import embedded_mesh, read_mesh

__all__ = [
    "Box",
    "ElementMesh",
    "Extreme",
    "MeshLike",
    "MeshQuality",
    "NearestNode",
    "Plane",
    "bar",
    "box",
    "cylinder",
    "embedded_mesh",
    "mesh_quality",
    "read_mesh",
]
