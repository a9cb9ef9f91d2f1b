"""Energy of a reduced body as one quartic: its coefficients, precomputed in blocks of elements, and W, F and K from them."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from math import factorial

import numpy as np
from scipy.linalg.blas import dsyrk

from ...arguments import Array
from ...edges import ALL
from ...edges.bound_term import BoundTerm
from ...kernels import reduced as reduced_kernels
from ...mesh import ElementMesh
from ...mesh.displacements import by_vertex
from ...system import Pattern, System, TangentOperator
from ...system.operator import at_all_times, refuse_overflow

#: Bytes of the rows of strains that are made in one block.
BLOCK = 32_000_000


def coefficients(n: int) -> int:
    """Return the number of coefficients of a homogeneous quartic of n variables."""
    return n * (n + 1) * (n + 2) * (n + 3) // 24


def bytes_needed(size: int) -> int:
    """Return the bytes that the quartic of a body with `size` unknowns, lifts included, needs while it is made. These are `r^4/24 +
    r^4/4` numbers of 8 bytes, and a block of strains with its inputs.
    """
    pairs = (size + 1) * (size + 2) // 2
    return 8 * (coefficients(size + 1) + pairs**2) + 2 * BLOCK


def rows_of(term: BoundTerm, body: System) -> int:
    """Return the approximate number of rows of strains of a term: of all points of all elements."""
    if not term.has_strain_products:
        return 0
    return len(body.rule.rule.weights) * body.mesh.nt * body.mesh.k * (body.mesh.k + 1) // 2


def seconds_needed(size: int, rows: int) -> float:
    """Return the approximate time to add up the products of so many rows, from the measured time of a few."""
    pairs, some = (size + 1) * (size + 2) // 2, 64
    few = np.ones((pairs, some), order="F")
    dsyrk(1.0, few, lower=1)
    begin = time.perf_counter()
    dsyrk(1.0, few, lower=1)
    return 2 * (time.perf_counter() - begin) * rows / some


class ReducedQuartic:
    """Quartic `W = sum T_abcd x_a x_b x_c x_d` of `x = (1, z)` and the amounts `z` (n - 1,), by its distinct coefficients T.

    See `kernels.reduced` for their order. All results at one state come from one pass over T.
    """

    def __init__(self, n: int, T: Array) -> None:
        pairs = n * (n + 1) // 2
        self.n, self.T = n, T
        self._work = np.empty(pairs), np.empty((n, pairs)), np.empty(pairs)

    def linearize(self, x: Array) -> tuple[float, Array, Array]:
        """Return W at `x` (n,), its gradient (n,) and its second derivatives (n, n), including those by `x_0`."""
        G, H = np.empty(self.n), np.empty((self.n, self.n))
        return reduced_kernels.quartic(self.T, x, *self._work, G, H), G, H

    def along(self, x: Array, y: Array) -> Array:
        """Return the coefficients `c` (5,) of the energy at `x + s y`, both (n,)."""
        W, G, H = self.linearize(x)
        last, g, _ = self.linearize(y)
        return np.array([W, G @ y, y @ H @ y / 2, g @ x, last])


def quartic_of(
    body: System, terms: Sequence[BoundTerm], fields: Array, tick: Callable[[int], None] = lambda done: None
) -> ReducedQuartic:
    """Return the energy of bound terms that are `quartic` for displacements `fields @ z`, `fields` (ndofs, R)."""
    n, pairs = fields.shape[1] + 1, (fields.shape[1] + 1) * (fields.shape[1] + 2) // 2
    nodal = np.ascontiguousarray(fields).reshape(body.mesh.nv, body.mesh.d, -1)
    C, T = np.zeros((pairs, pairs), order="F"), np.empty(coefficients(n))
    for term in terms:
        if term.has_strain_products:
            for rows in term.strain_products(nodal, BLOCK // (8 * pairs)):
                C = dsyrk(1.0, rows.T, beta=1.0, c=C, lower=1, overwrite_c=1)
                tick(len(rows))
    reduced_kernels.distinct_coefficients(C, T)
    del C
    for term in terms:
        if not term.has_strain_products and not term.constant_tangent:
            _add_by_tangents(T, term, fields, body)
    if terms:
        pair_terms = [term.with_blocks(body.mesh.nv, body.mesh.d, body.dtype) for term in terms]
        operator = TangentOperator(body.mesh, at_all_times(pair_terms), np.zeros(body.ndofs), body.dtype)
        K = fields.T @ np.array([operator @ field for field in np.ascontiguousarray(fields.T)]).T
        _set_quadratic(T, n, (K + K.T) / 2)
    return ReducedQuartic(n, T)


def _row(d: int, c: int) -> int:
    """Return the index in T at which the row of `d`, `c <= d` begins."""
    return d * (d + 1) * (d + 2) * (d + 3) // 24 + c * (c + 1) * (c + 2) // 6


def _set_quadratic(T: Array, n: int, K: Array) -> None:
    """Set the quadratic part to `1/2 z' K z`."""
    for d in range(1, n):
        for c in range(1, d + 1):
            T[_row(d, c)] = K[c - 1, d - 1] / (2 if c == d else 1)


def _add_by_tangents(T: Array, term: BoundTerm, fields: Array, body: System) -> None:
    """Add the cubic and quartic coefficients of a term with only W, F and K.

    K is quadratic in z, so that its differences along fields and pairs of fields are exact; no step is small.
    """
    part, R = ProjectedTerms(body.mesh, [term], fields), fields.shape[1]
    h = np.linalg.norm(np.ptp(body.mesh.p, axis=1)) / (2 * np.abs(fields).max(axis=0))
    unit = np.diag(h)
    rest, before = part.linearize(np.zeros(R))[2], []
    for d in range(R):
        plus, minus = (part.linearize(sign * unit[d])[2] for sign in (1, -1))
        before.append(plus)
        first = (plus - minus) / (2 * h[d])
        for c in range(d + 1):
            if c == d:
                second = (plus + minus - 2 * rest) / h[d] ** 2
            else:
                second = (part.linearize(unit[c] + unit[d])[2] - plus - before[c] + rest) / (h[c] * h[d])
            at = _row(d + 1, c + 1)
            for b in range(c + 1):
                begin = at + (b + 1) * (b + 2) // 2
                T[begin] += first[b, c] / _orders(b, c, d)
                for a in range(b + 1):
                    T[begin + 1 + a] += second[a, b] / _orders(a, b, c, d)


def _orders(*indices: int) -> int:
    """Return the product of the factorials of the multiplicities of the indices."""
    return int(np.prod([factorial(indices.count(index)) for index in set(indices)]))


class ProjectedTerms:
    """Part of bound terms in W, F and K over fields of displacements (ndofs, R), computed on their mesh and at its cost."""

    def __init__(self, mesh: ElementMesh, terms: Sequence[BoundTerm], fields: Array) -> None:
        self._mesh, self._fields = mesh, fields
        self._terms = [term.with_blocks(mesh.nv, mesh.d, np.float64) for term in terms]
        self._pattern = Pattern(mesh.nv, mesh.d, [term.nodes_paired for term in terms])
        self._rows = [term.rows(self._pattern) for term in self._terms]
        self._K = self._pattern.matrix(np.zeros(self._pattern.nnz))

    def linearize(self, z: Array) -> tuple[float, Array, Array]:
        """Return W, F (R,) and K (R, R) at amounts z (R,)."""
        x, energy = by_vertex(self._mesh, self._fields @ z), 0.0
        force, data = np.zeros(x.shape), self._K.data
        data[:] = 0
        for term, rows in zip(self._terms, self._rows, strict=True):
            filled = term.fill(x, rows, data, True, force, ALL)
            refuse_overflow(filled.total, "K", x)
            energy += filled.energy
        return energy, self._fields.T @ force.ravel(), self._fields.T @ (self._K @ self._fields)
