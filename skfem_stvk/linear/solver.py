"""Interface of linear solvers.

    analysis = solver.analyse(unknowns)            once per mesh and its supports
    factors = analysis.factorise(K, kind)          once per Newton step
    solution = factors.solve(b, rtol, x0)          as often as needed

A solver has options only and never changes. Data that are retained between Newton steps are in the analysis, which owns one set of
factors. After a new factorisation, the previous factors refuse to solve.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum, IntEnum
from math import nan
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..arguments import shown, whole_array
from ..errors import StvkError
from ..space import Space

Vector = NDArray[np.float64]


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
