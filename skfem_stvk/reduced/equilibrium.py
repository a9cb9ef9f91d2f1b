"""The equilibrium of a body whose displacements are those of a few coordinates, as a problem for the walk along a path."""

from __future__ import annotations

from functools import cached_property
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgetrf, dgetrs, dpotrf, dpotrs
from scipy.sparse import csr_matrix

from ..arguments import Array
from ..errors import StateError
from ..linear import Unknowns
from ..linear.solver import Outcome, Solution
from ..nonlinear.problem import Residual, Tangent
from ..nonlinear.stopwatch import Stopwatch
from ..results.monitors import named_elements
from ..system import System
from ..system.round_off import EPS, below, largest_error
from ..terms.load import Time

#: Loads and reactions below this part of the largest on the path count as this part, as with all coordinates.
NOTHING = 1e-6
#: Part of the load factor, or of 1, over which loads and prescribed motions are differenced; exact for what grows linearly.
DIFFERENCE = 1e-6
#: A tangent is symmetric to this part of its largest entry.
SYMMETRIC = 1e-12
#: Eigenvalues of a tangent that stands in for an indefinite one are at least this part of the largest one.
LEAST = 1e-8


class OnBasis(Protocol):
    """Interface of static solves and motions to a body with displacements `u = columns z`, `z = (q, s)` (m,).

    The first `size` of the coordinates z are free, the others are the amounts of what is prescribed.
    """

    @property
    def body(self) -> System: ...
    @property
    def columns(self) -> Array:
        """(ndofs, m) displacements for each of the coordinates."""

    @property
    def size(self) -> int: ...
    @property
    def quartic(self) -> bool:
        """Whether the strain energy is a quartic along any line of states."""

    @property
    def signature(self) -> list[float]:
        """A few numbers by which files know the basis again."""

    def amounts(self, t: Time) -> Array:
        """(l,) amounts of what is prescribed."""

    def state(self, u: Array, t: Time) -> Array:
        """(m,) coordinates of displacements (ndofs,), as near as the basis comes to them, those prescribed as at `t`."""

    def response(self, z: Array) -> tuple[float, Array, Array]:
        """Strain energy [J], its gradient (m,) and its second derivatives (m, m)."""

    def energy_along_states(self, z: Array, v: Array) -> Array:
        """(5,) coefficients of the strain energy along `z + s v`, where that is quartic."""

    def loads(self, z: Array, t: Time) -> Array:
        """(m,) loads on the coordinates, `columns' f_ext`."""

    def load_stiffness_of(self, z: Array, t: Time) -> Array | None:
        """(m, m) `-d loads/dz`, what all loads that follow the body add to the tangent; None if there are none."""


def largest_error_on(reduced: OnBasis) -> Array:
    """Return the bound of `largest_error` on the coordinates (m,) [N m]: that of all nodes, times the fields."""
    bound: Array = largest_error(reduced.body) @ np.abs(reduced.columns)
    return bound


class DenseFactors:
    """Factors of a full matrix `K` (n, n), which is kept: Cholesky's, LU if it is not symmetric, else its eigenvalues.

    Only a symmetric matrix that is not positive definite needs eigenvalues: they are counted, and `turned` takes their absolute
    values, so that the solution is a direction in which the energy falls.

    >>> DenseFactors(np.array([[2.0, 1.0], [1.0, 1.0]])).solve(np.array([3.0, 2.0])).x
    array([1., 1.])
    >>> saddle = np.diag([2.0, -1.0])
    >>> DenseFactors(saddle).negative_pivots, DenseFactors(saddle, turned=True).solve(np.ones(2)).x
    (1, array([0.5, 1. ]))
    """

    def __init__(self, K: Array, symmetric: bool = True, turned: bool = False) -> None:
        self._K, self._symmetric = K, symmetric
        self._values: Array | None = None
        self._vectors = K
        self.negative_pivots: int | None = None
        if symmetric:
            self._factors, failed = dpotrf(K, lower=1, clean=0)
            if not failed:
                self.negative_pivots = 0
            elif np.isfinite(K).all():
                values, self._vectors = np.linalg.eigh(K)
                self.negative_pivots = int((values < 0).sum())
                self._values = np.maximum(np.abs(values), LEAST * np.abs(values).max(initial=0.0)) if turned else values
        else:
            self._factors, self._pivots, _ = dgetrf(K)

    def solve(self, b: Array, rtol: float = 1e-10, x0: Array | None = None, out: Array | None = None) -> Solution:
        """`x` with `K x = b`, as precise as the factors are: `rtol` and `x0` are of other solvers."""
        if self._values is not None:
            if not self._values.all():
                return Solution.none(b, Outcome.SINGULAR)
            x = self._vectors @ ((b @ self._vectors) / self._values)
        elif self._symmetric:
            x = dpotrs(self._factors, b, lower=1)[0]
        else:
            x = dgetrs(self._factors, self._pivots, b)[0]
        if not np.isfinite(x @ x):
            return Solution.none(b, Outcome.SINGULAR if np.isfinite(b).all() else Outcome.NOT_FINITE)
        if out is not None:
            out[:] = x
            x = out
        return Solution(x, 0, 0.0, Outcome.SOLVED)


class DenseSolver:
    """The linear solver of small full matrices: Cholesky's factors."""

    name, iterative, matrix_free = "dense", False, False


class DenseProblem:
    """The part of a `Problem` on the first `n` of a state's coordinates, `q` of `(q, s)`, whose full matrices are factorised."""

    def __init__(self, reduced: OnBasis, watch: Stopwatch) -> None:
        self._free, self._watch = slice(reduced.size), watch
        self.states = reduced.body.space.spanned_by(reduced.columns)
        self.space = self.states.on(self._free)
        self._negative: int | None = None

    def solve(self, factors: DenseFactors, b: Array, rtol: float) -> Solution:
        with self._watch("solve"):
            return factors.solve(b, rtol)

    def take_over(self, u: Array, t: Time) -> bool:
        """Never: the solver is a direct one."""
        return False

    def negative_pivots(self) -> int | None:
        return self._negative

    def _factors(self, K: Array, symmetric: bool, tangent: Tangent) -> DenseFactors:
        """Factors of K (n, n); where it is not positive definite, what stands in for it has its eigenvalues without their signs."""
        with self._watch("factor"):
            factors = DenseFactors(K, symmetric, tangent is not Tangent.EXACT)
            if tangent is Tangent.EXACT:
                self._negative = factors.negative_pivots
            return factors


class ReducedEquilibrium(DenseProblem):
    """`dW/dq = V' f_ext` over the coordinates of a basis: a `PathProblem` whose states are `z = (q, s)` (m,).

    Nothing in an iteration depends on the mesh. Elements are looked at where a solve begins and where it ends: it is cut back where
    some are inside out there, not where they would be on the way.
    """

    iterative: ClassVar[bool] = False
    solver: ClassVar[DenseSolver] = DenseSolver()

    def __init__(self, reduced: OnBasis, watch: Stopwatch) -> None:
        super().__init__(reduced, watch)
        self.reduced, self.system = reduced, reduced.body
        self._held = self.states.on(slice(reduced.size, None))
        self.largest, self.symmetric = 0.0, True
        self._K = np.zeros((reduced.columns.shape[1],) * 2)
        self._looked: tuple[Array, NDArray[np.int64]] | None = None
        self._known: tuple[Array, tuple[float, Array, Array]] | None = None
        lengths = np.sqrt(np.einsum("ij,ij->j", reduced.columns, reduced.columns))
        held = lengths[reduced.size :]
        #: Forces on free coordinates over those on prescribed ones that the same forces on nodes make: their units differ.
        self._alike = float(lengths[self._free].mean() / held.mean()) if len(held) else 0.0

    @property
    def quartic(self) -> bool:
        return self.reduced.quartic and self.system.dead

    @property
    def dead(self) -> bool:
        return self.system.dead

    def state(self, u: Array, t: Time) -> Array:
        return self.reduced.state(u, t)

    def residual(self, u: Array, t: Time) -> Residual:
        with self._watch("assemble"):
            _, force, _ = self._response(u)
            loads = self.reduced.loads(u, t)
            left, norm = force - loads, self.space.norm
            free, held = self.space.restrict(left), self._held.norm(self._held.restrict(left))
            size, scale = norm(free), norm(self.space.restrict(loads)) + self._alike * held
            if not np.isfinite(size + scale):
                raise StateError(f"The residual overflows at coordinates of up to {np.abs(u).max():.1e}.")
            return Residual(free, size, max(scale, NOTHING * self.largest))

    def round_off(self, u: Array, t: Time) -> float:
        sums = below(self._largest_error, np.abs(self._response(u)[2]) @ np.abs(u)) + np.abs(self.reduced.loads(u, t))
        return EPS * float(np.sqrt(len(u))) * self.space.norm(self.space.restrict(sums))

    @cached_property
    def _largest_error(self) -> Array:
        return largest_error_on(self.reduced)

    def factorise(self, u: Array, t: Time, tangent: Tangent = Tangent.EXACT) -> DenseFactors:
        with self._watch("assemble"):
            self._K = self._jacobian(u, t)
        return self._factors(self._K[self._free, self._free], self.symmetric, tangent)

    def matrix(self, u: Array, t: Time) -> tuple[csr_matrix, Unknowns]:
        n, K = self.space.n, self._jacobian(u, t)[self._free, self._free]
        indices, indptr = np.tile(np.arange(n), n), n * np.arange(n + 1)  # all entries, also those that are zero
        sparse = csr_matrix((K.ravel(), indices, indptr), shape=(n, n))
        return sparse, Unknowns(np.arange(n), np.zeros(n, dtype=np.int64), sparse.indptr, sparse.indices)

    def operator(self, u: Array, t: Time) -> csr_matrix:
        return self.matrix(u, t)[0]

    def stiffness_norm(self, u: Array, t: Time) -> float:
        return float(np.abs(self._jacobian(u, t)[self._free, self._free]).sum(axis=1).max())

    def energy_along(self, u: Array, v: Array, t: Time) -> Array:
        with self._watch("assemble"):
            c = self.reduced.energy_along_states(u, v)
            c[1] -= self.states.dot(self.reduced.loads(u, t), v)
            return c

    def step_limit(self, u: Array, v: Array) -> float:
        """Infinite: elements are not looked at on the way."""
        return float("inf")

    def on_this_side(self, u: Array, found: Array) -> bool:
        """Always true, as with `step_limit`."""
        return True

    def inside_out(self, u: Array) -> NDArray[np.int64]:
        """Return as in `Problem`; a solve asks before and after, so the answer for a state is kept."""
        if self._looked is None or not np.array_equal(self._looked[0], u):
            with self._watch("assemble"):
                self._looked = u.copy(), self.system.inside_out(self.states.expand(u))
        return self._looked[1]

    def named(self, inside_out: NDArray[np.int64]) -> str:
        return named_elements(self.system.mesh, inside_out)

    def place(self, u: Array, t: float) -> Array:
        u[self.space.n :] = self.reduced.amounts(t)
        return u

    def rate(self, u: Array, t: float) -> tuple[Array, Array]:
        dt = DIFFERENCE * max(abs(t), 1.0) * (1 if t < 0.5 else -1)  # functions of t may end at 0 and 1
        forces, moves = self.change(u, t, t + dt)
        return forces / dt, moves / dt

    def change(self, u: Array, t: float, later: float) -> tuple[Array, Array]:
        moves = np.zeros_like(u)
        moves[self.space.n :] = self.reduced.amounts(later) - self.reduced.amounts(t)
        loads = self.reduced.loads(u, later) - self.reduced.loads(u, t)
        return self.space.restrict(loads) - self.force_of(moves), moves

    def force_of(self, w: Array) -> Array:
        force: Array = self._K[self._free] @ w
        return force

    def accept(self, u: Array, t: Time) -> None:
        residual = self.residual(u, t)
        self.largest = max(self.largest, residual.scale, residual.size)

    def forget(self) -> None:
        """Do nothing: nothing is kept."""

    def commit(self, u: Array) -> None:
        """Do nothing: bodies with a memory have no reduced ones."""

    def restore(self) -> None:
        """Do nothing, as in `commit`."""

    def energies(self, u: Array, t: Time) -> tuple[float, float]:
        full = self.states.expand(u)
        loads = self.system.potential(full, t) - self.system.energy(full) if self.system.conservative else float("nan")
        energy = self._response(u)[0]
        return energy, energy + loads

    def elastic_along(self, u: Array, v: Array) -> Array | None:
        return self.reduced.energy_along_states(u, v) if self.reduced.quartic else None

    def smallest_volume_ratio(self, u: Array) -> float:
        return self.system.smallest_volume_ratio(self.states.expand(u))

    def _response(self, z: Array) -> tuple[float, Array, Array]:
        """Strain energy, forces and stiffness at `z`, which a residual and its tangent share."""
        if self._known is None or not np.array_equal(self._known[0], z):
            energy, force, K = self.reduced.response(z)
            self._known = z.copy(), (energy, force.copy(), K.copy())
        return self._known[1]

    def _jacobian(self, u: Array, t: Time) -> Any:
        K, follows = self._response(u)[2], self.reduced.load_stiffness_of(u, t)
        if follows is not None:
            K = K + follows
        if not self.system.conservative:
            free = K[self._free, self._free]
            self.symmetric = bool(np.abs(free - free.T).max() <= SYMMETRIC * np.abs(free).max())
        return K
