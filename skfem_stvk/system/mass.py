"""Mass of a body, lumped at its nodes or consistent with its shape functions."""

from __future__ import annotations

from abc import ABC, abstractmethod
from copy import copy
from functools import reduce
from math import ceil, log, sqrt
from operator import add
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, diags

from ..arguments import Array, number, vector
from ..edges.elements import nbytes
from ..errors import MaterialError
from ..mesh.displacements import finite_vector
from ..mesh.element import Element
from ..mesh.points import rule_of, sizes_at_points
from ..terms import Body
from ..terms.loads.spread import Spread
from .pattern import FreeDofs, HasPattern, Pattern

#: Largest ratio of Jacobians in an element that counts as straight in the eigenvalue bounds of element masses.
STRAIGHT = 1.02
#: Number of elements per batch of eigenvalue computations; relative margin for round-off.
AT_ONCE, ROUNDING = 4096, 1e-10


class Mass(ABC):
    """Mass matrix M of a body, from `System.mass(kind)`.

        lumped        M_aa = sum over elements of s_ea m_e, positive shares s_ea of sum 1: `terms.spread.lumped_shares`
        consistent    M_ab = sum over elements of the integral of rho N_a N_b

        linear simplices    s_ea = 1/(k + 1)        integral = m_e / ((k + 1) (k + 2)) (1 + delta_ab)

    M is the same for each component. Both kinds give the mass of the body. The consistent one also gives its centre of mass and
    moments of inertia. The lumped one gives the centre of mass unless quadratic elements are curved.

    Attributes
    ----------
    kind
        Kind of the mass, "lumped" or "consistent".
    vertex
        (nv,) lumped masses of the nodes [kg]; unless elements are quadratic, the row sums of either kind.
    free
        (nv, d) whether a degree of freedom is free and its node has elements.

    Examples
    --------
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

    def __init__(self, system: HasPattern, body: Body, constrained: NDArray[Any]) -> None:
        mesh = body.mesh
        self._d, self._system, self._word = mesh.d, system, mesh.word
        self._body, self._constrained = body, constrained
        self._weigh()

    def of(self, system: HasPattern, body: Body) -> Mass:
        """Return the mass of a `body` with removed elements; nodes that have lost all of their elements count as constrained."""
        other = copy(self)
        other._system, other._body = system, body
        other._weigh()
        return other

    def _weigh(self) -> None:
        """Compute the masses from the elements of the body."""
        self.vertex: Array = self._body.mesh.space.share(self._body.lumped_mass.copy())
        is_free = np.ones(self.vertex.size * self._d, dtype=bool)
        is_free[self._constrained] = False
        self.free = is_free.reshape(-1, self._d) & ~self._body.bare[:, None]
        self._diagonal_indices: tuple[Pattern, NDArray[np.intp]] | None = None
        self._part: tuple[NDArray[np.int32], NDArray[np.intp], Array] | None = None
        self._refuse_bare()

    @property
    def counted(self) -> Array:
        """Masses `vertex` (nv,), with zeros at nodes that another part of a divided body counts."""
        return self._body.mesh.space.counted(self.vertex)

    @property
    def total(self) -> float:
        """Mass of the body [kg]."""
        return self._body.mesh.space.comm.total(float(self.counted.sum()))

    @property
    @abstractmethod
    def matrix(self) -> csr_matrix:
        """M (ndofs, ndofs): a diagonal matrix if lumped, otherwise in the pattern of K."""

    @abstractmethod
    def multiply(self, v: Array, out: Array | None = None) -> Array:
        """Return `M v` (ndofs,), written to `out` if given; `out` may be `v`.

        Raises
        ------
        StateError
            if `v` does not have one finite entry for each degree of freedom.
        """

    @abstractmethod
    def solve(self, f: Array) -> Array:
        """Return the accelerations `M^-1 f` (ndofs,) [m/s^2] under forces `f` (ndofs,) [N].

        Constrained degrees of freedom do not move.

        Their accelerations are 0, whatever force acts there: M over the free degrees of freedom is inverted. Errors as in
        `multiply`.
        """

    @abstractmethod
    def _values(self) -> tuple[NDArray[np.intp], Array]:
        """Return indices (n, d) in the values of K, and the values (n, 1) or (n, d) to add there."""

    def memory(self) -> int:
        """Return the bytes of the arrays."""
        return nbytes([value for value in (*vars(self).values(), *(self._diagonal_indices or ())) if isinstance(value, np.ndarray)])

    def add_to(self, K: csr_matrix, factor: float, free: FreeDofs | None = None) -> None:
        """Add `factor` M in place to a K of the system, or to one over the `free` degrees of freedom.

        Raises
        ------
        StvkError
            if K has another pattern.
        """
        indices, values = self._values()
        if free is None:
            self._system.pattern.refuse_other(K)
            K.data[indices] += number("factor", factor, "a finite number") * values
            return
        free.structure.refuse_other(K)
        part = self._part
        if part is None or part[0] is not free.value_indices:
            at = np.minimum(np.searchsorted(free.value_indices, indices), len(free.value_indices) - 1)
            there = free.value_indices[at] == indices
            self._part = part = free.value_indices, at[there], np.broadcast_to(values, indices.shape)[there]
        _, indices, values = part
        K.data[indices] += number("factor", factor, "a finite number") * values

    def _diagonals(self, a: NDArray[np.int32], b: NDArray[np.int32]) -> NDArray[np.intp]:
        """Return the indices (n, d) of the diagonals of blocks `(a, b)` in the values of K, cached for each pattern."""
        pattern, known = self._system.pattern, self._diagonal_indices
        if known is None or known[0] is not pattern:
            first, steps = pattern.block_indices(a, b), np.arange(self._d)
            self._diagonal_indices = known = pattern, first[:, None] + steps * (pattern.strides[a][:, None] + 1)
        return known[1]

    def _vector(self, name: str, value: Any) -> Array:
        """Return finite numbers (ndofs,) in double precision; in a divided body they may be infinite or NaN, as is the result."""
        checked = vector if self._body.mesh.space.comm.divided else finite_vector
        return checked(name, value, self.free.size).astype(np.float64, copy=False)

    def _refuse_bare(self) -> None:
        bare, mesh = (self.vertex <= 0) & self.free.any(axis=1), self._body.mesh
        if mesh.space.comm.any(bool(bare.any())):
            reason = "no element there has a density. Give StVK(..., density=...)"
            reason = next((term.without_mass for term in self._body.terms if term.without_mass), reason)
            raise MaterialError(
                f"{mesh.name_nodes(bare)} of {mesh.space.count // mesh.d}: can move, but have no mass, because {reason}, fix all "
                "their components, or leave them out of the mesh."
            )

    def __repr__(self) -> str:
        total, word = f"{self.total:g} {self._system.units.of('kg')}", "vertices" if self._word == "vertex" else "nodes"
        return f"Mass: {total} at {len(self.vertex)} {word}, {self.kind}"


class LumpedMass(Mass):
    """Mass with one number for each node."""

    kind = "lumped"

    def _weigh(self) -> None:
        super()._weigh()
        self._dofs = np.repeat(self.vertex, self._d)
        self._inverse = _inverse(self.vertex, self.free).ravel()

    @property
    def matrix(self) -> csr_matrix:
        return diags(self._dofs, format="csr")

    def multiply(self, v: Array, out: Array | None = None) -> Array:
        return np.multiply(self._dofs, self._vector("v", v), out=out)

    def solve(self, f: Array) -> Array:
        return np.asarray(self._inverse * self._vector("f", f))

    def _values(self) -> tuple[NDArray[np.intp], Array]:
        every = np.arange(len(self.vertex), dtype=np.int32)
        return self._diagonals(every, every), self.counted[:, None]


class ConsistentMass(Mass):
    """Mass with one number for each pair of nodes.

    Systems are solved by a fixed number of steps of Chebyshev's iteration (Wathen, Rees 2009).

    The eigenvalues of `D^-1 M`, with the diagonal D of M, lie between the least and the largest ones of the element matrices. This
    holds for the whole M and for its free part: see `bounds_of_elements`.
    """

    kind = "consistent"

    def __init__(self, system: HasPattern, body: Body, constrained: NDArray[Any]) -> None:
        bodies = (body, *body.beside)
        self._heavy = [np.flatnonzero(one.mass > 0) for one in bodies]  # only elements with mass couple their nodes
        bounds = [
            bounds_of_elements(one.mesh.p, one.mesh.t[:, heavy], one.mesh.element)
            for one, heavy in zip(bodies, self._heavy, strict=True)
        ]
        space = body.mesh.space
        self._bounds = space.comm.least(min(low for low, _ in bounds)), space.comm.most(max(high for _, high in bounds))
        super().__init__(system, body, constrained)

    def _weigh(self) -> None:
        super()._weigh()
        parts = []
        for body, heavy in zip((self._body, *self._body.beside), self._heavy, strict=True):
            mesh, t = body.mesh, body.mesh.t[:, heavy]
            parts.append(_scalar_matrix(t, Spread(mesh, mesh.element, t, body.mass[heavy]).matrices(), mesh.nv))
        self._scalar = reduce(add, parts)
        self._scalar.sort_indices()
        self._inverse = _inverse(self._body.mesh.space.share(self._scalar.diagonal()), self.free)

    @property
    def matrix(self) -> csr_matrix:
        M = self._system.pattern.matrix(np.zeros(self._system.pattern.nnz))
        self.add_to(M, 1.0)
        return M

    def multiply(self, v: Array, out: Array | None = None) -> Array:
        product = self._product(np.reshape(self._vector("v", v), self.free.shape)).ravel()
        if out is None:
            return product
        out[:] = product
        return out

    def _product(self, x: Array) -> Array:
        """Return `M x` (nv, d) for `x` (nv, d)."""
        return self._body.mesh.space.share(np.ascontiguousarray(self._scalar @ x))

    def solve(self, f: Array) -> Array:
        low, high = self._bounds
        centre, half, ratio = (high + low) / 2, (high - low) / 2, sqrt(high / low)
        r = np.array(self._vector("f", f)).reshape(self.free.shape)
        x, step, rho = np.zeros_like(r), self._inverse * r / centre, half / centre
        for _ in range(ceil(log(2 / np.finfo(float).eps) / log((ratio + 1) / (ratio - 1)))):
            x += step
            r -= self._product(step)
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


#: Kinds of mass by name, in the order of messages.
KINDS: dict[str, type[Mass]] = {"lumped": LumpedMass, "consistent": ConsistentMass}


def _scalar_matrix(t: NDArray[np.int32], values: Array, nv: int) -> csr_matrix:
    """Return the consistent mass matrix (nv, nv) of one component.

    `values` (n, n, nt) are the mass matrices of the elements `t` (n, nt).
    """
    if len(t) > 4:  # more nodes than a linear simplex: use half of the pairs
        a, b = np.triu_indices(len(t))
        values = values[a, b] * np.where(a == b, 1.0, 2.0)[:, None]
        row, column = t[a].ravel(), t[b].ravel()
    else:
        row, column = (np.broadcast_to(ids, values.shape).ravel() for ids in (t[:, None], t[None]))
    matrix = csr_matrix((values.ravel() / 2, (row, column)), shape=(nv, nv))
    matrix = csr_matrix(matrix + matrix.T)  # bitwise symmetric, which a plain summation is not
    matrix.sort_indices()
    return matrix


def bounds_of_elements(p: Array, t: NDArray[np.int32], element: Element) -> tuple[float, float]:
    """Return a lower and an upper bound of the eigenvalues of `D^-1 M` for elements `t` (n, nt) with diagonals D.

    For straight elements these are the eigenvalues of the reference element, 1/2 and (k + 2)/2 for a linear simplex. For other
    elements, let the Jacobian at the points lie between j and r j. Then the bounds are those of the reference element, divided by r
    and multiplied by r. Eigenvalues are computed element by element, from the largest r on, until the bounds of the remaining
    elements lie within the computed range.
    """
    if element.is_linear_simplex:
        return 0.5, (element.k + 2) / 2
    if not t.shape[1]:
        return np.inf, -np.inf
    points, weights = rule_of(element, "mass")
    products = np.einsum("qa,qb->qab", *[element.values(points)] * 2)
    low, high = _extreme(np.einsum("q,qab->ab", weights, products)[None])
    jacobians = sizes_at_points(p, t, element) / weights[:, None]
    ratios = jacobians.max(axis=0) / jacobians.min(axis=0)
    order, least, largest = np.argsort(-ratios), low, high
    for some in np.split(order, range(AT_ONCE, len(order), AT_ONCE)):
        r = float(ratios[some[0]])
        if r < STRAIGHT or (low / r >= least and high * r <= largest):
            return min(least, low / r), max(largest, high * r)
        one, other = _extreme(np.einsum("qn,qab->nab", jacobians[:, some] * weights[:, None], products, optimize=True))
        least, largest = min(least, one), max(largest, other)
    return least, largest


def _extreme(matrices: Array) -> tuple[float, float]:
    """Return the least and the largest eigenvalue of matrices (n, m, m), scaled by their diagonals, with a margin for round-off."""
    scale = 1 / np.sqrt(np.einsum("naa->na", matrices))
    values = np.linalg.eigvalsh(matrices * scale[:, :, None] * scale[:, None])
    return float(values[:, 0].min()) * (1 - ROUNDING), float(values[:, -1].max()) * (1 + ROUNDING)


def _inverse(diagonal: Array, is_free: NDArray[np.bool_]) -> Array:
    """Return the inverse (nv, d) of `diagonal` at free degrees of freedom, and 0 at constrained ones."""
    return np.where(is_free, 1 / np.where(is_free.any(axis=1), diagonal, 1.0)[:, None], 0.0)
