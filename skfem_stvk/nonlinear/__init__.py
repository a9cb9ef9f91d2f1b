"""Nonlinear equations: Newton's method, its line search and tangents, and eigenvalues of the tangent, on a `Problem` that knows its own unknowns."""
