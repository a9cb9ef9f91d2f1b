"""Choice of a solver: by name, by object, or "auto"; and the inertia of a symmetric matrix, which direct solvers find."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ..arguments import flag, shown, whole
from ..errors import StvkError
from .amg import AmgCg
from .block_cg import BlockJacobiCg, SsorCg
from .dense import DenseSolver
from .pardiso import Pardiso, pardiso_is_installed
from .petsc import Petsc
from .solver import Kind, LinearSolver, Unknowns, check_kind, names
from .superlu import SuperLU

#: Number of unknowns from which PARDISO is faster than SuperLU.
PARDISO_FROM = 3_000
#: Largest number of unknowns for which a count is worth a factorisation: 0.1 s for triangles, 4 s for a cube of tetrahedra
#: (SuperLU).
COUNTED = 20_000
#: Error of eigenvalues by factorisation, relative to `|K|`. The signs of smaller eigenvalues are not significant.
ROUNDING = 8 * float(np.finfo(float).eps)


class Limit(NamedTuple):
    """Numbers of unknowns from which multigrid is faster, for rows of K with fewer than `entries` entries.

    `superlu` is compared with SuperLU, `pardiso` with PARDISO.
    """

    entries: float
    superlu: int
    pardiso: int


#: Direct solvers have little fill-in for plane bodies, but much for solid bodies with many entries per row.
LIMITS = (
    Limit(20, 10_000, 15_000),  # triangles, quadrilaterals: 14 - 18 entries in two dimensions
    Limit(30, 20_000, 30_000),  # quadratic triangles: 23
    Limit(50, 6_000, 15_000),  # tetrahedra: 35 - 45
    Limit(float("inf"), 1_500, 1_500),  # quadratic tetrahedra, hexahedra: 55 - 80
)
#: Default number of entries per row: that of linear tetrahedra.
ENTRIES = 45

#: All solvers, in the order in which messages list them.
SOLVERS: tuple[LinearSolver, ...] = (SuperLU(), Pardiso(), AmgCg(), BlockJacobiCg(), SsorCg())
#: Solvers for bodies that are divided into parts. The first one that is available is the default.
ON_PARTS: tuple[LinearSolver, ...] = (Petsc(), BlockJacobiCg())


def solver_names() -> list[str]:
    """Return "auto" and the names of all solvers."""
    return ["auto", *dict.fromkeys(one.name for one in (*SOLVERS, *ON_PARTS))]


def _expected() -> str:
    return f"expected {', '.join(map(repr, solver_names()))}, or an object such as SuperLU()."


def choose(
    solver: str | LinearSolver, n: int, kind: Kind, indefinite: bool = False, entries: int = 0, *, divided: bool = False
) -> LinearSolver:
    """Return the solver with this name, the solver object itself, or for "auto" the fastest for `n` unknowns.

    `docs/measurements/solvers.md` has the measurements for "auto".

    `indefinite`: matrices will not be positive definite, but must be solved; conjugate gradients only detect this. `entries`:
    approximate number of entries of K, if known. Rows of quadratic tetrahedra and hexahedra have twice as many as rows of linear
    ones. Rows in two dimensions have half as many or less. `divided`: K is the sum of those of the parts of a body, of which no
    part has the whole.

    Raises
    ------
    StvkError
        if the name is unknown, or the solver does not support this kind of matrix, or a divided body.
    """
    n, indefinite = whole("n", n, "the number of unknowns"), flag("indefinite", indefinite)
    entries = whole("entries", entries, "the number of entries of K")
    if divided:
        solver = _on_parts(solver, kind)
    if is_auto(solver):
        check_kind(SuperLU(), kind)
        # multigrid only if it is faster even on slender bodies: direct solvers count negative eigenvalues and solve indefinite
        # systems
        return direct(n) if indefinite or kind == Kind.GENERAL or n < _multigrid_threshold(n, entries) else AmgCg()
    if isinstance(solver, str):
        known = {one.name: one for one in (*SOLVERS, *ON_PARTS)}
        if solver not in known:
            raise StvkError(f"solver = {shown(solver)}; {_expected()}")
        solver = known[solver]
    required = "analyse", "name", "takes", "matrix_free", "iterative"
    if isinstance(solver, type) or not all(hasattr(solver, name) for name in required):
        raise StvkError(f"solver = {shown(solver)}; {_expected()}")
    check_kind(solver, kind)
    if indefinite and solver.iterative:
        able = names([other for other in SOLVERS if not other.iterative])
        raise StvkError(
            f"solver = '{solver.name}'; expected a direct solver, {able}, or 'auto': beyond a limit point K is indefinite, and "
            "conjugate gradients cannot solve with it."
        )
    return solver


def _on_parts(solver: str | LinearSolver, kind: Kind) -> LinearSolver:
    """Return the solver for a body that is divided into parts; refuse those that do not take this kind of K there."""
    able = [one for one in ON_PARTS if kind <= one.takes]
    if is_auto(solver):
        if not (available := [one for one in able if _is_available(one)]):
            raise StvkError(
                f"solver = 'auto'; expected {names(able)}, but petsc4py is missing. K is not symmetric, for example because of a "
                "follower pressure, and on ranks only PETSc solves with such a K. Install it, see docs/how-to/cluster.md; or solve "
                "on one machine."
            )
        return available[0]
    found = next((one for one in able if one.name == solver), solver)
    if isinstance(found, str) or not (getattr(found, "on_parts", False) and kind <= found.takes):
        raise StvkError(
            f"solver = {shown(getattr(found, 'name', found))}; expected {names(able)} for a body that is divided into "
            f"parts, with a K that is {kind}: no part has the whole K, which other solvers need."
        )
    return found


def _is_available(solver: LinearSolver) -> bool:
    return not isinstance(solver, Petsc) or solver.available


def header_text(solver: LinearSolver | DenseSolver, divided: bool) -> str:
    """Return a solver's name for the header of a run; for a divided body with the solver that it could have instead."""
    name = f"solver '{solver.name}'"
    if not divided:
        return name
    other = next(one for one in ON_PARTS if one.name != solver.name)
    return f"{name} (for another: solver='{other.name}'{'' if _is_available(other) else ', which needs petsc4py'})"


def why(solver: str | LinearSolver, n: int, kind: Kind, indefinite: bool = False, entries: int = 0) -> str:
    """Return the reason for the choice of `choose`, as text.

    >>> why("auto", 800, Kind.GENERAL), why("superlu", 800, Kind.GENERAL)
    ('direct: K is not symmetric', 'named')
    """
    if not is_auto(solver):
        return "named"
    if kind is Kind.GENERAL:
        reason = "direct: K is not symmetric"
    elif indefinite:
        reason = "direct: K is indefinite, or solved with many times"
    else:
        threshold = _multigrid_threshold(n, entries)
        reason = (
            f"{'direct: multigrid' if n < threshold else 'multigrid'} is faster from {threshold} unknowns on, for K with so many "
            "entries per row"
        )
    if n >= PARDISO_FROM and not pardiso_is_installed() and not reason.startswith("multigrid"):
        reason += "; PARDISO would be faster: pip install 'skfem-stvk[pardiso]'"
    return reason


def _multigrid_threshold(n: int, entries: int) -> int:
    """Return the number of unknowns from which multigrid is faster."""
    in_a_row = entries / n if entries and n else ENTRIES
    limit = next(limit for limit in LIMITS if in_a_row < limit.entries)
    return limit.pardiso if pardiso_is_installed() else limit.superlu


def is_auto(solver: object) -> bool:
    """Return whether `choose` is to select the solver."""
    return isinstance(solver, str) and solver == "auto"


def direct(n: int) -> LinearSolver:
    """Return the fastest direct solver: PARDISO if it is installed and faster, otherwise SuperLU."""
    return Pardiso() if n >= PARDISO_FROM and pardiso_is_installed() else SuperLU()


class Inertia(NamedTuple):
    """Numbers of eigenvalues of a symmetric matrix below `-8 eps |K|`, and between `-8 eps |K|` and `8 eps |K|`.

    The signs of the latter are those of round-off.
    """

    negative: int
    unsigned: int


def inertia(K: csr_matrix, unknowns: Unknowns) -> Inertia | None:
    """Return the inertia of K, scaled so that its diagonal is one; None if no direct solver can count the eigenvalues.

    By Sylvester's law, scaling rows and columns changes no sign. `|K|` is the largest sum of a row of the scaled matrix. Hence soft
    parts are not lost in the round-off of stiff parts.

    >>> K = csr_matrix(np.array([[2.0, -1, 0], [-1, -2, 1], [0, 1, 3]]))
    >>> inertia(K, Unknowns(np.arange(3), np.zeros(3, dtype=int), K.indptr, K.indices))
    Inertia(negative=1, unsigned=0)
    """
    scaled = _scaled(K)
    floor = ROUNDING * float(abs(scaled).sum(axis=1).max())
    high = eigenvalues_below(scaled, floor, unknowns)
    low = eigenvalues_below(scaled, -floor, unknowns) if high else high
    return None if low is None or high is None else Inertia(low, max(high - low, 0))


def eigenvalues_below(K: csr_matrix, shift: float, unknowns: Unknowns) -> int | None:
    """Return the number of eigenvalues of a symmetric matrix below `shift`; None if no direct solver can count them."""
    moved, first = shifted(K, shift), direct(unknowns.n)
    for solver in (first,) if first.name == SuperLU.name else (first, SuperLU()):  # PARDISO may replace pivots: no signs
        count = solver.analyse(unknowns).factorise(moved, Kind.SYMMETRIC).negative_pivots
        if count is not None:
            return count
    return None


def shifted(K: csr_matrix, shift: float) -> csr_matrix:
    """Return `K - shift I`, with the same pattern."""
    values = K.data.copy()
    values[np.repeat(np.arange(K.shape[0]), np.diff(K.indptr)) == K.indices] -= shift
    return csr_matrix((values, K.indices, K.indptr), shape=K.shape)


def transposition(K: csr_matrix) -> NDArray[np.int64]:
    """Return the indices of the values of K' among those of K, whose pattern is symmetric and sorted."""
    indices = np.arange(len(K.data))
    return np.asarray(csr_matrix((indices, K.indices, K.indptr), shape=K.shape).T.tocsr().data)


def _scaled(K: csr_matrix) -> csr_matrix:
    """Return K with diagonal entries 1 or -1."""
    size, row = np.abs(K.diagonal()), np.repeat(np.arange(K.shape[0]), np.diff(K.indptr))
    scale = 1 / np.sqrt(np.where(size > 0, size, size.max() if size.max() > 0 else 1.0))
    return csr_matrix((K.data * scale[row] * scale[K.indices], K.indices, K.indptr), shape=K.shape)
