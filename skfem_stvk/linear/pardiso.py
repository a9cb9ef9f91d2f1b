"""PARDISO of Intel's MKL, through the optional package pypardiso: direct, on all cores.

Symmetric matrices use mtype -2 (Bunch-Kaufman). It is as fast as the type for positive definite matrices, and reports the inertia.
For symmetric matrices PARDISO requires the upper triangle with every diagonal entry. With the full matrix, it crashes the process.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
import weakref
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ..errors import StvkError, name_ids
from ..kernels.threads import locked
from .solver import (
    CheckedAnalysis,
    CheckedFactors,
    Kind,
    Outcome,
    Solution,
    Unknowns,
    Vector,
    latest_only,
    solve_checked,
    structure_of,
)

SYMMETRIC, GENERAL = -2, 11  # mtype
ANALYSE, FACTORISE, SOLVE = 11, 22, 33  # phase
NEGATIVE, PERTURBED = 23, 14  # iparm, counted from 1
KILOBYTES = 16, 17  # memory of the analysis, and of the factors

#: iparm, counted from 1: no default values, METIS, no refinement unless pivots were perturbed (it took five times the solve),
#: pivots below 10^-iparm(10) perturbed.
OPTIONS = {SYMMETRIC: {1: 1, 2: 2, 8: 0, 10: 8, 21: 1}, GENERAL: {1: 1, 2: 2, 8: 0, 10: 13, 11: 1, 13: 1}}

#: Meanings of PARDISO's error codes.
ERRORS = {
    -2: "not enough memory",
    -3: "reordering failed",
    -4: "a zero pivot",
    -7: "the diagonal matrix is singular",
    -8: "32-bit overflow",
}


def pardiso_is_installed() -> bool:
    """Return whether pypardiso can be imported, without importing it."""
    return importlib.util.find_spec("pypardiso") is not None


@dataclass(frozen=True)
class Pardiso:
    """PARDISO with separate calls of its three phases. The order of elimination is computed once per pattern.

    >>> import numpy as np
    >>> from scipy.sparse import csr_matrix
    >>> K = csr_matrix(np.array([[2.0, -1, 0], [-1, -2, 1], [0, 1, 3]]))
    >>> unknowns = Unknowns(np.arange(3), np.zeros(3, dtype=int), K.indptr, K.indices)
    >>> factors = Pardiso().analyse(unknowns).factorise(K, Kind.SYMMETRIC)                # doctest: +SKIP
    >>> factors.negative_pivots                                                           # doctest: +SKIP
    1
    """

    name: ClassVar[str] = "pardiso"
    takes: ClassVar[Kind] = Kind.GENERAL
    matrix_free: ClassVar[bool] = False
    iterative: ClassVar[bool] = False

    def analyse(self, unknowns: Unknowns) -> PardisoAnalysis:
        """Compute the order of elimination of symmetric matrices of this structure.

        Raises
        ------
        ImportError
            if pypardiso is missing, with the line that installs it.
        """
        return PardisoAnalysis(self, unknowns)


class PardisoAnalysis(CheckedAnalysis):
    """One set of PARDISO's internal memory, for the type of matrix of the last request, symmetric or general."""

    def __init__(self, solver: Pardiso, unknowns: Unknowns) -> None:
        super().__init__(solver, unknowns)
        self._memory = _Memory(unknowns, SYMMETRIC)
        self._memory.call(ANALYSE)

    @locked
    def factorise(self, K: Any, kind: Kind) -> PardisoFactors:
        """Factorise with the present order of elimination.

        A general matrix after symmetric ones, or the reverse, needs a new order.
        """
        values, mtype = self.begin_with(K, kind), GENERAL if kind == Kind.GENERAL else SYMMETRIC
        if self._memory.mtype != mtype:
            self._memory.release()
            self._memory = _Memory(self.unknowns, mtype)
            self._memory.fill(values)
            self._memory.call(ANALYSE)  # for a general matrix, the analysis uses the values, too
        self._memory.fill(values)
        return PardisoFactors(self, self._memory)


class PardisoFactors(CheckedFactors):
    """Factors `L D L'` or `L U`, in the memory of the analysis.

    Attributes
    ----------
    perturbed_pivots
        Number of pivots that were too small to divide by, which PARDISO replaced. The matrix is then nearly singular.
    """

    def __init__(self, analysis: PardisoAnalysis, memory: _Memory) -> None:
        super().__init__(analysis)
        self._memory = memory
        self._exact = memory.call(FACTORISE)
        self.perturbed_pivots = memory.iparm(PERTURBED)
        certain = self._exact and memory.mtype == SYMMETRIC and not self.perturbed_pivots
        self._negative = memory.iparm(NEGATIVE) if certain else None

    @property
    def nbytes(self) -> int:
        """Bytes of the factors and of the memory of the analysis, as PARDISO reports them."""
        return 1024 * sum(self._memory.iparm(number) for number in KILOBYTES)

    @property
    def negative_pivots(self) -> int | None:
        """Number of negative eigenvalues; None if pivots were perturbed, because their signs are not significant."""
        return self._negative

    def _solve(self, b: Vector, rtol: float, x0: Vector | None, out: Vector | None) -> Solution:
        """Solve with the factors, and refine if the residual requires it. `x0` is ignored."""
        if not self._exact:
            return Solution.none(b, Outcome.SINGULAR)
        return solve_checked(self._memory.product, self._memory.solve, b, rtol)

    @latest_only
    def solve_many(self, B: Vector) -> Vector:
        """Return the solutions (n, m) for the columns of B (n, m), not refined; NaN if K is singular.

        This is ten times as fast as column by column.
        """
        return self._memory.solve(np.asfortranarray(B)) if self._exact else np.full(B.shape, np.nan)


class _Memory:
    """PARDISO's handle and the arrays that it reads. Only this class calls pypardiso, whose `_call_pardiso` is private."""

    def __init__(self, unknowns: Unknowns, mtype: int) -> None:
        self._error, self._pardiso = _package(mtype)
        self.n, self.mtype = unknowns.n, mtype
        indptr, indices, self._retained = _structure(unknowns, mtype)
        self._matrix = csr_matrix((np.zeros(len(indices)), indices, indptr), shape=(self.n, self.n))
        self._diagonal = indptr[:-1] if mtype == SYMMETRIC else None
        self.release = weakref.finalize(self, _release, self._pardiso)

    def fill(self, values: NDArray[np.float64]) -> None:
        """Set the values for the next phases."""
        self._matrix.data[:] = values if self._retained is None else values[self._retained]

    def call(self, phase: int) -> bool:
        """Run a phase without a right-hand side. Return False if the matrix is singular."""
        return self._run(phase, np.zeros(self.n)) is not None

    def solve(self, b: Vector) -> Vector:
        """Return the solution with the current factors; NaN if the matrix is singular, which MKL up to 2023 reports only here."""
        x = self._run(SOLVE, b)
        return np.full(b.shape, np.nan) if x is None else x

    def _run(self, phase: int, b: Vector) -> Vector | None:
        """Return the result of a phase for `b`; None if the matrix is singular."""
        self._pardiso.set_phase(phase)
        try:
            return np.asarray(self._pardiso._call_pardiso(self._matrix, b))
        except self._error as error:
            if error.value in (-4, -7):
                return None
            raise StvkError(
                f"PARDISO ended with error {error.value}, {ERRORS.get(error.value, 'see its manual')}, for {self.n} unknowns and "
                f"{self._matrix.nnz} values. An iterative solver needs less memory: solver='amg-cg'."
            ) from error

    def product(self, x: Vector) -> Vector:
        """Return the product `K x`, computed from the stored triangle."""
        K = self._matrix
        if self._diagonal is None:
            return np.asarray(K @ x)
        return np.asarray(K @ x + K.T @ x - K.data[self._diagonal] * x)

    def iparm(self, number: int) -> int:
        """Return PARDISO's value of this entry of iparm, counted from 1."""
        return int(self._pardiso.get_iparm(number))


def _structure(unknowns: Unknowns, mtype: int) -> tuple[Any, Any, Any]:
    """Return rows, columns, and the indices of the retained values: for symmetric matrices those of the upper triangle."""
    indptr, indices = structure_of(unknowns)
    row = np.repeat(np.arange(unknowns.n, dtype=np.int32), np.diff(indptr))
    bare = np.setdiff1d(np.arange(unknowns.n), row[row == indices])
    if len(bare):
        raise StvkError(f"K has no diagonal entry in {name_ids(bare, 'row')}; PARDISO needs all of them. Keep the zeros of K.")
    if mtype != SYMMETRIC:
        return indptr, indices, None
    retained = indices >= row
    counts = np.bincount(row[retained], minlength=unknowns.n)
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int32), indices[retained].astype(np.int32), np.flatnonzero(retained)


def _package(mtype: int) -> tuple[type[Any], Any]:
    """Return pypardiso's error class, and a new solver for this type of matrix."""
    try:
        package = importlib.import_module("pypardiso.pardiso_wrapper")
    except ImportError as error:
        raise ImportError(
            f"solver='pardiso' needs the package pypardiso and Intel's MKL ({error}): pip install 'skfem-stvk[pardiso]'"
        ) from error
    if not hasattr(package.PyPardisoSolver, "_call_pardiso"):
        raise ImportError("This version of pypardiso is not supported. Install one that is: pip install 'skfem-stvk[pardiso]'")
    pardiso = package.PyPardisoSolver(mtype=mtype)
    os.environ.setdefault("PYPARDISO_MKL_RT", pardiso.libmkl._name)  # otherwise each solver searches all folders again, .5 s
    for number, value in OPTIONS[mtype].items():
        pardiso.set_iparm(number, value)
    return package.PyPardisoError, pardiso


def _release(pardiso: Any) -> None:
    pardiso.free_memory(everything=True)
