"""Precomputed answers of a body: St. Venant-Kirchhoff's energy in the span of some fields, or a table of answers."""

from .precomputed_response import BetweenPoints, PrecomputedResponse
from .reduced_system import ReducedSystem

__all__ = ["BetweenPoints", "PrecomputedResponse", "ReducedSystem"]
