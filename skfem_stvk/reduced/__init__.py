"""Bodies with few unknowns: St. Venant-Kirchhoff's energy in the span of some fields of displacements."""

from .system import ReducedSystem

__all__ = ["ReducedSystem"]
