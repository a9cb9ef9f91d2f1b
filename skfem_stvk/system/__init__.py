"""Terms that share one mesh and one pattern."""

from .pattern import Pattern
from .system import System

__all__ = ["Pattern", "System"]
