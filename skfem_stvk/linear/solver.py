"""Interface of linear solvers, and the checks that all of them make.

    analysis = solver.analyse(unknowns)            once per mesh and its supports
    factors = analysis.factorise(K, kind)          once per Newton step
    solution = factors.solve(b, rtol, x0)          as often as needed

A solver has options only and never changes. Data that are retained between Newton steps are in the analysis, which owns one set of
factors. After a new factorisation, the previous factors refuse to solve.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum, IntEnum
from functools import wraps
from math import nan
from typing import Any, NamedTuple, Protocol, TypeVar, cast

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ..arguments import number, shown, vector, whole_array
from ..errors import StateError, StvkError, name_ids
from ..kernels.threads import CopyableLock
from ..space import ONE_PROCESS, Space

Vector = NDArray[np.float64]
Method = TypeVar("Method", bound=Callable[..., Any])


class Kind(IntEnum):
    """Kind of a matrix, from special to general. A solver that supports a kind supports all kinds before it."""

    POSITIVE_DEFINITE = 0
    SYMMETRIC = 1
    GENERAL = 2

    def __str__(self) -> str:
        return self.name.lower().replace("_", " ")


class Outcome(Enum):
    """Outcome of a solve; the value is its description."""

    SOLVED = "solved"
    NEGATIVE_CURVATURE = "the matrix is not positive definite: p'Kp <= 0 along a direction p"
    OUT_OF_ITERATIONS = "the residual was still above rtol after the last iteration allowed"
    INACCURATE = "the residual stayed above rtol: the matrix is nearly singular, or rtol is below round-off"
    SINGULAR = "the matrix is singular: a pivot is zero"
    NOT_FINITE = "NaN or infinity in the right-hand side or on the way"


@dataclass(frozen=True)
class Solution:
    """Result of a solve, which is always finite.

    Attributes
    ----------
    x
        (n,) solution; with an outcome other than SOLVED the best one found, zero if there is none.
    iterations
        Number of iterations of conjugate gradients, or of refinements by a direct solver.
    residual
        Relative residual `|b - K x| / |b|`, computed from x; 1 if there is no x.
    outcome
        Outcome of the solve.
    start
        Residual before the first iteration.
    curvature
        Quotient `p'Kp / p'p` of the direction of negative curvature that ended conjugate gradients; NaN if it is not known.
    """

    x: Vector
    iterations: int
    residual: float
    outcome: Outcome
    start: float = 1.0
    curvature: float = nan

    @classmethod
    def none(cls, b: Vector, outcome: Outcome) -> Solution:
        """Return zero instead of a solution, with the outcome as the reason."""
        return cls(np.zeros_like(b), 0, 1.0, outcome)


@dataclass(frozen=True)
class Unknowns:
    """Free degrees of freedom, and the pattern of K that couples them.

    Attributes
    ----------
    vertex, component
        (n,) vertex and component of each unknown, sorted by vertex, then by component.
    indptr, indices
        Structure of K in CSR format, columns sorted; None if K is never formed.
    near_null_space
        Function that returns the (n, r) rigid motions, restricted to the unknowns, of the body in its state at the time of the
        call. AMG requires it.
    ends
        (nv, 2) for each vertex in the middle of an edge of a quadratic element, the vertices at both ends; for a corner its own
        number twice. None if there are no such vertices.
    space
        Space of vectors of the unknowns; by default that of a body that is not divided.
    """

    vertex: NDArray[np.integer[Any]]
    component: NDArray[np.integer[Any]]
    indptr: NDArray[np.integer[Any]] | None = None
    indices: NDArray[np.integer[Any]] | None = None
    near_null_space: Callable[[], Vector] | None = None
    ends: NDArray[np.integer[Any]] | None = None
    space: Space | None = None

    def __post_init__(self) -> None:
        for name in ("vertex", "component", "indptr", "indices"):
            value = getattr(self, name)
            ids = whole_array(value)
            if (value is not None or name in ("vertex", "component")) and (ids is None or ids.ndim != 1 or ids.dtype.kind == "b"):
                raise StvkError(f"{name} = {shown(value)}; expected a list of whole numbers.")
            object.__setattr__(self, name, ids if value is not None else None)
        if self.ends is not None:
            ends, least = whole_array(self.ends), int(np.max(self.vertex, initial=-1)) + 1
            if ends is None or ends.dtype.kind == "b" or ends.ndim != 2 or ends.shape[1] != 2 or len(ends) < least:
                raise StvkError(f"ends = {shown(self.ends)}; expected (nv, 2) vertices, for each of at least {least} vertices.")
            object.__setattr__(self, "ends", ends)
        if len(self.component) != len(self.vertex):
            raise StvkError(f"component has {len(self.component)} values; expected {len(self.vertex)}, one for each of vertex.")
        if self.near_null_space is not None and not callable(self.near_null_space):
            raise StvkError(f"near_null_space = {shown(self.near_null_space)}; expected a function, or None.")

    @property
    def n(self) -> int:
        """Number of unknowns."""
        return len(self.vertex)


def structure_of(unknowns: Unknowns) -> tuple[NDArray[np.integer[Any]], NDArray[np.integer[Any]]]:
    """Return the row pointers and columns of K in CSR format. Refuse unknowns without them."""
    if unknowns.indptr is None or unknowns.indices is None:
        raise StvkError("indptr, indices = None; expected the structure of K over the free degrees of freedom.")
    return unknowns.indptr, unknowns.indices


NO_ROWS, NO_BLOCKS = np.empty(0, dtype=np.int64), np.empty(0)


class EdgeBlocks(NamedTuple):
    """K over the unknowns as blocks of edges, with `v = 0` at constrained components.

    ::

        (K v)_a = (S_a + G_a) v_a + sum_b K_ab (v_b - v_a)

    Attributes
    ----------
    edges
        (ne, 2) pairs of block rows.
    blocks
        (9 ne,) blocks `K_ab`, row by row, always with three components.
    vertices
        (rows,) vertex of each block row.
    shift
        (n,) diagonal of all `S_a` for the unknowns; None means zero.
    grounded, ground
        (m,) block rows with blocks `G_a` (9 m,), such as those of contact; empty without any.
    """

    edges: NDArray[np.integer[Any]]
    blocks: NDArray[np.floating[Any]]
    vertices: NDArray[np.integer[Any]]
    shift: NDArray[np.floating[Any]] | None
    grounded: NDArray[np.integer[Any]] = NO_ROWS
    ground: NDArray[np.floating[Any]] = NO_BLOCKS


class Operator(Protocol):
    """K in the form that a matrix-free solver requires.

    If an operator has `by_edges() -> EdgeBlocks | None` and the result is not None, a compiled loop solves with it.
    """

    def matvec(self, v: Vector) -> Vector:
        """Return the product `K v` (n,) over the free degrees of freedom."""

    def diagonal_blocks(self) -> Vector:
        """Return the blocks `K_aa` (nv, d, d) of the vertices, in the numbering of `Unknowns.vertex`.

        Constrained components are ignored.
        """


class Factors(Protocol):
    """Factorised or preconditioned matrix, ready for solves."""

    @property
    def negative_pivots(self) -> int | None:
        """Number of negative eigenvalues of K; None if the solver cannot count them."""

    def solve(self, b: Vector, rtol: float = 1e-10, x0: Vector | None = None, out: Vector | None = None) -> Solution:
        """Return `x` with `|b - K x| <= rtol |b|`; otherwise the outcome has the reason.

        Iterative solvers start from `x0` (n,). x is written to `out` (n,), which may be `x0`; by default to a new array.
        """


class Analysis(Protocol):
    """Data that depend on the structure of K alone."""

    def factorise(self, K: Any, kind: Kind) -> Factors:
        """Return the factors of a matrix of this structure (an `Operator` if the solver is matrix-free). Values are copied."""


class LinearSolver(Protocol):
    """Options of a solver, which are frozen.

    A solver for bodies that are divided into parts has a true attribute `on_parts`. Its K is an operator whose products combine the
    parts, or the matrix of one part, with `Unknowns.space`.
    """

    @property
    def name(self) -> str:
        """Name of the solver for `solver="..."`."""

    @property
    def takes(self) -> Kind:
        """Most general kind of matrix that the solver supports."""

    @property
    def matrix_free(self) -> bool:
        """Whether the solver requires an `Operator` instead of a matrix."""

    @property
    def iterative(self) -> bool:
        """Whether a larger rtol makes the solver faster."""

    def analyse(self, unknowns: Unknowns) -> Analysis:
        """Prepare the data that do not depend on values."""


def names(solvers: Sequence[LinearSolver]) -> str:
    """Return the solvers' names as a list for messages."""
    return ", ".join(f"'{solver.name}'" for solver in solvers)


class CheckedAnalysis:
    """Analysis with one set of factors, those of the last `number`. Calls of Python threads hold its `lock`."""

    def __init__(self, solver: LinearSolver, unknowns: Unknowns) -> None:
        if not isinstance(unknowns, Unknowns):
            raise StvkError(f"unknowns = {shown(unknowns)}; expected Unknowns(vertex, component, indptr, indices).")
        self.solver, self.unknowns, self.n = solver, unknowns, unknowns.n
        self.number, self._lock = 0, CopyableLock()

    def begin(self, kind: Kind) -> None:
        """Make earlier factors stale. Refuse a kind of matrix that the solver does not support."""
        check_kind(self.solver, kind)
        self.number += 1

    def begin_with(self, K: Any, kind: Kind) -> NDArray[np.float64]:
        """Do the same as `begin`, and return the values (nnz,) of K in double precision, copied only if necessary.

        Refuse another structure, and NaN.
        """
        check_kind(self.solver, kind)
        indptr, indices = structure_of(self.unknowns)
        if not isinstance(K, csr_matrix) or K.shape != (self.n, self.n):
            raise StvkError(f"K = {shown(K)}; expected a csr_matrix of shape {(self.n, self.n)}.")
        same_rows = K.indptr is indptr or np.array_equal(K.indptr, indptr)
        if not same_rows or not (K.indices is indices or np.array_equal(K.indices, indices)):
            raise StvkError(
                f"K has {K.nnz} values in another structure; expected the structure that was analysed, of {len(indices)} values. "
                "Keep the zeros of K, or call analyse() again."
            )
        values = np.ascontiguousarray(K.data, dtype=np.float64)
        space = self.unknowns.space
        with (ONE_PROCESS if space is None else space.comm).together():
            if not np.isfinite(values.sum()) and len(bad := np.flatnonzero(~np.isfinite(values))):
                raise StateError(f"K is not finite in {name_ids(bad, 'value')}: did the previous step diverge?")
        self.number += 1
        return values


def latest_only(method: Method) -> Method:
    """Decorate a method of factors: it waits for the lock, and refuses to run if the factors are not the latest."""

    @wraps(method)
    def waiting(self: Any, *arguments: Any, **named: Any) -> Any:
        with self._analysis._lock:
            if self._number != self._analysis.number:
                raise StvkError(
                    "These factors are stale: their analysis has factorised another matrix since. Solve with the factors that "
                    "factorise() returned last, or call analyse() again for a second set of factors."
                )
            return method(self, *arguments, **named)

    return cast(Method, waiting)


class CheckedFactors(ABC):
    """Factors of the last matrix of an analysis, with checks of all arguments of `solve`. Only the latest factors solve."""

    def __init__(self, analysis: CheckedAnalysis) -> None:
        self._analysis, self._number = analysis, analysis.number

    @latest_only
    def solve(self, b: Any, rtol: float = 1e-10, x0: Any = None, out: Vector | None = None) -> Solution:
        """Solve as in `Factors`. The outcome reports NaN or infinity in the vectors.

        Raises
        ------
        StvkError
            if the factors are stale, a vector does not have n entries, or `out` is not writeable.
        """
        n, each = self._analysis.n, "free degree of freedom"
        if out is not None:
            own = isinstance(out, np.ndarray) and out.dtype == np.float64 and out.shape == (n,) and out.flags.writeable
            if not own or isinstance(out, np.ma.MaskedArray):
                raise StvkError(f"out = {shown(out)}; expected an array of double precision ({n},) that can be written to.")
        rtol = number("rtol", rtol, "a number between 0 and 1, such as 1e-10", 0.0, 1.0)
        start = None if x0 is None else vector("x0", x0, n, each).astype(np.float64, copy=False)
        found = self._solve(vector("b", b, n, each).astype(np.float64, copy=False), rtol, start, out)
        if out is None or found.x is out:
            return found
        np.copyto(out, found.x)
        return replace(found, x=out)

    @abstractmethod
    def _solve(self, b: Vector, rtol: float, x0: Vector | None, out: Vector | None) -> Solution:
        """Solve with checked arguments. x may be written to `out`."""


def check_kind(solver: LinearSolver, kind: Kind) -> None:
    """Refuse a kind of matrix that the solver does not support, and a value that is not a `Kind`."""
    if not isinstance(kind, Kind):
        raise StvkError(f"kind = {shown(kind)}; expected one of {', '.join(f'Kind.{one.name}' for one in Kind)}.")
    if kind > solver.takes:
        raise StvkError(
            f"kind = {kind}; expected at most {solver.takes} for solver='{solver.name}'. Follower loads make K unsymmetric. "
            "Direct solvers take every kind: solver='superlu', 'pardiso' or 'auto'."
        )


@np.errstate(over="ignore", invalid="ignore")  # overflow is reported as an outcome
def solve_checked(product: Callable[[Vector], Vector], inverse: Callable[[Vector], Vector], b: Vector, rtol: float) -> Solution:
    """Return `x = inverse(b)`, refined once to `x += inverse(b - K x)` if `|b - K x| > rtol |b|` and the refined x is better."""
    size = float(np.linalg.norm(b))
    if not np.isfinite(size):
        return Solution.none(b, Outcome.NOT_FINITE)
    if size == 0:
        return Solution(np.zeros_like(b), 0, 0.0, Outcome.SOLVED)
    x = inverse(b)
    if not np.isfinite(x).all():
        return Solution.none(b, Outcome.SINGULAR)
    r = b - product(x)
    residual, refined = float(np.linalg.norm(r)) / size, 0
    if residual > rtol:
        y = x + inverse(r)
        better = float(np.linalg.norm(b - product(y))) / size
        if better < residual:
            x, residual, refined = y, better, 1
    if not np.isfinite(residual):
        return Solution.none(b, Outcome.NOT_FINITE)
    return Solution(x, refined, residual, Outcome.SOLVED if residual <= rtol else Outcome.INACCURATE)
