"""Elements as tables: nodes, shape functions and their derivatives, and where their integrals are taken."""

from .element import ELEMENTS, Element, linear_simplex, named, second_order
from .rules import HOURGLASS, Rule, rule_of

__all__ = ["ELEMENTS", "HOURGLASS", "Element", "Rule", "linear_simplex", "named", "rule_of", "second_order"]
