"""Reference model: scikit-fem's standard assembly of St. Venant-Kirchhoff elasticity, independent of the code under test."""

from .kinds import KINDS, curved_elements, points_of
from .one_point import ReferenceOnePoint
from .standard_assembly import ReferenceStVK, element_axes, simplex_axes
from .tensors import anisotropic_tensor, engineering_matrix, isotropic_tensor, lame_tensor

__all__ = [
    "KINDS",
    "ReferenceOnePoint",
    "ReferenceStVK",
    "anisotropic_tensor",
    "curved_elements",
    "element_axes",
    "engineering_matrix",
    "isotropic_tensor",
    "lame_tensor",
    "points_of",
    "simplex_axes",
]
