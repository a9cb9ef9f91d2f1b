"""Edges, tetrahedron-sharing edge pairs (TSEPs), their coefficients L, and the assembly from them: the heart."""

from .assembly import Assembly
from .form import EdgeForm
from .penalty import PenaltyAssembly
from .rows import Rows
from .simplices import Linearized
from .tensions import ALL, NONE, TENSILE, Tensions

__all__ = ["ALL", "NONE", "TENSILE", "Assembly", "EdgeForm", "Linearized", "PenaltyAssembly", "Rows", "Tensions"]
