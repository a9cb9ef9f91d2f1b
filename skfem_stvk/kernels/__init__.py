"""Arithmetic on bare arrays."""
