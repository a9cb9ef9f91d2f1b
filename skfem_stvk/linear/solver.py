"""The interface of linear solvers.

    analysis = solver.analyse(unknowns)            once per mesh and its supports
    factors = analysis.factorise(K, kind)          once per Newton step
    solution = factors.solve(b, rtol, x0)          as often as needed

A solver holds options only and never changes. What is kept between Newton steps is in the analysis, which owns one set of factors:
with new ones the old refuse to solve.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..arguments import shown, whole_array
from ..errors import StvkError

Vector = NDArray[np.float64]


class Kind(IntEnum):
    """What a matrix is, from special to general. A solver that takes a kind takes those before it."""

    POSITIVE_DEFINITE = 0
    SYMMETRIC = 1
    GENERAL = 2

    def __str__(self) -> str:
        return self.name.lower().replace("_", " ")


class Outcome(Enum):
    """How a solve ended, in words."""

    SOLVED = "solved"
    NEGATIVE_CURVATURE = "the matrix is not positive definite: p'Kp <= 0 along a direction p"
    OUT_OF_ITERATIONS = "the residual was still above rtol after the last iteration allowed"
    INACCURATE = "the residual stayed above rtol: the matrix is nearly singular, or rtol is below round-off"
    SINGULAR = "the matrix is singular: a pivot is zero"
    NOT_FINITE = "NaN or infinity in the right-hand side or on the way"


@dataclass(frozen=True)
class Solution:
    """The result of a solve, which is always finite.

    Attributes
    ----------
    x : (n,) the solution; with an outcome other than SOLVED the best one found, zero if there is none.
    iterations : number of CG iterations, or how often a direct solver refined.
    residual : `|b - K x| / |b|`, computed from x, 1 if there is none.
    outcome : how the solve ended.
    start : the residual before the first iteration.
    """

    x: Vector
    iterations: int
    residual: float
    outcome: Outcome
    start: float = 1.0

    @classmethod
    def none(cls, b: Vector, outcome: Outcome) -> Solution:
        """Zero instead of a solution, with the outcome that says why."""
        return cls(np.zeros_like(b), 0, 1.0, outcome)


@dataclass(frozen=True)
class Unknowns:
    """The free degrees of freedom, and which of them K couples.

    Attributes
    ----------
    vertex, component : (n,) of each unknown, sorted by vertex, then by component.
    indptr, indices : structure of K in CSR format, columns sorted; None where K is never formed.
    near_null_space : gives the (n, r) rigid motions, restricted to the unknowns, of the body as it is when it is called; AMG needs
        it.
    ends : (nv, 2) vertices between which each lies in the middle of an edge of a quadratic element, itself twice of a corner; None
        where there is none.
    """

    vertex: NDArray[np.integer[Any]]
    component: NDArray[np.integer[Any]]
    indptr: NDArray[np.integer[Any]] | None = None
    indices: NDArray[np.integer[Any]] | None = None
    near_null_space: Callable[[], Vector] | None = None
    ends: NDArray[np.integer[Any]] | None = None

    def __post_init__(self) -> None:
        for name in ("vertex", "component", "indptr", "indices"):
            given = getattr(self, name)
            ids = whole_array(given)
            if (given is not None or name in ("vertex", "component")) and (ids is None or ids.ndim != 1 or ids.dtype.kind == "b"):
                raise StvkError(f"{name} = {shown(given)}; expected a list of whole numbers.")
            object.__setattr__(self, name, ids if given is not None else None)
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
    """Rows and columns of K in CSR format; unknowns that do not know them are refused."""
    if unknowns.indptr is None or unknowns.indices is None:
        raise StvkError("The unknowns have no indptr and indices; expected the structure of K over the free degrees of freedom.")
    return unknowns.indptr, unknowns.indices


class EdgeBlocks(NamedTuple):
    """K over the unknowns as blocks of edges: `(K v)_a = S_a v_a + sum_b K_ab (v_b - v_a)`, `v = 0` at what is held.

    Attributes
    ----------
    edges : (ne, 2) pairs of block rows.
    blocks : (9 ne,) `K_ab`, row by row, three components always.
    vertices : (rows,) vertex of each block row.
    shift : (n,) of the unknowns, the diagonal of all `S_a`; None is zero.
    """

    edges: NDArray[np.integer[Any]]
    blocks: NDArray[np.floating[Any]]
    vertices: NDArray[np.integer[Any]]
    shift: NDArray[np.floating[Any]] | None


class Operator(Protocol):
    """K as a matrix-free solver needs it.

    One with `by_edges() -> EdgeBlocks | None` is solved with by a compiled loop, if that is not None.
    """

    def matvec(self, v: Vector) -> Vector:
        """The product `K v` (n,) over the free degrees of freedom."""

    def diagonal_blocks(self) -> Vector:
        """(nv, d, d) blocks `K_aa` of the vertices that `Unknowns.vertex` counts; held components are not looked at."""


class Factors(Protocol):
    """A matrix that is ready to solve with."""

    @property
    def negative_pivots(self) -> int | None:
        """How many eigenvalues of K are negative; None if the solver cannot tell."""

    def solve(self, b: Vector, rtol: float = 1e-10, x0: Vector | None = None, out: Vector | None = None) -> Solution:
        """`x` with `|b - K x| <= rtol |b|`, or the outcome says why not.

        Iterative solvers start from `x0` (n,). x is written to `out` (n,), which may be `x0`; by default to a new array.
        """


class Analysis(Protocol):
    """What depends on the structure of K alone."""

    def factorise(self, K: Any, kind: Kind) -> Factors:
        """Factors of a matrix of this structure (an `Operator` where the solver is matrix-free); values are copied."""


class LinearSolver(Protocol):
    """The options of a solver, which are frozen."""

    @property
    def name(self) -> str:
        """The name that `solver="..."` takes."""

    @property
    def takes(self) -> Kind:
        """The most general kind of matrix that the solver takes."""

    @property
    def matrix_free(self) -> bool:
        """Whether it takes an `Operator` instead of a matrix."""

    @property
    def iterative(self) -> bool:
        """Whether a larger rtol makes the solver faster."""

    def analyse(self, unknowns: Unknowns) -> Analysis:
        """Prepare what does not depend on values."""


def names(solvers: Sequence[LinearSolver]) -> str:
    """The solvers' names, as a message lists them."""
    return ", ".join(f"'{solver.name}'" for solver in solvers)
