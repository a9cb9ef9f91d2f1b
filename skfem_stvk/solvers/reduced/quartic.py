"""A body in precomputed coordinates: the coefficients of its quartic energy, from blocks of elements, and W, F and K from them."""

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
from ...kernels.threads import locked
from ...mesh import ElementMesh
from ...mesh.displacements import by_vertex
from ...system import Pattern, System, TangentOperator
from ...system.coordinates import Coordinates
from ...system.operator import at_all_times, refuse_overflow
from ...terms.loads.load import Moment, Time
from .basis import Lifts, masses_of

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


class PrecomputedCoordinates(Coordinates):
    """Coordinates `z = (q, s)` of a `ReducedSystem`, with its precomputed `quartic`."""

    def __init__(self, body: System, columns: Array, size: int, quartic: ReducedQuartic) -> None:
        super().__init__(body, columns, size, masses_of(body))
        self._lifts, self._quartic = Lifts(body, columns[:, size:]), quartic
        others = [term for term in body.bound_terms if not term.quartic]
        self._others = ProjectedTerms(body.mesh, others, columns) if others else None
        self._steady = [load for load in body.bound_loads if load.dead and load.steady]
        self._changing = [load for load in body.bound_loads if not (load.dead and load.steady)]
        self._steady_forces: dict[str, Array] = {}

    @property
    def coefficients(self) -> Array:
        """Distinct coefficients of the quartic."""
        return self._quartic.T

    @property
    def quartic(self) -> bool:
        return self._others is None

    def prescribed_values(self, t: Time) -> Array:
        return self._lifts.amounts(Moment.checked(t)).copy()

    def response(self, z: Array) -> tuple[float, Array, Array]:
        x = np.empty(self._quartic.n)
        x[0], x[1:] = 1.0, z
        W, G, H = self._quartic.linearize(x)
        F, K = G[1:], H[1:, 1:]
        if self._others is not None:
            more, f, k = self._others.linearize(z)
            W, F, K = W + more, F + f, K + k
            refuse_overflow(F, "F", z)
        refuse_overflow(W, "W", z)  # W = G . x / 4 of a quartic is finite only if G is
        F.flags.writeable = K.flags.writeable = False
        return W, F, K

    @locked
    def energy_along(self, z: Array, v: Array) -> Array:
        c = self._quartic.along(np.concatenate([[1.0], z]), np.concatenate([[0.0], v]))
        refuse_overflow(c, "W along a line", z)
        return c

    def external_force(self, z: Array, t: Time) -> Array:
        """Return the loads (m,) on the coordinates; constant dead loads are precomputed, at no cost of the mesh."""
        force = self._dead_force(t)
        if self._changing:
            u, moment = (self.columns @ z).reshape(-1, self.mesh.d), Moment.checked(t)
            full = np.zeros(u.shape)
            for load in self._changing:
                load.add_force(u, moment, full)
            refuse_overflow(full, "The external force", u)
            force = force + self.columns.T @ full.ravel()
        return force

    def load_stiffness(self, z: Array, t: Time) -> Array | None:
        if all(load.dead for load in self._changing):
            return None
        u = self.columns @ z
        full = self.system.jacobian(u, t) - self.system.tangent(u, t=t)
        return np.asarray(self.columns.T @ (full @ self.columns))

    def potential(self, z: Array, t: Time) -> float:
        if self._others is not None or self._changing:
            return super().potential(z, t)
        return self.linearize(z)[0] - float(self._dead_force(t) @ z)

    def _dead_force(self, t: Time) -> Array:
        """Return the projected force (m,) of constant dead loads."""
        moment = Moment.checked(t)
        if moment.mass not in self._steady_forces:
            force, x = np.zeros(self.mesh.p.T.shape), np.zeros(self.mesh.p.T.shape)
            for load in self._steady:
                load.add_force(x, moment._replace(factor=1.0), force)
            self._steady_forces[moment.mass] = self.columns.T @ force.ravel()
        return moment.factor * self._steady_forces[moment.mass]

    def __repr__(self) -> str:
        lifts = f", {len(self.free.fixed)} lifts" if len(self.free.fixed) else ""
        cost = "" if self.quartic else "; a term is no quartic: each evaluation costs as much as on the mesh"
        return f"ReducedSystem: {self.size} unknowns{lifts}, of {self.system!r}{cost}"
