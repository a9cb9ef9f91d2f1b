"""Tangent over the free degrees of freedom, assembled in place as a matrix or an operator, and factorised by a linear solver."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ..arguments import Array
from ..edges import ALL, Tensions
from ..edges.bound_term import joined
from ..errors import StvkError
from ..linear import BlockJacobiCg, Factors, Kind, LinearSolver, Unknowns, choose
from ..linear.amg import AmgAnalysis
from ..linear.choose import transposition
from ..terms.loads.load import Time
from .operator import FreeOperator, TangentOperator
from .rigid import rigid_modes
from .system import System

#: Stiffness added to a tangent that may be singular, as a fraction of the largest diagonal entry of each vertex.
SHIFT = 1e-4
#: Largest asymmetry of a symmetric Jacobian, relative to its largest entry.
SYMMETRIC = 1e-12
EPS = float(np.finfo(float).eps)
#: Largest round-off of a force that counts, as a fraction of the stiffness at rest times an edge length. Errors are at most 1e-10
#: of this product, unless stretches of inverted elements nearly cancel. In that case the tangent has no bound, and the errors are
#: 1e-3 to 100 of it.
MOST = 1e-6


class FreeTangent:
    """Tangent of a system over its free degrees of freedom: the analysis of K and K itself, in reused memory.

    An equation assembles K with `at`, or with `matrix` or `operator` if it adds parts of its own (masses, damping). Then it calls
    `factorise`. If `kind` allows a K that is not symmetric, the values of each matrix decide. `symmetric` is the result for the
    last one. `exact` are the factors of the last exact Jacobian, without a substitute.

    Attributes
    ----------
    space, constrained
        Spaces of the free and of the constrained degrees of freedom.
    multigrid
        Analysis of multigrid, which reuses its hierarchy from matrix to matrix; None with other solvers.
    position
        (ndofs,) current displacements of the body [m], for solvers that use its rigid motions; `at` sets it.
    """

    def __init__(self, system: System, solver: LinearSolver, kind: Kind) -> None:
        self.system, self.kind = system, kind
        self.free = system.free_dofs(system.supports.held)
        self.space, self.constrained = system.space.on(self.free.free), system.space.on(self.free.fixed)
        self.position = np.zeros(system.ndofs)
        self.symmetric = kind is not Kind.GENERAL
        self._operator: TangentOperator | None = None
        self.use_solver(solver)

    def use_solver(self, solver: LinearSolver) -> None:
        """Use this solver from now on."""
        self.solver = solver
        self.exact: Factors | None = None
        self._exact_version: int | None = None
        self._transposition: NDArray[np.int64] | None = None
        self._K: csr_matrix | None = None
        self._assembled_at: Array | None = None
        self._free_arguments: tuple[Time, Tensions, bool] | None = None  # arguments of a K without the columns of constrained dofs
        self._Kff: csr_matrix | None = None
        self._version, self._analysis = self.system.pattern_version, solver.analyse(self.unknowns())
        self.multigrid = self._analysis if isinstance(self._analysis, AmgAnalysis) else None

    def replace_system(self, system: System) -> None:
        """Continue with a system with removed elements, which has the same pattern of K. The analysis of the solver is reused."""
        self.system, self.free = system, self.free.of(system)
        self._operator = self._exact_version = None
        self.__dict__.pop("_largest_error", None)

    def unknowns(self) -> Unknowns:
        """Return the unknowns, with the structure of K unless the solver never forms K."""
        vertices_and_components = np.divmod(self.free.free, self.system.mesh.d)
        if self.solver.matrix_free:
            return Unknowns(*vertices_and_components, space=self.space)
        structure, ends = self.free.structure, self.system.mesh.ends()
        return Unknowns(*vertices_and_components, structure.indptr, structure.indices, self.rigid_modes, ends, self.space)

    def rigid_modes(self) -> Array:
        """Return the rigid motions (n, r) of the body in its current position."""
        mesh = self.system.mesh
        return rigid_modes(mesh.p.T + self.position.reshape(-1, mesh.d), mesh.space)[self.free.free]

    def at(self, u: Array, t: Time, kept: Tensions, shifted: bool) -> csr_matrix | FreeOperator:
        """Return the Jacobian at `u` (ndofs,) over the free degrees of freedom, for `factorise`.

        `kept` are the tensions of edges that enter it.

        With `shifted`, a small stiffness is added to the diagonal, so that the matrix is positive definite.
        """
        self.position = u
        if self.solver.matrix_free:
            operator = self.operator(u, t, kept)
            diagonal = np.einsum("vcc->vc", operator.diagonal_blocks()).ravel()[self.free.free] if shifted else None
            return FreeOperator(operator, self.free, None if diagonal is None else self.shift(diagonal))
        K = self.free_matrix(u, t, kept)
        if shifted:
            self.add_shift(K)
        return K

    def matrix(self, u: Array, t: Time, kept: Tensions = ALL, follows: bool = True) -> csr_matrix:
        """Return the Jacobian at `u` (ndofs,) of all degrees of freedom, in the memory of the previous one.

        Without `follows`, return the elastic K, which has no stiffness of follower loads. If a term has changed the nodes it
        couples, K has another structure, which is analysed again.
        """
        self._follow_pattern(u, t)
        self._free_arguments = None
        if follows:
            self._K = self.system.jacobian(u, t, out=self._K, kept=kept)
        else:
            self._K = self.system.tangent(u, out=self._K, t=t)
        return self._K

    @cached_property
    def needs_only_free(self) -> bool:
        """Whether K over the free degrees of freedom is sufficient, because no support moves.

        A start that violates the supports is an exception.
        """
        return not self.space.comm.any(self.system.supports.prescribed.size > 0)

    def free_matrix(self, u: Array, t: Time, kept: Tensions = ALL, follows: bool = True) -> csr_matrix:
        """Return K as in `matrix`, over the free degrees of freedom; all of K is assembled only where it is needed."""
        if not self.needs_only_free:
            return self.restricted(self.matrix(u, t, kept, follows))
        self._follow_pattern(u, t)
        if self._assembled_at is None:
            self._assembled_at = np.empty(self.system.ndofs)
        self._assembled_at[:] = u
        self._free_arguments = t, kept, follows
        if follows:
            self._Kff = self.system.jacobian(u, t, out=self._Kff, kept=kept, free=self.free)
        else:
            self._Kff = self.system.tangent(u, out=self._Kff, free=self.free, t=t)
        return self._Kff

    def operator(self, u: Array, t: Time, kept: Tensions = ALL) -> TangentOperator:
        """Return the tangent at `u` (ndofs,) as an operator on all degrees of freedom, in the memory of the previous one."""
        if self._operator is None:
            self._operator = self.system.linear_operator(u, kept=kept, t=t)
        else:
            self._operator.prepare(u, kept=kept, t=t)
        return self._operator

    def _follow_pattern(self, u: Array, t: Time) -> None:
        """Analyse the structure of K at `u` (ndofs,) if it is another one than before."""
        self.system.look(u, t)
        if self.system.pattern_version != self._version:
            self.use_solver(self.solver)

    def restricted(self, K: csr_matrix) -> csr_matrix:
        """Return `K` restricted to the free degrees of freedom, in the memory of the previous restriction."""
        self._Kff = self.free.matrix(K, out=self._Kff)
        return self._Kff

    def shift(self, diagonal: Array) -> Array:
        """Return a stiffness (n,) for each free degree of freedom, small against the largest diagonal entry of its vertex."""
        vertex = self.free.free // self.system.mesh.d
        largest = np.zeros(self.system.mesh.nv)
        np.maximum.at(largest, vertex, diagonal)
        return SHIFT * np.where(largest > 0, largest, self.space.comm.most(float(largest.max())))[vertex]

    def add_shift(self, K: csr_matrix) -> None:
        """Add the `shift` to the diagonal of `K`. In a divided body, one part adds that of each degree of freedom."""
        own = K.diagonal()
        K.setdiag(own + self.space.counted(self.shift(self.space.share(own.copy()))))

    def factorise(self, K: Any, exact: bool = True) -> Factors:
        """Return the factors of `K`, a matrix or an operator over the free degrees of freedom.

        `exact` says that `K` is the exact Jacobian, not a substitute.
        """
        factors = self._analysis.factorise(K, self._kind_of(K, exact))
        self._exact_version = self.system.pattern_version if exact else None
        if exact:
            self.exact = factors
        return factors

    def forget(self) -> None:
        """Drop the hierarchy of multigrid, so that the next matrix gets a new one."""
        if self.multigrid is not None:
            self.multigrid.hierarchy = None

    @property
    def constant_factors(self) -> Factors | None:
        """Factors of the last Jacobian if it is constant and its pattern has not changed; None otherwise."""
        return self.exact if self.system.constant_tangent and self._exact_version == self.system.pattern_version else None

    def force_of(self, w: Array) -> Array:
        """Return `K w` (n,) for displacements `w` (ndofs,) of constrained degrees of freedom, with the last K."""
        if not self.space.comm.any(bool(w.any())):
            return np.zeros(len(self.free.free))
        if self._free_arguments is not None and self._assembled_at is not None:
            self.matrix(self._assembled_at, *self._free_arguments)
        K = self._operator if self.solver.matrix_free else self._K
        assert K is not None
        product = K @ w
        return np.asarray((product if self.solver.matrix_free else self.system.space.share(product))[self.free.free])

    def new_matrix(self, u: Array, t: Time) -> tuple[csr_matrix, Unknowns]:
        """Return the Jacobian at `u` over the free degrees of freedom as a new matrix, and its unknowns."""
        K = self.system.jacobian(u, t, free=self.free)
        return K, Unknowns(*np.divmod(self.free.free, self.system.mesh.d), K.indptr, K.indices)

    def scale(self, loads: Array, residual: Array) -> float:
        """Return the norm of the loads plus the norm of the reactions, which are in `residual` (ndofs,) [N]."""
        return self.system.space.norm(loads) + self.constrained.norm(self.constrained.restrict(residual))

    def round_off(self, u: Array, t: Time) -> Array:
        """Return the sums (ndofs,) of `System.round_off` [N], with 0 where they are too large to be meaningful."""
        return below(self._largest_error, self.system.round_off(u, t))

    @cached_property
    def _largest_error(self) -> Array:
        return largest_error(self.system)

    def _kind_of(self, K: Any, exact: bool) -> Kind:
        """Return the kind of K.

        With follower loads K may be symmetric, too, if the rim of their surface is constrained or the surface is closed.
        """
        if self.kind is not Kind.GENERAL:
            return Kind.POSITIVE_DEFINITE if not exact and self.system.dead else self.kind
        if self._transposition is None:
            self._transposition = transposition(K)
        skewed = self.space.comm.most(float(np.abs(K.data - K.data[self._transposition]).max(initial=0.0)))
        self.symmetric = skewed <= SYMMETRIC * self.space.comm.most(float(np.abs(K.data).max(initial=0.0)))
        return Kind.SYMMETRIC if self.symmetric else Kind.GENERAL


def entries_of(system: System) -> int:
    """Return the approximate number of entries of K, from the term that couples the most pairs of nodes."""
    pairs = max((term.nodes_paired.shape[1] for term in system.bound_terms), default=0)
    return int(system.mesh.d**2 * (system.mesh.nv + 2 * pairs))


def kind_of(system: System) -> Kind:
    """Return the kind of the Jacobian of a system."""
    return Kind.SYMMETRIC if system.conservative else Kind.GENERAL


def with_loads(solver: LinearSolver, system: System) -> LinearSolver:
    """Return the solver, switched to an assembled matrix if loads have a stiffness, since operators contain elastic terms only.

    Raise StvkError if the solver cannot assemble a matrix.
    """
    if system.dead or not solver.matrix_free:
        return solver
    system.space.comm.refuse_divided(
        f"solver = '{solver.name}', which forms no matrix",
        "'petsc'",
        "a load depends on the displacements, and its stiffness requires a matrix.",
    )
    if not isinstance(solver, BlockJacobiCg):
        raise StvkError(
            f"solver = '{solver.name}', which forms no matrix; expected one that does, such as 'amg-cg' or 'superlu': a load "
            "depends on the displacements, and its stiffness requires a matrix."
        )
    return replace(solver, assembled=True)


def solver_for(system: System, solver: str | LinearSolver, indefinite: bool = False) -> LinearSolver:
    """Return the requested linear solver, see `choose`, for the Jacobian over the free degrees of freedom of a system."""
    if system.space.comm.divided:
        return with_loads(choose(solver, system.space.count, kind_of(system), indefinite, divided=True), system)
    free = system.ndofs - len(system.supports.held)
    return with_loads(choose(solver, free, kind_of(system), indefinite, entries_of(system)), system)


def largest_error(system: System) -> Array:
    """Return `MOST |K_aa| l_a` (ndofs,) [N], with the tangent K at rest and the longest edge `l_a` of each node.

    Nodes without stiffness at rest get the largest value of all nodes.
    """
    p, d, lengths = system.mesh.p, system.mesh.d, np.zeros(system.mesh.nv)
    for term in system.bound_terms:
        ends = joined(term)
        edges = np.linalg.norm(p[:, ends[0]] - p[:, ends[1]], axis=0)
        for end in ends:
            np.maximum.at(lengths, end, edges)
    blocks = system.linear_operator(np.zeros(system.ndofs)).diagonal_blocks()
    errors = MOST * np.abs(blocks).max(axis=(1, 2)) * lengths
    return np.repeat(np.where(errors > 0, errors, system.space.comm.most(float(errors.max(initial=0.0)))), d)


def below(largest: Array, sums: Array) -> Array:
    """Return `sums`, which are round-off errors over eps, with 0 for entries with an error above `largest`."""
    return np.where(EPS * sums <= largest, sums, 0.0)
