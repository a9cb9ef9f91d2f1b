"""The choice of a solver: by name, by object, or "auto"."""

from __future__ import annotations

from typing import NamedTuple

from ..arguments import flag, shown, whole
from ..errors import StvkError
from .amg import AmgCg
from .block_cg import BlockJacobiCg, SsorCg
from .checks import check_kind, checked_kind
from .pardiso import Pardiso, pardiso_is_installed
from .solver import Kind, LinearSolver, names
from .superlu import SuperLU

#: From so many unknowns on PARDISO is faster than SuperLU.
FEW = 3_000


class Limit(NamedTuple):
    """From how many unknowns on multigrid pays, where rows of K have fewer than so many `entries`: `alone`, and beside PARDISO."""

    entries: float
    alone: int
    beside: int


#: Direct solvers hardly fill in what lies in a plane; in space rows with many entries fill in at once.
LIMITS = (
    Limit(20, 10_000, 15_000),  # triangles, quadrilaterals: 14 - 18 in a plane
    Limit(30, 20_000, 30_000),  # quadratic triangles: 23
    Limit(50, 6_000, 15_000),  # tetrahedra: 35 - 45
    Limit(float("inf"), 1_500, 1_500),  # quadratic tetrahedra, hexahedra: 55 - 80
)
#: Where it is not known, rows have as many entries as those of linear tetrahedra.
ENTRIES = 45

#: All there are, in the order in which messages name them.
SOLVERS: tuple[LinearSolver, ...] = (SuperLU(), Pardiso(), AmgCg(), BlockJacobiCg(), SsorCg())


def solver_names() -> list[str]:
    """Return "auto" and the names of all solvers."""
    return ["auto", *(one.name for one in SOLVERS)]


def choose(solver: str | LinearSolver, n: int, kind: Kind, indefinite: bool = False, entries: int = 0) -> LinearSolver:
    """The solver of this name, the object itself, or for "auto" what `docs/solvers.md` measured to be fastest for `n` unknowns.

    `indefinite`: matrices will not be positive definite, and are to be solved with all the same; conjugate gradients notice only.
    `entries`: about how many K has, if that is known; quadratic tetrahedra and hexahedra have twice as many in a row as linear
    ones, and what lies in a plane has half as many or less.

    Raises
    ------
    StvkError
        if the name is unknown, or the solver does not take this kind of matrix.
    """
    n, indefinite = whole("n", n, "the number of unknowns"), flag("indefinite", indefinite)
    entries = whole("entries", entries, "the number of entries of K")
    if is_auto(solver):
        checked_kind(kind)
        # multigrid only where it gains even on slender bodies: direct solvers count negative eigenvalues, take what is indefinite
        return direct(n) if indefinite or kind == Kind.GENERAL or n < _many(n, entries) else AmgCg()
    if isinstance(solver, str):
        known = {one.name: one for one in SOLVERS}
        if solver not in known:
            raise StvkError(f"solver = {shown(solver)}; expected 'auto', {names(SOLVERS)}, or an object such as SuperLU().")
        solver = known[solver]
    asked = "analyse", "name", "takes", "matrix_free", "iterative"
    if isinstance(solver, type) or not all(hasattr(solver, name) for name in asked):
        raise StvkError(f"solver is a {type(solver).__name__}; expected 'auto', {names(SOLVERS)}, or an object such as SuperLU().")
    check_kind(solver, kind)
    if indefinite and solver.iterative:
        able = names([other for other in SOLVERS if not other.iterative])
        raise StvkError(
            f"Expected a direct solver, {able}, or 'auto', got '{solver.name}': behind a limit point K is indefinite, and "
            "conjugate gradients cannot solve with it."
        )
    return solver


def why(solver: str | LinearSolver, n: int, kind: Kind, indefinite: bool = False, entries: int = 0) -> str:
    """Why `choose` takes what it takes, in words.

    >>> why("auto", 800, Kind.GENERAL), why("superlu", 800, Kind.GENERAL)
    ('direct: K is not symmetric', 'named')
    """
    if not is_auto(solver):
        return "named"
    if kind is Kind.GENERAL:
        said = "direct: K is not symmetric"
    elif indefinite:
        said = "direct: K is indefinite, or solved with many times"
    else:
        many = _many(n, entries)
        said = (
            f"{'direct: multigrid' if n < many else 'multigrid'} pays from {many} unknowns on, with so many entries in a row of K"
        )
    if n >= FEW and not pardiso_is_installed() and not said.startswith("multigrid"):
        said += "; PARDISO would be faster: pip install 'skfem-stvk[pardiso]'"
    return said


def _many(n: int, entries: int) -> int:
    """From how many unknowns on multigrid pays."""
    in_a_row = entries / n if entries and n else ENTRIES
    limit = next(limit for limit in LIMITS if in_a_row < limit.entries)
    return limit.beside if pardiso_is_installed() else limit.alone


def is_auto(solver: object) -> bool:
    """Whether the choice is left to `choose`."""
    return isinstance(solver, str) and solver == "auto"


def direct(n: int) -> LinearSolver:
    """The fastest direct solver: PARDISO if it is installed and gains, else SuperLU."""
    return Pardiso() if n >= FEW and pardiso_is_installed() else SuperLU()
