"""Bodies on several machines, by MPI."""

from .mesh import MeshPart, distribute, gathered
from .ranks import Ranks

__all__ = ["MeshPart", "Ranks", "distribute", "gathered"]
