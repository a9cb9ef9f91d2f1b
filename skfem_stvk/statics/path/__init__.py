"""Paths of equilibria: in steps of the load, or by their length, and the critical points on them."""
