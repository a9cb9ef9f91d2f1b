"""Who enters a motion in its ledger, step by step."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..kernels import motion as kernels
from ..statics.equilibrium import dot
from ..terms.load import Moment
from .ledger import Balance, Ledger, column_names
from .motion import Motion
from .state import State

Array = NDArray[Any]


class Books:
    """Energies, works and momenta of the states of a motion.

    Parameters
    ----------
    probes : vertices by name, whose mean displacement is entered.
    ledger : of a motion that is resumed, whose last row is that of the first state.
    """

    def __init__(self, motion: Motion, probes: Mapping[str, NDArray[Any]], ledger: Ledger | None = None) -> None:
        self.motion, self._probes = motion, probes
        self.ledger = Ledger(column_names(motion.system, probes)) if ledger is None else ledger
        mesh = motion.system.mesh
        self._several = len(motion.system.elastic_terms) > 1
        self._turning = {1: [], 2: [6], 3: [4, 5, 6]}[mesh.d]
        self._sums, self._Mv = np.zeros(8), np.zeros(motion.system.ndofs)
        resumed = self.ledger.steps > 0
        self.external = float(self.ledger["external_work"][-1]) if resumed else 0.0
        self.dissipated = float(self.ledger["dissipated_work"][-1]) if resumed else 0.0
        self._first = float(self.ledger["total_energy"][0]) if resumed else None
        self._watched = motion.moving or motion.damped or motion.system.driven
        self._t, self._u = 0.0, np.zeros(motion.system.ndofs)
        self._driving: Array = np.zeros(motion.system.ndofs)

    def begin(self, state: State) -> None:
        """The work is counted from this state on."""
        if self._watched:
            self._t = state.t
            np.copyto(self._u, state.u)
            self._driving = self.motion.system.driving_force(state.u, Moment(state.t, 1.0))

    def work(self, state: State) -> None:
        """Count the work of what drives the body, and what damping took, since the state before."""
        if not self._watched:
            return
        motion, before, since = self.motion, self._driving, self._t
        self.dissipated += motion.dissipated(self._u, state.u, state.t - since)
        change = state.u - self._u
        self.begin(state)
        self.external += (dot(before, change) + dot(self._driving, change)) / 2
        if motion.moving:
            held = motion.free.fixed
            self.external += dot(state.reaction[held], change[held])

    def enter(self, state: State, strain_energy: float) -> None:
        """A row for this state."""
        system, sums = self.motion.system, self._sums
        mesh = system.mesh
        shape = mesh.nv, mesh.d
        potential = self._sum(state)
        kinetic = float(sums[0]) / 2
        balance = Balance.of(kinetic, strain_energy, potential, self.external, self.dissipated, self._first)
        if self._first is None:
            self._first = balance.total_energy
        row = [state.t, kinetic, strain_energy]
        if self._several:
            row += system.elastic_energies(state.u)
        row += [potential, self.external, self.dissipated, *balance, *sums[1 : 1 + mesh.d], *sums[self._turning]]
        for vertices in self._probes.values():
            row += list(state.u.reshape(shape)[vertices].mean(axis=0))
        self.ledger.append(row)

    def _sum(self, state: State) -> float:
        """Twice the kinetic energy and the momenta, to where they are kept; the potential of loads that are given by constants [J]."""
        motion, sums = self.motion, self._sums
        mesh = motion.system.mesh
        u, v, Mv = (x.reshape(mesh.nv, mesh.d) for x in (state.u, state.v, self._Mv))
        if motion.mass.kind == "lumped" and motion.constant_loads is not None:
            kernels.lumped_momenta(mesh.p, u, v, motion.mass.vertex, motion.constant_loads.reshape(u.shape), sums)
            return -float(sums[7])
        motion.mass.multiply(state.v, out=self._Mv)
        kernels.momenta(mesh.p, u, v, Mv, sums)
        return motion.system.steady_potential(state.u)
