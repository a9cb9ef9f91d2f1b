"""St. Venant-Kirchhoff elasticity on simplices from edges, and the referee for everybody else's: a plugin for scikit-fem."""

from .errors import MaterialError, MeshError, RegionError, StateError, StvkError, StvkWarning
from .mesh import SimplexMesh

__version__ = "0.1.0"
__all__ = ["MaterialError", "MeshError", "RegionError", "SimplexMesh", "StateError", "StvkError", "StvkWarning"]
