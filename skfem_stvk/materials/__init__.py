"""Linear relations between Green-Lagrange strain and second Piola-Kirchhoff stress."""

from .anisotropic import Anisotropic
from .isotropic import Isotropic
from .material import FramedMaterial, Hypothesis, Material
from .orthotropic import Orthotropic
from .transversely_isotropic import TransverselyIsotropic

__all__ = ["Anisotropic", "FramedMaterial", "Hypothesis", "Isotropic", "Material", "Orthotropic", "TransverselyIsotropic"]
