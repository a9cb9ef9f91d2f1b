"""Equation of motion of a system: masses, damping, loads and reactions."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from math import isnan
from typing import Any

import numpy as np

from ...arguments import Array
from ...kernels import motion_updates as kernels
from ...mesh.displacements import by_vertex
from ...space import Space
from ...system import System
from ...system.coordinates import CoordinateMass, Coordinates
from ...terms import BoundLoad
from ...terms.loads.load import APART, Moment, StepStart
from .at_rest import AtRest
from .damping import Damping, damping_factors
from .forces import add_damping_force, add_secant_damping
from .inputs import Inputs
from .record import MotionState

#: Smallest length of a step for differences, as a part of the previous step.
SHORT = 0.3
#: Part of a time step over which prescribed displacements are differenced.
DIFFERENCE = 1e-2


class Motion:
    """Equation `M v' + D v + F(u) = h(u, t)` over the free degrees of freedom, `D = alpha M + beta K(0) + tau K_GN(u)`.

    `K_GN = 2 J'LJ` is K without tensions. `moving`: whether any constrained degrees of freedom move.

    States `u` of the body are vectors of the space `states`, and `states.expand(u)` returns displacements (ndofs,). For a `System`,
    states are displacements, so vectors are (ndofs,). For a body on a basis, they are coordinates (m,). If its loads are constant
    and dead, a step then costs as much as its m x m matrices, for any mesh. `system` is the body with all its displacements.
    `inputs` are displacements and forces that a `Simulation` sets from step to step; None if the motion has none. `step` is the
    beginning of the present step, which the terms with history need at each of its times.
    """

    def __init__(self, body: System | Coordinates, mass: str | None, damping: Damping | None, inputs: Inputs | None = None) -> None:
        self.body, self._damping, self.inputs = body if inputs is None else inputs.moving(body), damping, inputs
        body = self.body
        self.system = body if isinstance(body, System) else body.system
        self.mass: Any = body.mass("lumped" if mass is None else mass)
        self.alpha, self.beta, self.tau = damping_factors(damping)
        self.free: Any = body.free_dofs(body.supports.held) if isinstance(body, System) else body.free
        self.moving = self.system.space.comm.any(self.system.supports.prescribed.size > 0)
        self._has_several_terms = len(body.elastic_names) > 1
        self._force, self._Mv, self._pushed = (np.zeros(self.states.n) for _ in range(3))
        self.begin_step(self.body.first_history())

    def begin_step(self, history: tuple[Array, ...], predicted: Array | None = None) -> None:
        """Begin a step with this history of the terms. Friction is linear at displacements `predicted` (nv, d), if given."""
        self.step = StepStart(history, in_time=True, predicted=predicted) if history else None

    @property
    def states(self) -> Space:
        """Space of states and their rates."""
        return self.body.space

    @property
    def pushed(self) -> bool:
        """Whether forces are inputs."""
        return self.inputs is not None and self.inputs.pushes

    def remove_elements(self, elements: Any) -> None:
        """Replace the body by one without these elements."""
        self.replace_system(self.system.without(elements))

    def replace_system(self, system: System) -> None:
        """Replace the body by the same one with more or fewer removed elements."""
        self.body = self.system = system
        self.mass, self.free = self.body.mass(self.mass.kind), self.free.of(self.body)
        for name in ("at_rest", "constant_loads"):
            self.__dict__.pop(name, None)

    def energy(self, u: Array, t: float) -> float:
        """Return the strain energy [J] of the terms that have one."""
        return sum((energy for energy in self.body.elastic_energies(u, self.moment(t)) if not isnan(energy)), 0.0)

    def energy_and_force(self, u: Array, moment: Moment, out: Array) -> float:
        """Return the strain energy of `energy` [J], and write the internal force [N] to `out`."""
        if not self.body.without_energy:
            return self.body.energy_and_force(u, out, moment)[0]
        np.copyto(out, self.body.internal_force(u, moment))
        return self.energy(u, moment.time)

    def term_energies(self, u: Array, t: float) -> list[float]:
        """Return the strain energies [J] of the elastic terms if there are several; NaN for a term without an energy."""
        return self.body.elastic_energies(u, self.moment(t)) if self._has_several_terms else []

    @property
    def driven(self) -> bool:
        """Whether the body's energy is not conserved: a load changes with time or has no potential, or a term has no energy."""
        return self.pushed or bool(self.system.without_energy) or not all(map(_keeps_energy, self.system.bound_loads))

    def driving_force(self, u: Array, t: float) -> Array:
        """Return the force [N] of inputs, and of loads that change with time or have no potential."""
        if self.constant_loads is not None and not self.driven:
            return np.zeros(self.states.n)
        system, moment = self.system, self.moment(t)
        x, force = by_vertex(system.mesh, self.states.expand(u)), np.zeros(system.mesh.p.T.shape)
        for load in system.bound_loads:
            if not _keeps_energy(load):
                load.add_force(x, moment, force)
        driving = self.states.restrict(self.system.space.share(force).ravel())
        if self.inputs is not None and self.inputs.pushes:
            self.inputs.add_forces(t, driving)
        return driving

    def force_without_energy(self, u: Array, t: float) -> Array:
        """Return the force [N] of the terms without energy on the body."""
        internal = np.zeros(self.system.mesh.p.T.shape)
        for term in self.system.terms_at(self.moment(t)):
            if not term.has_energy:
                term.energy_and_force(by_vertex(self.system.mesh, self.states.expand(u)), internal)
        return -self.states.restrict(self.system.space.share(internal).ravel())

    def add_up(self, state: MotionState, sums: Array) -> float:
        """Return the potential [J] of steady loads. Write twice the kinetic energy, linear and angular momentum to `sums` (8,)."""
        u, v, mesh, loads = state.u, state.v, self.system.mesh, self.constant_loads
        if isinstance(self.mass, CoordinateMass):
            self.mass.momenta(u, v, sums)
            if loads is not None:
                return -self.states.dot(loads, u)
        elif self.mass.kind == "lumped" and loads is not None:
            kernels.lumped_momenta(mesh.p, u, v, self.mass.counted, self.states.counted(loads), sums)
            sums[:] = self.states.comm.total(sums)
            return -float(sums[7])
        else:
            self.mass.multiply(v, out=self._Mv)
            shape = mesh.nv, mesh.d
            kernels.momenta(mesh.p, u.reshape(shape), v.reshape(shape), self.states.counted(self._Mv).reshape(shape), sums)
            sums[:] = self.states.comm.total(sums)
        x, moment = by_vertex(mesh, self.states.expand(u)), self.moment(state.t)
        potentials = (load.potential(x, moment) for load in self.system.bound_loads if _keeps_energy(load))
        return self.states.comm.total(sum(potentials, 0.0))

    @cached_property
    def at_rest(self) -> Any:
        """Tangent stiffness K(0) of the body at rest, without contacts, for products `K @ v`."""
        return self.body.linear_operator(np.zeros(self.states.n), t=APART)

    @property
    def damped(self) -> bool:
        """Whether there is any damping."""
        return bool(self.alpha or self.beta or self.tau)

    def moment(self, t: float) -> Moment:
        """Return the time `t` [s] of the present step with load factor 1, and the kind of masses on which gravity acts."""
        return Moment(t, 1.0, self.mass.kind, self.step)

    def constrained_displacements(self, t: float) -> Array:
        """Return the displacements of the constrained degrees of freedom, or the prescribed coordinates [m]."""
        values = self._constants.copy() if self.system.supports.steady else self._prescribed_values(t)
        if self.inputs is not None:
            values[self.inputs.moved] = self.inputs.displacements(t)
        return values

    def _prescribed_values(self, t: float) -> Array:
        body, moment = self.body, Moment(t, 1.0)
        return body.supports.values(moment) if isinstance(body, System) else body.prescribed_values(moment)

    @cached_property
    def _constants(self) -> Array:
        """Prescribed displacements or coordinates if they are constants, without inputs."""
        return self._prescribed_values(0.0)

    def constrained_velocities(self, t: float, dt: float) -> Array:
        """Return the velocities of the constrained degrees of freedom [m/s], by differences between `t` and `t + dt`.

        At the start of a run `dt` is the first step. At the end of a step it is minus that step, so that a kink there belongs to
        the next step. Inputs move evenly over a step.
        """
        if not self.moving:
            return np.zeros(len(self.free.fixed))
        times = t, t + DIFFERENCE * dt, t + 2 * DIFFERENCE * dt
        here, near, far = map(self.constrained_displacements, times)
        a, b = times[1] - t, times[2] - t  # with the rounding of times
        velocities: Array = ((near - here) * (b / a) - (far - here) * (a / b)) / (b - a)
        if self.inputs is not None:
            moved = self.inputs.moved
            velocities[moved] = (self.inputs.displacements(t + dt) - here[moved]) / dt
        return velocities

    @cached_property
    def constant_loads(self) -> Array | None:
        """Loads [N] if they depend neither on time nor on displacements, otherwise None."""
        if not all(load.steady and load.dead for load in self.system.bound_loads):
            return None
        loads = self.body.external_force(np.zeros(self.states.n), self.moment(0.0))
        loads.flags.writeable = False
        return loads

    def loads(self, u: Array, t: float) -> Array:
        """Return the external forces [N]; the same array every time if they are constant, or if some are inputs."""
        loads = self.body.external_force(u, self.moment(t)) if self.constant_loads is None else self.constant_loads
        if self.inputs is None or not self.inputs.pushes:
            return loads
        np.copyto(self._pushed, loads)
        self.inputs.add_forces(t, self._pushed)
        return self._pushed

    def add_damping(self, u: Array, v: Array, out: Array) -> None:
        """Add `D v` [N] at displacements `u` to `out`."""
        self.add_linear_damping(v, out)
        if self.tau:
            self._force[:] = 0
            add_damping_force(self.system, u, v, self._force)
            out += self.tau * self._force

    def add_linear_damping(self, v: Array, out: Array) -> None:
        """Add `(alpha M + beta K(0)) v` [N] to `out`."""
        if self.alpha:
            out += self.alpha * self.mass.multiply(v)
        if self.beta:
            out += self.beta * (self.at_rest @ v)

    def force(self, u: Array, v: Array, t: float, friction: float = 1.0) -> Array:
        """Return the net force `h - D v - F` [N] on the body, with a factor of friction."""
        moment = self.moment(t).assuming(None, friction)
        force = self.loads(u, t) - self.body.internal_force(u, moment)
        damping = np.zeros_like(force)
        self.add_damping(u, v, damping)
        return force - damping

    def accelerations(self, u: Array, v: Array, t: float) -> Array:
        """Return `M^-1 (h - D v - F)` [m/s^2], 0 at constrained degrees of freedom."""
        return self.mass.solve(self.force(u, v, t))

    @property
    def force_rows(self) -> int:
        """Number of the `forces` of a state: one for each contact, and one for foundations if there are any."""
        if self.body is not self.system:
            return 0
        return len(self.system.contacts) + bool(self.system.foundations)

    def store_forces(self, state: MotionState) -> None:
        """Store the forces of contacts and foundations on the body at the state in `state.forces`."""
        mesh, contacts = self.system.mesh, self.system.contacts_at(self.moment(state.t))
        for contact, force in zip(contacts, state.forces, strict=False):
            force[:] = 0
            contact.energy_and_force(by_vertex(mesh, state.u), force.reshape(-1, mesh.d))
            force *= -1
        if len(state.forces) > len(contacts):
            state.forces[-1] = self.system.foundation_force(state.u + self.beta * state.v)

    def ground_forces(self, state: MotionState, times: Sequence[float], dt: float, mean: bool) -> Array:
        """Return the forces (ndofs,) [N] of supports and foundations on the body.

            M a + D v + F(u) - h(u, t)    of supports, at constrained degrees of freedom
            -K_f (u + beta v)             of foundations, whose stiffness counts in Rayleigh's damping too

        If supports move or forces are a `mean` over the step, they are those of the equation of the last step. Otherwise, and after
        a short last step, they are those at the state: accelerations `a` are those of the equation of motion, for moving supports
        those of `constrained_accelerations`. `times` are those of the last three states, and `dt` is the length of a first step
        [s].

        For a body on a basis, the forces are those at the state. Residual forces at free degrees of freedom are transferred to the
        supports by K at rest.
        """
        whole = self if self.body is self.system else self._full_motion
        fixed, mass, since = whole.free.fixed, whole.mass, last_step(times, dt)
        if whole is self and (mean or self.moving) and since in times[-2:-1]:
            forces = state.forces[len(self.system.contacts) :].sum(axis=0)
            forces[fixed] += state.reaction[fixed]
            return forces
        u, v, t = self.states.expand(state.u), self.states.expand(state.v), state.t
        moving = whole.force(u, v, t)
        a = np.zeros_like(moving)
        if self.moving:
            a[fixed] = constrained_accelerations(whole, t, since)
        if mass.kind == "consistent":  # constrained and free degrees of freedom are coupled by M
            a += mass.solve(moving - mass.multiply(a))
        forces = self.system.foundation_force(u + self.beta * v)
        forces[fixed] += (mass.multiply(a) - moving)[fixed]
        if isinstance(self.body, Coordinates):
            basis = self.body.columns[:, : self.body.size]
            residual = mass.multiply(basis @ (basis.T @ moving)) - moving  # `M a + D v + F - h` with the accelerations of the basis
            forces[fixed] -= (whole.at_rest @ self._rest.solve(residual))[fixed]
        return forces

    @cached_property
    def _full_motion(self) -> Motion:
        """Motion of the body with all its displacements, if this one is on a basis."""
        return Motion(self.system, self.mass.kind, self._damping)

    @cached_property
    def _rest(self) -> AtRest:
        return AtRest(self.system)

    def dissipated(self, u0: Array, u1: Array, dt: float) -> float:
        """Return the energy [J] that damping dissipates between `u0` and `u1`: `dt v' D v` at the mean velocity."""
        if not self.damped:
            return 0.0
        v = (u1 - u0) / dt
        force = np.zeros_like(v)
        self.add_linear_damping(v, force)
        lost = dt * self.states.dot(v, force)
        if self.tau:  # add_secant_damping also returns dzeta' L dzeta / 4
            self._force[:] = 0
            lost += 2 * self.tau / dt * add_secant_damping(self.system, u0, u1, 0.5, self._force)
        return lost


def _keeps_energy(load: BoundLoad) -> bool:
    return load.steady and load.has_potential


def last_step(times: Sequence[float], dt: float) -> float:
    """Return the beginning of the last of the steps that led to `times` [s].

    If the end of the run cut the last step short, return the beginning of the previous step. Differences over the short step would
    only be round-off. Before the first step, return the end of a first step of length `dt`.
    """
    if len(times) == 1:
        return times[0] + dt
    short = len(times) > 2 and times[-1] - times[-2] < SHORT * (times[-2] - times[-3])
    return times[-3] if short else times[-2]


def constrained_accelerations(motion: Motion, t: float, since: float) -> Array:
    """Return the accelerations of the constrained degrees of freedom at `t` [m/s^2].

    They are differences over the step that began at `since` [s]. The functions of the supports are evaluated within the run only.
    """
    h = (t - since) / 3
    here, one, two, three = (motion.constrained_displacements(t - i * h) for i in range(4))
    accelerations: Array = (2 * here - 5 * one + 4 * two - three) / h**2
    return accelerations
