"""Edges, tetrahedron-sharing edge pairs (TSEPs), their coefficients L, and the assembly from them: the heart."""

from .assembly import Assembly, Linearized
from .form import EdgeForm
from .rows import Rows

__all__ = ["Assembly", "EdgeForm", "Linearized", "Rows"]
