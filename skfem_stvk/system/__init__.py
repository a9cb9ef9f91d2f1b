"""Terms that share one mesh and one pattern."""

from .free import FreeDofs
from .operator import TangentOperator
from .pattern import Pattern
from .system import System

__all__ = ["FreeDofs", "Pattern", "System", "TangentOperator"]
