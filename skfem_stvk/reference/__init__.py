"""scikit-fem's standard assembly of St. Venant-Kirchhoff elasticity; it shares nothing with the edge path."""

from .stvk import ReferenceStVK, simplex_axes
from .tensors import anisotropic_tensor, engineering_matrix, isotropic_tensor

__all__ = ["ReferenceStVK", "anisotropic_tensor", "engineering_matrix", "isotropic_tensor", "simplex_axes"]
