"""What a body is made of: specifications without a mesh, one a file."""

from .stvk import StVK

__all__ = ["StVK"]
