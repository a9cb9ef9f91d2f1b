"""Simplices, their geometry, what is wrong with them, and how they are read."""

from .simplices import MeshLike, SimplexMesh

__all__ = ["MeshLike", "SimplexMesh"]
