"""Checks of the package that take longer than tests, and meshes for them."""
