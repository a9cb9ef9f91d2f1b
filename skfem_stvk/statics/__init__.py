"""Quasi-static solves: Newton's method, load stepping, and a result that says how it came out."""

from .history import Attempt, History, Step
from .newton import End, Iterations
from .result import Interrupted, SolveError, StaticResult
from .solve import solve_static
from .status import Status

__all__ = ["Attempt", "End", "History", "Interrupted", "Iterations", "SolveError", "StaticResult", "Status", "Step", "solve_static"]
