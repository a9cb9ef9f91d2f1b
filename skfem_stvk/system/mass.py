"""The mass of a body, lumped at its vertices or consistent with linear displacements."""

from __future__ import annotations

from abc import ABC, abstractmethod
from math import ceil, log, sqrt
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, diags

from ..arguments import Array, number
from ..edges.simplices import nbytes
from ..errors import MaterialError, name_ids
from ..mesh import ElementMesh
from ..mesh.displacements import finite_vector
from .pattern import Patterned


class Mass(ABC):
    """The mass matrix M of a body; `System.mass(kind)` makes it.

        lumped        M_aa = sum over elements of m_e / (k + 1)
        consistent    M_ab = sum over elements of m_e / ((k + 1) (k + 2)) (1 + delta_ab)

    the same for each component. Both have the mass and the centre of mass of the body; the consistent one has its moments of
    inertia, too.

    Attributes
    ----------
    kind : "lumped" or "consistent".
    vertex : (nv,) lumped masses [kg], the row sums of either.

    >>> import skfem
    >>> from skfem_stvk import StVK, System
    >>> body = System(skfem.MeshTri(), StVK(young=1.0, poisson=0.3, density=6.0), fixed={(0,): "xy"})
    >>> mass = body.mass()
    >>> mass.total, mass.vertex, mass.solve(np.ones(8)).tolist()
    (6.0, array([1., 2., 2., 1.]), [0.0, 0.0, 0.5, 0.5, 0.5, 0.5, 1.0, 1.0])
    >>> body.mass("consistent").matrix.toarray()[::2, ::2].round(12)
    array([[0.5 , 0.25, 0.25, 0.  ],
           [0.25, 1.  , 0.5 , 0.25],
           [0.25, 0.5 , 1.  , 0.25],
           [0.  , 0.25, 0.25, 0.5 ]])
    """

    kind: ClassVar[str]

    def __init__(self, system: Patterned, mesh: ElementMesh, elements: Array, held: NDArray[Any]) -> None:
        self._d, self._system = mesh.d, system
        shares = np.tile(elements / (mesh.k + 1), mesh.k + 1)
        self.vertex: Array = np.bincount(mesh.t.ravel(), weights=shares, minlength=mesh.nv).astype(np.float64)
        is_free = np.ones(mesh.p.size, dtype=bool)
        is_free[held] = False
        self._free = is_free.reshape(-1, mesh.d)
        self._places: NDArray[np.intp] | None = None
        self._version = 0
        self._refuse_bare()

    @property
    def total(self) -> float:
        """Mass of the body [kg]."""
        return float(self.vertex.sum())

    @property
    @abstractmethod
    def matrix(self) -> csr_matrix:
        """M (ndofs, ndofs): diagonal if it is lumped, otherwise in the pattern of K."""

    @abstractmethod
    def multiply(self, v: Array, out: Array | None = None) -> Array:
        """`M v` (ndofs,), written to `out` if that is given; it may be `v`.

        Raises
        ------
        StateError
            if `v` does not have one finite entry for each degree of freedom.
        """

    @abstractmethod
    def solve(self, f: Array) -> Array:
        """The accelerations `M^-1 f` (ndofs,) [m/s^2] that forces `f` (ndofs,) [N] cause while what is held does not move.

        It is 0 at what is held, whatever acts there: M over the free degrees of freedom is inverted. Errors as in `multiply`.
        """

    @abstractmethod
    def _values(self) -> tuple[NDArray[np.intp], Array]:
        """(n, d) places in the values of a K, and (n, 1) or (n, d) what is added there."""

    def memory(self) -> int:
        """Bytes of its arrays."""
        return sum(value.nbytes for value in vars(self).values() if isinstance(value, np.ndarray))

    def add_to(self, K: csr_matrix, factor: float) -> None:
        """Add `factor` M to a K of the system, in place.

        Raises
        ------
        StvkError
            if K has another pattern.
        """
        self._system.pattern.refuse_other(K)
        places, values = self._values()
        K.data[places] += number("factor", factor, "a finite number") * values

    def _diagonals(self, a: NDArray[np.int32], b: NDArray[np.int32]) -> NDArray[np.intp]:
        """(n, d) places of the diagonals of blocks `(a, b)` in the values of K, worked out once for each version of its pattern."""
        pattern = self._system.pattern
        if self._places is None or self._version != pattern.version:
            first, steps = pattern.places(a, b), np.arange(self._d)
            self._places, self._version = first[:, None] + steps * (pattern.strides[a][:, None] + 1), pattern.version
        return self._places

    def _vector(self, name: str, given: Any) -> Array:
        """(ndofs,) finite numbers in double precision."""
        return finite_vector(name, given, self._free.size).astype(np.float64, copy=False)

    def _refuse_bare(self) -> None:
        bare = np.flatnonzero((self.vertex <= 0) & self._free.any(axis=1))
        if len(bare):
            raise MaterialError(
                f"{name_ids(bare, 'vertex')} of {len(self.vertex)}: can move, but without mass, because in no element with a "
                "StVK(..., density=...). Give their elements one, fix all their components, or leave them out of the mesh."
            )

    def __repr__(self) -> str:
        return f"Mass: {self.total:g} kg at {len(self.vertex)} vertices, {self.kind}"


class LumpedMass(Mass):
    """A number for each vertex."""

    kind = "lumped"

    def __init__(self, system: Patterned, mesh: ElementMesh, elements: Array, held: NDArray[Any]) -> None:
        super().__init__(system, mesh, elements, held)
        self._dofs = np.repeat(self.vertex, mesh.d)
        self._inverse = _inverse(self.vertex, self._free).ravel()

    @property
    def matrix(self) -> csr_matrix:
        return diags(self._dofs, format="csr")

    def multiply(self, v: Array, out: Array | None = None) -> Array:
        return np.multiply(self._dofs, self._vector("v", v), out=out)

    def solve(self, f: Array) -> Array:
        return np.asarray(self._inverse * self._vector("f", f))

    def _values(self) -> tuple[NDArray[np.intp], Array]:
        every = np.arange(len(self.vertex), dtype=np.int32)
        return self._diagonals(every, every), self.vertex[:, None]


class ConsistentMass(Mass):
    """A number for each pair of vertices; solved with by a fixed number of steps of Chebyshev's iteration (Wathen, Rees 2009).

    Scaled by its diagonal, every eigenvalue of an element's M is 1/2 or (k + 2)/2, so those of the whole, held or not, are between
    them.
    """

    kind = "consistent"

    def __init__(self, system: Patterned, mesh: ElementMesh, elements: Array, held: NDArray[Any]) -> None:
        super().__init__(system, mesh, elements, held)
        self._scalar = _scalar_matrix(mesh, elements)
        self._inverse = _inverse(self._scalar.diagonal(), self._free)
        self._bounds = 0.5, (mesh.k + 2) / 2

    @property
    def matrix(self) -> csr_matrix:
        M = self._system.pattern.matrix(np.zeros(self._system.pattern.nnz))
        self.add_to(M, 1.0)
        return M

    def multiply(self, v: Array, out: Array | None = None) -> Array:
        product: Array = (self._scalar @ np.reshape(self._vector("v", v), self._free.shape)).ravel()
        if out is None:
            return product
        out[:] = product
        return out

    def solve(self, f: Array) -> Array:
        low, high = self._bounds
        centre, half, ratio = (high + low) / 2, (high - low) / 2, sqrt(high / low)
        r = np.array(self._vector("f", f)).reshape(self._free.shape)
        x, step, rho = np.zeros_like(r), self._inverse * r / centre, half / centre
        for _ in range(ceil(log(2 / np.finfo(float).eps) / log((ratio + 1) / (ratio - 1)))):
            x += step
            r -= self._scalar @ step
            before, rho = rho, 1 / (2 * centre / half - rho)
            step *= rho * before
            step += 2 * rho / half * (self._inverse * r)
        return x.ravel()

    def _values(self) -> tuple[NDArray[np.intp], Array]:
        scalar = self._scalar
        row = np.repeat(np.arange(len(self.vertex), dtype=np.int32), np.diff(scalar.indptr))
        return self._diagonals(row, scalar.indices), scalar.data[:, None]

    def memory(self) -> int:
        return super().memory() + nbytes([self._scalar.data, self._scalar.indices, self._scalar.indptr])


#: By name, in the order in which messages name them.
KINDS: dict[str, type[Mass]] = {"lumped": LumpedMass, "consistent": ConsistentMass}


def _scalar_matrix(mesh: ElementMesh, elements: Array) -> csr_matrix:
    """(nv, nv) consistent masses of one component; only elements that have mass couple their vertices."""
    heavy = np.flatnonzero(elements > 0)
    t, corners = mesh.t[:, heavy], mesh.k + 1
    values = (1 + np.eye(corners))[:, :, None] * (elements[heavy] / (corners * (corners + 1)))
    row, column = (np.broadcast_to(ids, values.shape).ravel() for ids in (t[:, None], t[None]))
    matrix = csr_matrix((values.ravel() / 2, (row, column)), shape=(mesh.nv, mesh.nv))
    matrix = csr_matrix(matrix + matrix.T)  # to the last bit as symmetric as no order of summation is
    matrix.sort_indices()
    return matrix


def _inverse(diagonal: Array, is_free: NDArray[np.bool_]) -> Array:
    """(nv, d) of free degrees of freedom, 0 for those that are held."""
    return np.where(is_free, 1 / np.where(is_free.any(axis=1), diagonal, 1.0)[:, None], 0.0)
