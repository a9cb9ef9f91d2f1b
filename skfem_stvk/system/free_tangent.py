"""The tangent over the free degrees of freedom: made in place, as a matrix or as an operator, and factorised by a linear solver."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ..arguments import Array
from ..edges import ALL, Tensions
from ..errors import StvkError
from ..linear import BlockJacobiCg, Factors, Kind, LinearSolver, Unknowns, choose
from ..linear.amg import AmgAnalysis
from ..linear.inertia import transposition
from ..terms.load import Time
from .operator import FreeOperator, TangentOperator
from .rigid import rigid_modes
from .round_off import below, largest_error
from .system import System

#: What is added to a tangent without any stiffness in some direction, as a part of the largest diagonal entry of each vertex.
SHIFT = 1e-4
#: A Jacobian is symmetric to this part of its largest entry.
SYMMETRIC = 1e-12


class FreeTangent:
    """The tangent of a system over its free degrees of freedom: the analysis of K, and K itself, always in the same place.

    An equation makes K by `at`, or by `matrix` or `operator` if it adds parts of its own (masses, damping), and has it factorised.
    Where `kind` says that K need not be symmetric, the values of each matrix tell whether it is: `symmetric` is that of the last
    one. `exact` are the factors of the last Jacobian that nothing stood in for.

    Attributes
    ----------
    space, held : the spaces of the free and of the constrained degrees of freedom.
    position : (ndofs,) displacements of the body now [m], for solvers that use its rigid motions; `at` sets it.
    """

    def __init__(self, system: System, solver: LinearSolver, kind: Kind) -> None:
        self.system, self.kind = system, kind
        self.free = system.free_dofs(system.supports.held)
        self.space, self.held = system.space.on(self.free.free), system.space.on(self.free.fixed)
        self.position = np.zeros(system.ndofs)
        self.symmetric = kind is not Kind.GENERAL
        self._operator: TangentOperator | None = None
        self.take(solver)

    def take(self, solver: LinearSolver) -> None:
        """Solve with this solver from here on."""
        self.solver = solver
        self.exact: Factors | None = None
        self._made_for: int | None = None
        self._turned: NDArray[np.int64] | None = None
        self._K: csr_matrix | None = None
        self._made_at: Array | None = None
        self._lacking: tuple[Time | None, Tensions] | None = None  # of a K that was made without that of what is held
        self._Kff: csr_matrix | None = None
        self._version, self._analysis = self.system.pattern_version, solver.analyse(self.unknowns())

    def follow(self, system: System) -> None:
        """Go on with the torn system, which has the same pattern of K: the analysis of the solver stays."""
        self.system, self.free = system, self.free.of(system)
        self._operator = self._made_for = None
        self.__dict__.pop("_largest_error", None)

    def unknowns(self) -> Unknowns:
        """The unknowns; with the structure of K unless it is never formed."""
        places = np.divmod(self.free.free, self.system.mesh.d)
        if self.solver.matrix_free:
            return Unknowns(*places)
        ends = self.system.mesh.ends()
        return Unknowns(*places, self.free.structure.indptr, self.free.structure.indices, self.rigid_modes, ends)

    def rigid_modes(self) -> Array:
        """(n, r) rigid motions of the body as it is deformed now."""
        mesh = self.system.mesh
        return rigid_modes(mesh.p.T + self.position.reshape(-1, mesh.d))[self.free.free]

    def at(self, u: Array, t: Time, kept: Tensions, shifted: bool) -> csr_matrix | FreeOperator:
        """The Jacobian at `u` (ndofs,) over the free degrees of freedom, for `factorise`, with the tensions that are `kept`.

        `shifted`: with a little stiffness on the diagonal, so that it is positive definite.
        """
        self.position = u
        if self.solver.matrix_free:
            operator = self.operator(u, kept)
            diagonal = np.einsum("vcc->vc", operator.diagonal_blocks()).ravel()[self.free.free] if shifted else None
            return FreeOperator(operator, self.free, None if diagonal is None else self.shift(diagonal))
        K = self.free_matrix(u, t, kept)
        if shifted:
            K.setdiag(K.diagonal() + self.shift(K.diagonal()))
        return K

    def matrix(self, u: Array, t: Time | None, kept: Tensions = ALL) -> csr_matrix:
        """The Jacobian at `u` (ndofs,) of all degrees of freedom, in the place of the one before; without a time, the elastic K.
        Where a term has changed which vertices it couples, K has another structure, which is analysed anew."""
        self._follow_pattern()
        self._lacking = None
        if t is None:
            self._K = self.system.tangent(u, out=self._K)
        else:
            self._K = self.system.jacobian(u, t, out=self._K, kept=kept)
        return self._K

    @property
    def straight(self) -> bool:
        """Whether K over the free degrees of freedom is enough: no support moves, but for a start that is off them."""
        return not self.system.supports.prescribed.size

    def free_matrix(self, u: Array, t: Time | None, kept: Tensions = ALL) -> csr_matrix:
        """As `matrix`, of the free degrees of freedom; without all of it where that is enough."""
        if not self.straight:
            return self.restricted(self.matrix(u, t, kept))
        self._follow_pattern()
        if self._made_at is None:
            self._made_at = np.empty(self.system.ndofs)
        self._made_at[:] = u
        self._lacking = t, kept
        if t is None:
            self._Kff = self.system.tangent(u, out=self._Kff, free=self.free)
        else:
            self._Kff = self.system.jacobian(u, t, out=self._Kff, kept=kept, free=self.free)
        return self._Kff

    def operator(self, u: Array, kept: Tensions = ALL) -> TangentOperator:
        """The tangent at `u` (ndofs,) as an operator on all degrees of freedom, in the place of the one before."""
        if self._operator is None:
            self._operator = self.system.linear_operator(u, kept=kept)
        else:
            self._operator.prepare(u, kept=kept)
        return self._operator

    def _follow_pattern(self) -> None:
        if self.system.pattern_version != self._version:
            self.take(self.solver)

    def restricted(self, K: csr_matrix) -> csr_matrix:
        """`K` of the free degrees of freedom, in the place of the one before."""
        self._Kff = self.free.matrix(K, out=self._Kff)
        return self._Kff

    def shift(self, diagonal: Array) -> Array:
        """(n,) a little stiffness for each free degree of freedom, small against the largest of its vertex."""
        vertex = self.free.free // self.system.mesh.d
        largest = np.zeros(self.system.mesh.nv)
        np.maximum.at(largest, vertex, diagonal)
        return SHIFT * np.where(largest > 0, largest, largest.max())[vertex]

    def factorise(self, K: Any, exact: bool = True) -> Factors:
        """Factors of `K` over the free degrees of freedom, a matrix or an operator; `exact`: nothing stands in for it."""
        factors = self._analysis.factorise(K, self._kind_of(K, exact))
        self._made_for = self.system.pattern_version if exact else None
        if exact:
            self.exact = factors
        return factors

    @property
    def multigrid(self) -> AmgAnalysis | None:
        """The analysis of multigrid, which keeps its hierarchy from matrix to matrix; None with other solvers."""
        return self._analysis if isinstance(self._analysis, AmgAnalysis) else None

    def forget(self) -> None:
        """Drop the hierarchy of multigrid, so that the next matrix gets a new one."""
        if self.multigrid is not None:
            self.multigrid.hierarchy = None

    @property
    def lasting(self) -> Factors | None:
        """The factors of the last Jacobian, where it is the same everywhere and still what it was then; None elsewhere."""
        return self.exact if self.system.constant_tangent and self._made_for == self.system.pattern_version else None

    def force_of(self, w: Array) -> Array:
        """(n,) `K w` for displacements `w` (ndofs,) of held degrees of freedom, by the K that was made last."""
        if not w.any():
            return np.zeros(len(self.free.free))
        if self._lacking is not None and self._made_at is not None:
            self.matrix(self._made_at, *self._lacking)
        K = self._operator if self.solver.matrix_free else self._K
        assert K is not None
        return np.asarray((K @ w)[self.free.free])

    def beside(self, u: Array, t: Time) -> tuple[csr_matrix, Unknowns]:
        """The Jacobian at `u` over the free degrees of freedom as a matrix of its own, and its unknowns."""
        K = self.system.jacobian(u, t, free=self.free)
        return K, Unknowns(*np.divmod(self.free.free, self.system.mesh.d), K.indptr, K.indices)

    def scale(self, loads: Array, left: Array) -> float:
        """Norm of the loads plus that of the reactions, which are in `left` (ndofs,) [N]."""
        return self.system.space.norm(loads) + self.held.norm(self.held.restrict(left))

    def round_off(self, u: Array) -> Array:
        """(ndofs,) sums as in `System.round_off`, 0 where they say nothing [N]."""
        return below(self._largest_error, self.system.round_off(u))

    @cached_property
    def _largest_error(self) -> Array:
        return largest_error(self.system)

    def _kind_of(self, K: Any, exact: bool) -> Kind:
        """What K is: with loads that follow the body symmetric, too, where the rim of their surface is held or they are closed."""
        if self.kind is not Kind.GENERAL:
            return Kind.POSITIVE_DEFINITE if not exact and self.system.dead else self.kind
        if self._turned is None:
            self._turned = transposition(K)
        skewed = float(np.abs(K.data - K.data[self._turned]).max(initial=0.0))
        self.symmetric = skewed <= SYMMETRIC * float(np.abs(K.data).max(initial=0.0))
        return Kind.SYMMETRIC if self.symmetric else Kind.GENERAL


def entries_of(system: System) -> int:
    """About how many entries K has, from the term that couples the most pairs of nodes."""
    pairs = max((term.nodes_paired.shape[1] for term in system.bound_terms), default=0)
    return int(system.mesh.d**2 * (system.mesh.nv + 2 * pairs))


def kind_of(system: System) -> Kind:
    """What the Jacobian of a system is."""
    return Kind.SYMMETRIC if system.conservative else Kind.GENERAL


def with_loads(solver: LinearSolver, system: System) -> LinearSolver:
    """The solver, with a matrix where loads have a stiffness, since operators have that of elastic terms alone; or an error."""
    if system.dead or not solver.matrix_free:
        return solver
    if not isinstance(solver, BlockJacobiCg):
        raise StvkError(
            f"solver = '{solver.name}', which forms no matrix; expected one that does, such as 'amg-cg' or 'superlu': a load "
            "depends on where the body goes, and its stiffness is added to a matrix."
        )
    return replace(solver, assembled=True)


def solver_for(system: System, solver: str | LinearSolver, indefinite: bool = False) -> LinearSolver:
    """The linear solver that is asked for, as `choose` has it, for the Jacobian of a system over its free degrees of freedom."""
    free = system.ndofs - len(system.supports.held)
    return with_loads(choose(solver, free, kind_of(system), indefinite, entries_of(system)), system)
