"""A body in precomputed coordinates: its energy is one quartic, and other energies are added from the mesh."""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...kernels.threads import locked
from ...system import System
from ...system.coordinates import Coordinates
from ...system.operator import refuse_overflow
from ...terms.loads.load import Moment, Time
from .basis import Lifts, masses_of
from .quartic import ProjectedTerms, ReducedQuartic


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
