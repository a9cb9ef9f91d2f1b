"""Bodies with displacements in a few coordinates, with their masses and tangents in these coordinates."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_matrix

from ..arguments import Array, shown
from ..edges import Tensions
from ..errors import StvkError
from ..kernels.threads import CopyableLock, locked
from ..linear import Unknowns
from ..linear.dense import DenseFactors, DenseSolver
from ..mesh import ElementMesh
from ..mesh.displacements import finite_vector
from ..terms.loads.load import Time
from .free_tangent import SYMMETRIC, below, largest_error
from .signature import sums
from .system import System

#: Number of states with cached energy, force and stiffness: a time step has two Gauss points and its end.
CACHED = 3


class FreeCoordinates(NamedTuple):
    """Indices of the free and of the prescribed coordinates."""

    free: NDArray[np.int64]
    fixed: NDArray[np.int64]


class Coordinates(ABC):
    """Body with displacements `u = columns z`, with the interface of a `System` in the coordinates `z`.

    The first `size` of the coordinates `z = (q, s)` (m,) are free, the others are prescribed. The body must not have terms with
    history, or that change with time.

    Attributes
    ----------
    system
        The body with all its displacements; results are on its mesh.
    columns
        (ndofs, m) displacements of the coordinates; the first `size` are orthonormal in the masses.
    masses
        (ndofs,) lumped masses [kg].
    free
        `FreeCoordinates`.
    """

    constant_tangent: ClassVar[bool] = False
    #: Names of terms without an energy: none, and the energies of single terms are not available.
    without_energy: ClassVar[tuple[str, ...]] = ()
    elastic_names: ClassVar[tuple[str, ...]] = ()

    def __init__(self, system: System, columns: Array, size: int, masses: Array) -> None:
        self.system, self.columns, self.size, self.masses = system, columns, size, masses
        self.space = system.space.spanned_by(columns)
        self.free = FreeCoordinates(np.arange(size), np.arange(size, columns.shape[1]))
        self._known: dict[bytes, tuple[float, Array, Array]] = {}
        self._last_inverted: tuple[Array, NDArray[np.int64]] | None = None
        self._lock = CopyableLock()  # of the cached responses, and of work arrays, which calls of several threads share

    @property
    @abstractmethod
    def quartic(self) -> bool:
        """Whether the strain energy is a quartic along any line."""

    @abstractmethod
    def prescribed_values(self, t: Time) -> Array:
        """Return the prescribed coordinates `s` (l,) at load factor `t`, or at a `Moment`."""

    @abstractmethod
    def response(self, z: Array) -> tuple[float, Array, Array]:
        """Return the strain energy [J], its gradient (m,) and its second derivatives (m, m)."""

    @abstractmethod
    def energy_along(self, z: Array, v: Array) -> Array:
        """Return the coefficients (5,) of the strain energy along `z + s v`, if it is quartic."""

    @abstractmethod
    def external_force(self, z: Array, t: Time) -> Array:
        """Return the loads on the coordinates (m,), `columns' f_ext`."""

    @abstractmethod
    def load_stiffness(self, z: Array, t: Time) -> Array | None:
        """Return minus the derivative of the loads (m, m); None if all of them are dead."""

    @property
    def mesh(self) -> ElementMesh:
        """Mesh of the body."""
        return self.system.mesh

    @property
    def signature(self) -> list[float]:
        """Numbers that identify the basis in files."""
        return [float(self.size), *sums(self.columns)]

    def state(self, u: ArrayLike, t: Time) -> Array:
        """Return the coordinates (m,) nearest to displacements (ndofs,) in the mass norm, with the prescribed ones at `t`."""
        x, s = finite_vector("u", u, self.system.ndofs), self.prescribed_values(t)
        basis, lifts = self.columns[:, : self.size], self.columns[:, self.size :]
        return np.concatenate([basis.T @ (self.masses * (x - lifts @ s)), s])

    def prescribe(self, z: Array, t: Time) -> Array:
        """Write the prescribed coordinates at `t` to `z`, in place."""
        z[self.size :] = self.prescribed_values(t)
        return z

    @locked
    def linearize(self, z: Array) -> tuple[float, Array, Array]:
        """Return `response`, cached for the last three states. The arrays must not be changed."""
        key = z.tobytes()
        if key not in self._known:
            if len(self._known) == CACHED:
                del self._known[next(iter(self._known))]  # the oldest
            self._known[key] = self.response(z)
        return self._known[key]

    def elastic_energies(self, z: Array, t: Time = 0.0) -> list[float]:
        """Return the strain energy of all terms together [J], in a list."""
        return [self.linearize(z)[0]]

    def internal_force(self, z: Array, t: Time = 0.0) -> Array:
        """Return `dW/dz` (m,)."""
        return self.linearize(z)[1].copy()

    def energy_and_force(self, z: Array, out: Array, t: Time = 0.0) -> tuple[float, Array]:
        """Return the strain energy and `dW/dz`, which is written to `out`."""
        energy, out[:], _ = self.linearize(z)
        return energy, out

    def jacobian(self, z: Array, t: Time) -> Array:
        """Return the derivative of the residual (m, m)."""
        K, follows = self.linearize(z)[2], self.load_stiffness(z, t)
        return K if follows is None else K + follows

    def linear_operator(self, z: Array, t: Time = 0.0) -> Array:
        """Return `d2W/dz2` (m, m), for products `K @ x`."""
        return self.linearize(z)[2]

    def potential(self, z: Array, t: Time) -> float:
        """Return the sum of strain energy and potentials of the loads [J]."""
        u = self.space.expand(z)
        return self.linearize(z)[0] + (self.system.potential(u, t) - self.system.energy(u))

    def mass(self, kind: str) -> CoordinateMass:
        """Return the lumped mass; raise StvkError for another `kind`."""
        if kind != CoordinateMass.kind:
            raise StvkError(f"mass = {kind!r} for a reduced system; expected 'lumped': its basis is orthonormal in those masses.")
        return CoordinateMass(self)

    def inside_out(self, z: Array) -> NDArray[np.int64]:
        """Return the ids of the inverted or flat elements; the result for the last state is cached."""
        last = self._last_inverted  # read once, since other threads write it
        if last is None or not np.array_equal(last[0], z):
            last = self._last_inverted = z.copy(), self.system.inside_out(self.space.expand(z))
        return last[1]

    def first_history(self) -> tuple[Array, ...]:
        """Return nothing, because no term has history."""
        return ()

    def advanced(self, history: Sequence[Array], z: Array, t: Time) -> tuple[Array, ...]:
        """Return nothing, as in `first_history`."""
        return ()

    def after_step(self, history: Sequence[Array]) -> tuple[Array, ...]:
        """Return nothing, as in `first_history`."""
        return ()

    def return_to(self, history: Sequence[Array]) -> None:  # noqa: B027
        """Do nothing, as in `first_history`."""


class CoordinateMass:
    """Mass matrix `columns' M columns` (m, m) for lumped masses M, and momenta in coordinates and their rates."""

    kind: ClassVar[str] = "lumped"

    def __init__(self, body: Coordinates) -> None:
        d, B, X, masses = body.mesh.d, body.columns, body.mesh.p, body.system.mass(self.kind).vertex
        along = [np.ascontiguousarray(B[i::d]) for i in range(d)]  # (nv, m) displacements by component
        weighed = [masses[:, None] * one for one in along]
        m, self._free = B.shape[1], body.size
        self.matrix: Array = np.add.reduce([a.T @ b for a, b in zip(along, weighed, strict=True)])
        self._factors = DenseFactors(self.matrix[: self._free, : self._free].copy())
        linear, angular = np.zeros((6, m)), np.zeros((3, m, m))
        for i in range(d):
            linear[i] = weighed[i].sum(axis=0)
        for k, (i, j) in enumerate([(1, 2), (2, 0), (0, 1)]):
            if i < d and j < d:
                linear[3 + k] = X[i] @ weighed[j] - X[j] @ weighed[i]
                one = along[i].T @ weighed[j]
                angular[k] = one - one.T
        self._sums = np.vstack([self.matrix, linear, angular.reshape(3 * m, m)])

    def multiply(self, v: Array, out: Array | None = None) -> Array:
        """Return `M v` (m,)."""
        product: Array = np.dot(self.matrix, v, out=out)
        return product

    def solve(self, f: Array) -> Array:
        """Return accelerations (m,) under forces (m,).

        They are zero in prescribed coordinates, whose columns are M-orthogonal to the others.
        """
        a = np.zeros_like(f)
        a[: self._free] = self._factors.solve(f[: self._free]).x
        return a

    def momenta(self, z: Array, v: Array, sums: Array) -> None:
        """Write `v' M v`, linear momentum and angular momentum to `sums` (8,)."""
        products, m = self._sums @ v, len(v)
        sums[0] = v @ products[:m]
        sums[1:7] = products[m : m + 6]
        sums[4:7] += products[m + 6 :].reshape(3, m) @ z


class DenseTangent:
    """Tangent of a body in coordinates, with dense factors and the interface of `FreeTangent`."""

    solver: ClassVar[DenseSolver] = DenseSolver()
    multigrid: ClassVar[None] = None
    constant_factors: ClassVar[None] = None

    def __init__(self, body: Coordinates) -> None:
        self.body, self.free, self._free = body, body.free, slice(body.size)
        self.space, self.constrained = body.space.on(self._free), body.space.on(slice(body.size, None))
        self.symmetric = True
        self.exact: DenseFactors | None = None
        self._K = np.zeros((body.space.n,) * 2)
        lengths = np.sqrt(np.einsum("ij,ij->j", body.columns, body.columns))
        constrained = self.constrained.restrict(lengths)
        #: Ratio of forces on free coordinates to forces on prescribed ones for the same nodal forces; their units differ.
        self._force_ratio = float(self.space.restrict(lengths).mean() / constrained.mean()) if len(constrained) else 0.0

    def at(self, z: Array, t: Time, kept: Tensions, shifted: bool) -> Array:
        """Return the exact Jacobian (m, m); `factorise` makes it positive definite on request."""
        return self.body.jacobian(z, t)

    def factorise(self, K: Array, exact: bool = True) -> DenseFactors:
        """Return the factors of `K` (m, m) over the free coordinates; unless `exact`, with absolute values of the eigenvalues."""
        self._K, free = K, K[self._free, self._free]
        if not self.body.system.conservative:
            self.symmetric = bool(np.abs(free - free.T).max() <= SYMMETRIC * np.abs(free).max())
        factors = DenseFactors(free, self.symmetric, absolute=not exact)
        if exact:
            self.exact = factors
        return factors

    def force_of(self, w: Array) -> Array:
        """Return `K w` (n,) for a change `w` (m,) of prescribed coordinates, with the last factorised K."""
        force: Array = self._K[self._free] @ w
        return force

    def new_matrix(self, z: Array, t: Time) -> tuple[csr_matrix, Unknowns]:
        """Return the Jacobian over the free coordinates as a full matrix in sparse format, and its unknowns."""
        n, K = self.space.n, self.body.jacobian(z, t)[self._free, self._free]
        indices, indptr = np.tile(np.arange(n), n), n * np.arange(n + 1)
        sparse = csr_matrix((K.ravel(), indices, indptr), shape=(n, n))
        return sparse, Unknowns(np.arange(n), np.zeros(n, dtype=np.int64), sparse.indptr, sparse.indices)

    def scale(self, loads: Array, residual: Array) -> float:
        """Return the norm of the loads plus the norm of the reactions, which are in `residual` (m,)."""
        return self.space.norm(self.space.restrict(loads)) + self._force_ratio * self.constrained.norm(
            self.constrained.restrict(residual)
        )

    def round_off(self, z: Array, t: Time, K: Array | None = None) -> Array:
        """Return `|K| |z|` (m,), the round-off of the internal force over eps. K is by default the stiffness at `z`.

        Entries are 0 where the estimate is too large to be meaningful.
        """
        K = self.body.linearize(z)[2] if K is None else K
        return below(self._largest_error, np.abs(K) @ np.abs(z))

    @cached_property
    def _largest_error(self) -> Array:
        """Bound of the round-off (m,): the nodal bounds times the columns [N m]."""
        bound: Array = largest_error(self.body.system) @ np.abs(self.body.columns)
        return bound

    def forget(self) -> None:
        """Do nothing, because no data is reused from one matrix to the next."""

    def use_solver(self, solver: Any) -> None:
        """Do nothing, because no other solver can take over."""


@runtime_checkable
class ReducedLike(Protocol):
    """Body with displacements in a few coordinates, which `solve_static` and `simulate` accept like a `System`."""

    @property
    def in_coordinates(self) -> Coordinates:
        """Body in coordinates, the form that equations use.

        Its `system` is the full body, and results are on the mesh of that body.
        """


def checked_system(system: Any, name: str = "system") -> System:
    """Return the system; raise StvkError, with `name`, for any other object."""
    if not isinstance(system, System):
        raise StvkError(f"{name} = {shown(system)}; expected a System: System(mesh, terms, fixed=..., prescribed=...).")
    return system


def checked_whole(system: Any, analysis: str, name: str = "system") -> System:
    """Return the system as `checked_system` does; refuse a body that is divided into parts, for this `analysis`."""
    system = checked_system(system, name)
    factors = "it needs all elements, or factors of the whole K, which no part has."
    system.space.comm.refuse_divided(analysis, "a body on one machine", factors)
    return system
