"""Checks of the W, F and K of this package or of any other code. The entry point is the function `verify`."""
