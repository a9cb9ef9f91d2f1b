"""What a body is made of: specifications without a mesh, one a file."""

from .protocols import BoundTerm, Term
from .stvk import StVK

__all__ = ["BoundTerm", "StVK", "Term"]
