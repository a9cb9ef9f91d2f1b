"""Solvers of equilibrium and of motion: Newton's method, runs, statics, dynamics and reduced bodies."""
