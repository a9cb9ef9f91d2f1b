"""Quasi-static solves: Newton's method, paths in load steps or by arc length, and a result that says how it came out."""

from .history import Attempt, History, Step
from .monitors import Finding
from .newton import End, Iterations
from .path.critical import CriticalPoint
from .path.stop import Stop
from .result import Interrupted, SolveError, StaticResult
from .solve import solve_static
from .status import Status

__all__ = [
    "Attempt",
    "CriticalPoint",
    "End",
    "Finding",
    "History",
    "Interrupted",
    "Iterations",
    "SolveError",
    "StaticResult",
    "Status",
    "Step",
    "Stop",
    "solve_static",
]
