"""The tangent over the free coordinates of a body on a basis, as a full matrix."""

from __future__ import annotations

from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from scipy.sparse import csr_matrix

from ..arguments import Array
from ..edges import Tensions
from ..linear import Unknowns
from ..linear.dense import DenseFactors, DenseSolver
from ..terms.load import Time
from .coordinates import Coordinates
from .free_tangent import SYMMETRIC
from .round_off import below, largest_error


class DenseTangent:
    """The tangent of a body in coordinates, with the methods that equations call on `FreeTangent`; its factors are dense."""

    solver: ClassVar[DenseSolver] = DenseSolver()
    multigrid: ClassVar[None] = None
    lasting: ClassVar[None] = None

    def __init__(self, body: Coordinates) -> None:
        self.body, self.free, self._free = body, body.free, slice(body.size)
        self.space, self.held = body.space.on(self._free), body.space.on(slice(body.size, None))
        self.symmetric = True
        self.exact: DenseFactors | None = None
        self._K = np.zeros((body.space.n,) * 2)
        lengths = np.sqrt(np.einsum("ij,ij->j", body.columns, body.columns))
        held = self.held.restrict(lengths)
        #: Forces on free coordinates over those on prescribed ones that the same forces on nodes make: their units differ.
        self._alike = float(self.space.restrict(lengths).mean() / held.mean()) if len(held) else 0.0

    def at(self, z: Array, t: Time, kept: Tensions, shifted: bool) -> Array:
        """(m, m) the exact Jacobian: `factorise` makes it positive definite where another one is asked for."""
        return self.body.jacobian(z, t)

    def factorise(self, K: Array, exact: bool = True) -> DenseFactors:
        """Factors of `K` (m, m) over the free coordinates; unless it is `exact`, with the absolute values of its eigenvalues."""
        self._K, free = K, K[self._free, self._free]
        if not self.body.system.conservative:
            self.symmetric = bool(np.abs(free - free.T).max() <= SYMMETRIC * np.abs(free).max())
        factors = DenseFactors(free, self.symmetric, turned=not exact)
        if exact:
            self.exact = factors
        return factors

    def force_of(self, w: Array) -> Array:
        """(n,) `K w` for a change `w` (m,) of prescribed coordinates, with the K that was factorised last."""
        force: Array = self._K[self._free] @ w
        return force

    def beside(self, z: Array, t: Time) -> tuple[csr_matrix, Unknowns]:
        """The Jacobian over the free coordinates as a sparse matrix, with all entries, and its unknowns."""
        n, K = self.space.n, self.body.jacobian(z, t)[self._free, self._free]
        indices, indptr = np.tile(np.arange(n), n), n * np.arange(n + 1)
        sparse = csr_matrix((K.ravel(), indices, indptr), shape=(n, n))
        return sparse, Unknowns(np.arange(n), np.zeros(n, dtype=np.int64), sparse.indptr, sparse.indices)

    def scale(self, loads: Array, left: Array) -> float:
        """Norm of the loads plus that of the reactions, which are in `left` (m,)."""
        return self.space.norm(self.space.restrict(loads)) + self._alike * self.held.norm(self.held.restrict(left))

    def round_off(self, z: Array, K: Array | None = None) -> Array:
        """(m,) `|K| |z|`, rounding errors of the internal force over eps, 0 where they say nothing. K is by default that at `z`."""
        K = self.body.linearize(z)[2] if K is None else K
        return below(self._largest_error, np.abs(K) @ np.abs(z))

    @cached_property
    def _largest_error(self) -> Array:
        """(m,) the bound of all nodes, times the columns [N m]."""
        bound: Array = largest_error(self.body.system) @ np.abs(self.body.columns)
        return bound

    def forget(self) -> None:
        """Do nothing: nothing is kept from one matrix to the next."""

    def take(self, solver: Any) -> None:
        """Do nothing: no other solver takes over."""
