"""PETSc, through the optional package petsc4py: on one machine, or on all ranks of a body.

Sums over the elements of a rank are a local matrix of PETSc's type MATIS, which PETSc adds up at the nodes that ranks share.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ..arguments import shown
from ..errors import StvkError, name_ids
from ..kernels.threads import locked
from ..space import Space
from .amg import Pace
from .solver import CheckedAnalysis, CheckedFactors, Kind, Outcome, Solution, Unknowns, Vector, structure_of

#: Prefix of the options in PETSc's database.
PREFIX = "stvk_"
#: Options by default. Those of the method depend on the kind of K, and are left out if the user names a method.
#: `jacobi_abs` keeps the smoother positive definite where K is not, so that conjugate gradients can see it. MUMPS counts negative
#: eigenvalues only with `icntl_24`.
DEFAULT = (
    "-ksp_atol 0 -ksp_divtol 1e30 -pc_type gamg -pc_gamg_threshold 0.01 -mg_levels_ksp_type chebyshev -mg_levels_pc_type jacobi "
    "-mg_levels_pc_jacobi_abs -mat_mumps_icntl_24 1"
)
SYMMETRIC, GENERAL = "-ksp_type cg", "-ksp_type gmres -ksp_gmres_restart 100"
#: Eigenvalues of the Gram matrix of rigid motions below this fraction of the largest are those of dependent motions.
DEPENDENT = 1e-12
#: Largest number of rows of a coarsest matrix whose eigenvalues are computed. Below `-ROUNDING |K|` they count as negative.
MOST_ROWS, ROUNDING = 2000, 8 * float(np.finfo(float).eps)

MISSING = """solver='petsc' needs petsc4py, PETSc and an MPI library ({error}). On Debian and Ubuntu:
    apt install python3-petsc4py python3-petsc4py-real python3-mpi4py openmpi-bin python3-venv
    export PETSC_DIR=/usr/lib/petscdir/petsc3.18/x86_64-linux-gnu-real        # the version that is there
    /usr/bin/python3 -m venv --system-site-packages venv && venv/bin/pip install ".[mpi]" "numpy<2"    # in a checkout
Elsewhere: conda install -c conda-forge petsc4py mpi4py"""

#: Outcomes of PETSc's `KSPConvergedReason`. The residual of a solve that converged is still checked; any other reason is a failure.
OUTCOMES = {
    **dict.fromkeys((1, 2, 3, 4, 6, 7, 8, 9), Outcome.SOLVED),
    5: Outcome.NEGATIVE_CURVATURE,  # KSP_CONVERGED_CG_NEG_CURVE
    -3: Outcome.OUT_OF_ITERATIONS,
    -8: Outcome.NEGATIVE_CURVATURE,  # KSP_DIVERGED_INDEFINITE_PC
    -9: Outcome.NOT_FINITE,
    -10: Outcome.NEGATIVE_CURVATURE,  # KSP_DIVERGED_INDEFINITE_MAT
    -11: Outcome.SINGULAR,  # KSP_DIVERGED_PC_FAILED
}


@dataclass(frozen=True)
class Petsc:
    """Methods and preconditioners of PETSc; by default conjugate gradients with smoothed-aggregation multigrid (GAMG).

    An unsymmetric K is solved by GMRES. The relative tolerance is that of each solve, whatever `-ksp_rtol` says. Cholesky factors
    count negative eigenvalues; without them and without conjugate gradients, a K that is not positive definite may pass unseen.

    Attributes
    ----------
    options
        PETSc's options without a prefix. Those in PETSc's database have the prefix `stvk_`, such as
        `PETSC_OPTIONS=-stvk_ksp_monitor`, and precede.

    Examples
    --------
    >>> solver = Petsc("-pc_type cholesky -pc_factor_mat_solver_type mumps -ksp_type preonly")
    >>> solver.options.split()[:2]
    ['-pc_type', 'cholesky']
    """

    options: str = ""

    name: ClassVar[str] = "petsc"
    takes: ClassVar[Kind] = Kind.GENERAL
    matrix_free: ClassVar[bool] = False
    on_parts: ClassVar[bool] = True

    @property
    def iterative(self) -> bool:
        """Whether a larger rtol makes the solver faster, which is so unless the factors alone solve (`-ksp_type preonly`)."""
        return "preonly" not in self.options.split()

    def __post_init__(self) -> None:
        words = self.options.split() if isinstance(self.options, str) else ["?"]
        if words and not _is_name(words[0]):
            raise StvkError(f"options = {shown(self.options)}; expected PETSc's options, such as '-ksp_type cg -pc_type gamg'.")
        object.__setattr__(self, "options", str(self.options))

    @property
    def available(self) -> bool:
        """Whether petsc4py can be imported, with the MPI library of mpi4py."""
        try:
            return _package() is not None
        except ImportError:
            return False

    def analyse(self, unknowns: Unknowns) -> PetscAnalysis:
        """Number the unknowns of all ranks, and create the matrix.

        Raises
        ------
        ImportError
            if petsc4py is missing, with the lines that install it, or if it has another MPI library than mpi4py.
        StvkError
            if PETSc's integers cannot count the entries of K.
        """
        return PetscAnalysis(self, unknowns)


class PetscAnalysis(CheckedAnalysis):
    """PETSc's matrix and its solver. The matrix of this rank shares the memory of its values with PETSc."""

    def __init__(self, solver: Petsc, unknowns: Unknowns) -> None:
        super().__init__(solver, unknowns)
        self._options_text = solver.options
        self._petsc = PETSc = _package()
        self._space = unknowns.space or Space(unknowns.n)
        self._rows = rows = BlockRows(unknowns, self._space)
        self._comm, one = self._space.comm.mpi or PETSc.COMM_SELF, PETSc.COMM_SELF
        check_range(
            max(self._space.comm.total(float(rows.own.size)), self._space.comm.most(float(rows.values.size))), PETSc.IntType
        )
        dofs = (rows.d * rows.numbers[:, None] + np.arange(rows.d)).ravel().astype(PETSc.IntType)
        numbers, size = PETSc.LGMap().create(dofs[:: rows.d] // rows.d, bsize=rows.d, comm=self._comm), (rows.own.size, None)
        self._sum = PETSc.Mat().createIS((size, size), numbers, numbers, comm=self._comm)
        structure = rows.indptr.astype(PETSc.IntType), rows.indices.astype(PETSc.IntType), rows.values
        self._part = PETSc.Mat().createAIJWithArrays((len(dofs), len(dofs)), structure, rows.d, comm=one)
        self._sum.setISLocalMat(self._part)
        self.matrix, self._general, self.pace = PETSc.Mat(), False, Pace()
        self.method: Any = None
        self._at_nodes = PETSc.Vec().createSeq(len(dofs), comm=one)
        self._scatter = PETSc.Scatter().create(self.vector(), PETSc.IS().createGeneral(dofs, comm=one), self._at_nodes, None)

    @locked
    def factorise(self, K: Any, kind: Kind) -> PetscFactors:
        """Add up the matrices of all ranks, and set up the preconditioner."""
        self._rows.fill(self.begin_with(K, kind))
        self._part.assemble()
        self._sum.assemble()
        try:
            with self._options(kind is Kind.GENERAL):
                self._convert(kind)
                self._set_up(kind is Kind.GENERAL)
        except self._petsc.Error as error:
            raise StvkError(f"options = {self._options_text!r}: PETSc refuses the matrix or its options. {error}") from error
        return PetscFactors(self, kind is not Kind.GENERAL)

    def negative_pivots(self) -> int | None:
        """Return the number of negative eigenvalues of the last matrix, from its Cholesky factors; None if there are none."""
        preconditioner = self.method.getPC()
        if preconditioner.getType() != "cholesky":
            return None
        try:
            return int(preconditioner.getFactorMatrix().getInertia()[0])
        except self._petsc.Error:
            return None  # of a package that does not count

    def is_indefinite(self) -> bool:
        """Return whether the coarsest matrix of multigrid has negative eigenvalues, and so has K.

        Such a preconditioner is indefinite itself. Conjugate gradients might then converge without a direction of negative
        curvature.
        """
        preconditioner = self.method.getPC()
        if preconditioner.getType() not in ("gamg", "mg"):
            return False
        coarsest = preconditioner.getMGCoarseSolve().getOperators()[0]
        if not 0 < (n := coarsest.getSize()[0]) <= MOST_ROWS:
            return False
        begin, end = coarsest.getOwnershipRange()
        rows = np.zeros((n, n))
        for row in range(begin, end):
            columns, values = coarsest.getRow(row)
            rows[row, columns] = values
        return bool(
            np.linalg.eigvalsh(self._space.comm.total(rows))[0] < -ROUNDING * self.matrix.norm(self._petsc.NormType.INFINITY)
        )

    def _convert(self, kind: Kind) -> None:
        """Set the values of the matrix of all ranks, and its properties."""
        self._sum.convert("aij", self.matrix)
        self.matrix.setOptionsPrefix(PREFIX)
        self.matrix.setOption(self._petsc.Mat.Option.SYMMETRIC, kind is not Kind.GENERAL)
        self.matrix.setOption(self._petsc.Mat.Option.SPD, kind is Kind.POSITIVE_DEFINITE)
        if self.unknowns.near_null_space is not None:
            motions = orthonormal(np.asarray(self.unknowns.near_null_space()), self._space)
            vectors = [self.put(motion, self.vector()) for motion in motions.T]
            self.matrix.setNearNullSpace(self._petsc.NullSpace().create(vectors=vectors, comm=self._comm))

    def _set_up(self, general: bool) -> None:
        """Set up the preconditioner. GAMG retains its interpolation from matrix to matrix, until iterations grow."""
        if is_new := self.method is None or self._general != general or self.pace.is_slow:
            self.method, self._general, self.pace = self._petsc.KSP().create(self._comm), general, Pace()
            self.method.setOptionsPrefix(PREFIX)
        self.method.setOperators(self.matrix)  # otherwise PETSc retains the preconditioner of the previous values
        if is_new:
            self.method.setFromOptions()
        self.method.setUp()
        self.method.setUpOnBlocks()
        if is_new:
            _refuse_unused(self._options_text)

    @contextmanager
    def _options(self, general: bool) -> Iterator[None]:
        """Set the solver's options, and those by default, in PETSc's database. Options that are there precede and remain."""
        database = self._petsc.Options(PREFIX)
        before = database.getAll()
        named = f"{self._options_text} {' '.join(f'-{name}' for name in before)}".split()
        method = "" if "-ksp_type" in named else f"{GENERAL if general else SYMMETRIC} -ksp_norm_type unpreconditioned"
        database.prefixPush(PREFIX)
        for text in (DEFAULT, method, self._options_text):
            database.insertString(text)
        database.prefixPop()
        for name, value in before.items():
            database.setValue(name, value)
        try:
            yield
        finally:
            for name in database.getAll().keys() - before.keys():
                database.delValue(name)

    def vector(self) -> Any:
        """Return a new vector of PETSc for the entries of all ranks."""
        return self._sum.createVecLeft()

    def put(self, x: Vector, vector: Any) -> Any:
        """Write the entries of the unknowns (n,) that count on this rank to PETSc's vector, and return it."""
        vector.array[:] = self._rows.padded(x)[self._rows.own]
        return vector

    def get(self, vector: Any) -> Vector:
        """Return the entries (n,) of PETSc's vector for the unknowns; other ranks have the same bits where they share nodes."""
        self._scatter.scatter(vector, self._at_nodes)
        return np.asarray(self._at_nodes.array[self._rows.dofs])


class PetscFactors(CheckedFactors):
    """Preconditioner of one matrix.

    Attributes
    ----------
    negative_pivots
        Number of negative eigenvalues; None if they are not counted.
    """

    _analysis: PetscAnalysis

    def __init__(self, analysis: PetscAnalysis, symmetric: bool) -> None:
        super().__init__(analysis)
        self.negative_pivots = analysis.negative_pivots() if symmetric else None
        self._looks = symmetric and self.negative_pivots is None  # for directions of negative curvature
        self._indefinite = self._looks and analysis.is_indefinite()
        self._b, self._x, self._r, self._y = (analysis.vector() for _ in range(4))

    def _solve(self, b: Vector, rtol: float, x0: Vector | None, out: Vector | None) -> Solution:
        """Solve for the correction `K y = b - K x0`, and once more if the residual of `x0 + y` requires it."""
        found = self._solution(b, rtol, x0)
        self._analysis.pace.record(found)
        return found

    def _solution(self, b: Vector, rtol: float, x0: Vector | None) -> Solution:
        self._analysis.put(b, self._b)
        self._analysis.put(np.zeros_like(b) if x0 is None else x0, self._x)
        size, start = _norm(self._b), self._residual()
        if not np.isfinite(size + start):
            return Solution.none(b, Outcome.NOT_FINITE)
        if size == 0:
            return Solution(np.zeros_like(b), 0, 0.0, Outcome.SOLVED)
        method, residual, iterations = self._analysis.method, start, 0
        outcome = Outcome.NEGATIVE_CURVATURE if self._indefinite else Outcome.SOLVED
        for tolerance in (rtol * size, rtol * size / 2):
            if residual <= rtol * size or outcome is not Outcome.SOLVED:
                break
            method.setTolerances(rtol=tolerance / residual)
            method.solve(self._r, self._y)
            iterations, outcome = iterations + method.its, OUTCOMES.get(method.reason, Outcome.INACCURATE)
            if outcome is Outcome.SOLVED and self._looks and self._y.dot(self._r) <= 0:
                outcome = Outcome.NEGATIVE_CURVATURE  # y'Ky; PETSc sees only a change of the sign along the way
            self._x.axpy(1.0, self._y)
            residual = self._residual()
        if not np.isfinite(residual):
            return Solution.none(b, outcome if outcome is not Outcome.SOLVED else Outcome.NOT_FINITE)
        if outcome is Outcome.SOLVED and residual > rtol * size:
            outcome = Outcome.INACCURATE
        return Solution(self._analysis.get(self._x), iterations, residual / size, outcome, start / size)

    def _residual(self) -> float:
        """Compute the residual `b - K x`, and return its norm."""
        self._analysis.matrix.mult(self._x, self._r)
        self._r.aypx(-1.0, self._b)
        return _norm(self._r)


class BlockRows:
    """K of this rank in full blocks of `d` components, one row of blocks for each node with unknowns.

    Constrained components have a diagonal of the size of that of their node, or 1.

    Attributes
    ----------
    d
        Number of components, the same on all ranks.
    indptr, indices, values
        Structure and values in CSR format.
    dofs
        (n,) index of each unknown among the rows.
    numbers
        (nodes,) number of each row of blocks among those of all ranks. Numbers of the rows that count on a rank are contiguous.
    own
        Indices of the rows that count on this rank, ascending.
    """

    def __init__(self, unknowns: Unknowns, space: Space) -> None:
        self.d = d = int(space.comm.most(float(unknowns.component.max(initial=0)))) + 1
        new = np.diff(unknowns.vertex, prepend=-1) != 0
        first, node = np.flatnonzero(new), np.cumsum(new) - 1
        self.dofs, self._n = d * node + unknowns.component, d * len(first)
        self._expand(*structure_of(unknowns))
        counts = space.counted(np.ones(unknowns.n)) > 0
        own, own_nodes = np.flatnonzero(counts[first]), counts[first]
        start = 0 if space.comm.mpi is None else space.comm.mpi.scan(len(own)) - len(own)
        self.numbers = space.share(np.where(counts, start + (np.cumsum(own_nodes) - 1)[node], 0.0))[first].astype(np.int64)
        self.own = (d * own[:, None] + np.arange(d)).ravel()

    def _expand(self, indptr: NDArray[np.integer[Any]], indices: NDArray[np.integer[Any]]) -> None:
        """Compute the structure, and the index of each value in those of K."""
        counts = np.zeros(self._n, dtype=np.int64)
        counts[self.dofs] = np.diff(indptr)
        rows, entries = np.append(0, np.cumsum(counts)), np.arange(1, len(indices) + 1)
        full = csr_matrix((entries, self.dofs[indices], rows), shape=(self._n, self._n)).tobsr((self.d, self.d)).tocsr()
        full.sort_indices()
        self.indptr, self.indices, self.values = full.indptr, full.indices, np.zeros(full.nnz)
        self._filled = np.flatnonzero(full.data)
        self._sources = full.data[self._filled] - 1
        self._diagonal = np.flatnonzero(np.repeat(np.arange(self._n), np.diff(full.indptr)) == full.indices)
        if len(self._diagonal) < self._n:
            bare = np.setdiff1d(np.arange(self._n), full.indices[self._diagonal])
            raise StvkError(f"K has no diagonal block in {name_ids(bare, 'row')}; PETSc needs all of them. Keep the zeros of K.")
        self._is_padding = np.ones(self._n, dtype=bool)
        self._is_padding[self.dofs] = False

    def fill(self, values: Vector) -> None:
        """Write the values of K over the unknowns, and those of constrained components."""
        self.values[self._filled] = values[self._sources]
        if self._is_padding.any():
            self.values[self._diagonal[self._is_padding]] = 0
            size = np.abs(self.values[self._diagonal]).reshape(-1, self.d).max(axis=1)
            self.values[self._diagonal[self._is_padding]] = np.repeat(np.where(size > 0, size, 1.0), self.d)[self._is_padding]

    def padded(self, x: Vector) -> Vector:
        """Return values of the unknowns (n,) as values of the rows, with zeros for constrained components."""
        out = np.zeros(self._n)
        out[self.dofs] = x
        return out


def orthonormal(modes: Vector, space: Space) -> Vector:
    """Return orthonormal vectors (n, r) with the same span, fewer if they are dependent."""
    own = space.counted(np.ones(len(modes)))[:, None] * modes
    values, vectors = np.linalg.eigh(space.comm.total(own.T @ modes))
    independent = values > DEPENDENT * values[-1]
    return np.asarray(modes @ (vectors[:, independent] / np.sqrt(values[independent])))


def check_range(count: float, integer: type[np.signedinteger[Any]]) -> None:
    """Refuse a number of rows or entries that PETSc's integers cannot count."""
    if count > (most := np.iinfo(integer).max):
        raise StvkError(
            f"K has {count:.0f} rows, or entries on one rank; expected at most {most}, which the integers of this PETSc count. Use "
            "more ranks, or a PETSc that was configured with --with-64-bit-indices."
        )


def _norm(x: Any) -> float:
    """Return the norm of a vector of PETSc; infinity if the square overflows."""
    return float(np.sqrt(x.dot(x)))


def _is_name(word: str) -> bool:
    return word[:1] == "-" and word[1:2].isalpha()


@cache
def _package() -> Any:
    """Return petsc4py's module. Refuse a PETSc with another MPI library than that of mpi4py.

    PETSc leaves signals to Python, unless it was started before: its own handlers end the process, even for a broken pipe.
    """
    try:
        import petsc4py
        from mpi4py import MPI

        if "petsc4py.PETSc" not in sys.modules:
            petsc4py.init(["python", "-no_signal_handler"])
        from petsc4py import PETSc
    except ImportError as error:
        raise ImportError(MISSING.format(error=error)) from error
    text, length = ctypes.create_string_buffer(8192), ctypes.c_int()
    ctypes.CDLL(PETSc.__file__).MPI_Get_library_version(text, ctypes.byref(length))
    if (ours := MPI.Get_library_version().strip("\0 \n")) != (theirs := text.value.decode().strip()):
        raise ImportError(
            f"petsc4py uses the MPI library {theirs!r}; expected that of mpi4py, {ours!r}. " + MISSING.format(error="")
        )
    return PETSc


def _refuse_unused(options: str) -> None:
    """Refuse options that PETSc has not read, such as misspelled ones."""
    library, used = ctypes.CDLL(_package().__file__), ctypes.c_int()
    unused = []
    for name in filter(_is_name, options.split()):
        library.PetscOptionsUsed(None, f"{PREFIX}{name[1:]}".encode(), ctypes.byref(used))
        unused += [] if used.value else [name]
    if unused:
        raise StvkError(
            f"options = {options!r}: PETSc has not used {', '.join(unused)}. Is the name misspelled, or for another method? "
            f"Options that are read later are given to PETSc itself: PETSC_OPTIONS=-{PREFIX}{unused[0][1:]}."
        )
