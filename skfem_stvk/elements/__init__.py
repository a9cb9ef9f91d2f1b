"""Elements as tables: nodes, shape functions and their derivatives, and where their integrals are taken."""

from .element import ELEMENTS, POINT, Element, linear_simplex, named
from .rules import HOURGLASS, Rule, rule_of

__all__ = ["ELEMENTS", "HOURGLASS", "POINT", "Element", "Rule", "linear_simplex", "named", "rule_of"]
