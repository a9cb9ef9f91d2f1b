"""Edges, tetrahedron-sharing edge pairs (TSEPs), their coefficients L, and the assembly from them: the core of the package."""

from .assembly import Assembly
from .form import EdgeForm
from .pairs import ALL, NONE, TENSILE, WARPED, Linearized, NodeBlocks, Rows, Tensions

__all__ = [
    "ALL",
    "NONE",
    "TENSILE",
    "WARPED",
    "Assembly",
    "EdgeForm",
    "Linearized",
    "NodeBlocks",
    "Rows",
    "Tensions",
]
