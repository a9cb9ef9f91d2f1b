"""St. Venant-Kirchhoff elasticity on simplices from edges, and the referee for everybody else's: a plugin for scikit-fem."""

from .errors import MaterialError, MeshError, RegionError, StateError, StvkError, StvkWarning
from .materials import Anisotropic, Isotropic, Orthotropic, TransverselyIsotropic
from .mesh import SimplexMesh, embedded_mesh, read_mesh
from .referee import Report, verify
from .system import System
from .terms import StVK

__version__ = "0.1.0"
__all__ = [
    "Anisotropic",
    "Isotropic",
    "MaterialError",
    "MeshError",
    "Orthotropic",
    "RegionError",
    "Report",
    "SimplexMesh",
    "StVK",
    "StateError",
    "StvkError",
    "StvkWarning",
    "System",
    "TransverselyIsotropic",
    "embedded_mesh",
    "read_mesh",
    "verify",
]
