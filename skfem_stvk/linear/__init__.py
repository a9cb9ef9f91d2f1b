"""Linear solvers behind one interface. They work on matrices and need no mesh."""

from .amg import AmgCg
from .block_cg import BlockJacobiCg, SsorCg
from .choose import SOLVERS, choose
from .pardiso import Pardiso
from .petsc import Petsc
from .solver import Analysis, EdgeBlocks, Factors, Kind, LinearSolver, Operator, Outcome, Solution, Unknowns
from .superlu import SuperLU

__all__ = [
    "SOLVERS",
    "AmgCg",
    "Analysis",
    "BlockJacobiCg",
    "EdgeBlocks",
    "Factors",
    "Kind",
    "LinearSolver",
    "Operator",
    "Outcome",
    "Pardiso",
    "Petsc",
    "Solution",
    "SsorCg",
    "SuperLU",
    "Unknowns",
    "choose",
]
