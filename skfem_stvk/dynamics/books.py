"""Who enters a motion in its ledger, step by step."""

from __future__ import annotations

import numpy as np

from ..arguments import Array
from ..kernels import motion as kernels
from ..nonlinear.problem import dot
from .forces import driven, driving_force, steady_potential
from .ledger import INSIDE_OUT, Balance, Ledger, column_names
from .motion import Motion
from .places import Places
from .reactions import ground_forces, last_step
from .state import State


class Books:
    """Energies, works and momenta of the states of a motion.

    Parameters
    ----------
    places : that are followed.
    ledger : of a motion that is resumed, whose last row is that of the first state.
    dt : of the first step [s], or about that.
    """

    def __init__(self, motion: Motion, places: Places, ledger: Ledger | None = None, dt: float = 1e-4) -> None:
        self.motion, self._places, self._dt = motion, places, dt
        self.ledger = Ledger(column_names(motion.system, *places)) if ledger is None else ledger
        mesh = motion.system.mesh
        self._several = len(motion.system.elastic_terms) > 1
        self._turning = {1: slice(0), 2: slice(6, 7), 3: slice(4, 7)}[mesh.d]
        self._sums, self._Mv = np.zeros(8), np.zeros(motion.system.ndofs)
        self.external = self.dissipated = 0.0
        self._first = float(self.ledger["total_energy"][0]) if self.ledger.steps else None
        self._inside_out = self.ledger.names.index(INSIDE_OUT)
        self._watched = motion.moving or motion.damped or driven(motion.system)
        self._t, self._u = 0.0, np.zeros(motion.system.ndofs)
        self._driving: Array = np.zeros(motion.system.ndofs)

    def begin(self, state: State) -> None:
        """The work is counted from this state on, which is that of the last row, if there is one."""
        if self.ledger.steps:
            self.external, self.dissipated = (float(self.ledger[name][-1]) for name in ("external_work", "dissipated_work"))
        self._begin(state)

    def _begin(self, state: State) -> None:
        if self._watched:
            self._t = state.t
            np.copyto(self._u, state.u)
            self._driving = driving_force(self.motion.system, state.u, state.t)

    def work(self, state: State) -> None:
        """Count the work of what drives the body, and what damping took, since the state before."""
        if not self._watched:
            return
        motion, before, since = self.motion, self._driving, self._t
        self.dissipated += motion.dissipated(self._u, state.u, state.t - since)
        change = state.u - self._u
        self._begin(state)
        self.external += (dot(before, change) + dot(self._driving, change)) / 2
        if motion.moving:
            held = motion.free.fixed
            self.external += dot(state.reaction[held], change[held])

    def enter(self, state: State, strain_energy: float) -> None:
        """A row for this state, with as many elements inside out as in the row before: `Inversions` counts them."""
        system, mesh = self.motion.system, self.motion.system.mesh
        potential = self._sum(state)
        sums = self._sums.tolist()
        kinetic = sums[0] / 2
        balance = Balance.of(kinetic, strain_energy, potential, self.external, self.dissipated, self._first)
        if self._first is None:
            self._first = balance.total_energy
        row = [state.t, kinetic, strain_energy]
        if self._several:
            row += system.elastic_energies(state.u)
        inside_out = float(self.ledger.rows(self.ledger.steps - 1)[0, self._inside_out]) if self.ledger.steps else 0.0
        row += [potential, self.external, self.dissipated, *balance, inside_out, *sums[1 : 1 + mesh.d], *sums[self._turning]]
        for vertices in self._places.probes.values():
            row += list(state.u.reshape(-1, mesh.d)[vertices].mean(axis=0))
        if self._places.reactions:
            since = last_step([*self.ledger["time"][-2:].tolist(), state.t], self._dt)
            forces = ground_forces(self.motion, state.u, state.v, state.t, since).reshape(-1, mesh.d)
            for vertices in self._places.reactions.values():
                row += list(forces[vertices].sum(axis=0))
        self.ledger.append(row)

    def _sum(self, state: State) -> float:
        """Twice the kinetic energy and the momenta, to where they are kept; the potential of loads that are given by constants [J]."""
        motion, sums = self.motion, self._sums
        mesh = motion.system.mesh
        if motion.mass.kind == "lumped" and motion.constant_loads is not None:
            kernels.lumped_momenta(mesh.p, state.u, state.v, motion.mass.vertex, motion.constant_loads, sums)
            return -float(sums[7])
        u, v, Mv = (x.reshape(mesh.nv, mesh.d) for x in (state.u, state.v, self._Mv))
        motion.mass.multiply(state.v, out=self._Mv)
        kernels.momenta(mesh.p, u, v, Mv, sums)
        return steady_potential(motion.system, state.u)
