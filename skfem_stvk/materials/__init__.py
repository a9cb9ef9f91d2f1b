"""Linear relations between Green-Lagrange strain and second Piola-Kirchhoff stress."""

from .anisotropic import Anisotropic, Orthotropic, TransverselyIsotropic, frames_along
from .isotropic import Isotropic
from .material import FramedMaterial, Hypothesis, Material

__all__ = [
    "Anisotropic",
    "FramedMaterial",
    "Hypothesis",
    "Isotropic",
    "Material",
    "Orthotropic",
    "TransverselyIsotropic",
    "frames_along",
]
