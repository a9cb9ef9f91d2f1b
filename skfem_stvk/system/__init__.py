"""Terms that share one mesh and one pattern of K, with their loads and supports."""

from .mass import Mass
from .operator import FreeOperator, TangentOperator
from .pattern import FreeDofs, Pattern
from .supports import Supports
from .system import System

__all__ = ["FreeDofs", "FreeOperator", "Mass", "Pattern", "Supports", "System", "TangentOperator"]
