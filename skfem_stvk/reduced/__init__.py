"""Precomputed answers of a body: St. Venant-Kirchhoff's energy in the span of some fields, or a table of answers."""

from .response import BetweenPoints, PrecomputedResponse
from .system import ReducedSystem

__all__ = ["BetweenPoints", "PrecomputedResponse", "ReducedSystem"]
