"""Edges, tetrahedron-sharing edge pairs (TSEPs) and their coefficients L: the heart."""

from .form import EdgeForm, Places

__all__ = ["EdgeForm", "Places"]
