"""Quasi-static solves: Newton's method, paths in load steps or by arc length, and results with their outcome."""

from ...results.monitors import Finding
from ..newton.newton import End, Iterations
from ..newton.outcome import Interrupted, Status
from .critical import CriticalPoint
from .history import Attempt, History, Step
from .result import SolveError, StaticResult
from .solve import solve_static
from .stop import Stop

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
