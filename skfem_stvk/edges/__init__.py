"""Edges, tetrahedron-sharing edge pairs (TSEPs), their coefficients L, and the assembly from them: the heart."""

from .assembly import Assembly, EnergyAssembly, LawAssembly, TensionAssembly
from .form import EdgeForm
from .pairs import ALL, NONE, TENSILE, WARPED, Linearized, NodeBlocks, Rows, Tensions
from .penalty import PenaltyAssembly

__all__ = [
    "ALL",
    "NONE",
    "TENSILE",
    "WARPED",
    "Assembly",
    "EdgeForm",
    "EnergyAssembly",
    "LawAssembly",
    "Linearized",
    "NodeBlocks",
    "PenaltyAssembly",
    "Rows",
    "TensionAssembly",
    "Tensions",
]
