"""The equation of motion of a system: masses, damping, loads and reactions."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from math import isnan
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..kernels import motion as kernels
from ..linear.space import Space
from ..nonlinear.stopwatch import Stopwatch
from ..system import System, TangentOperator
from ..system.protocol import ReducedLike
from ..terms.load import Moment
from .damping import Damping, damping_factors
from .forces import add_damping_force, add_secant_damping, constant_loads, driven, driving_force, steady_potential
from .record import MotionState

#: A step that is shorter than this part of the one before is too short for differences.
SHORT = 0.3
#: Part of a time step over which prescribed displacements are differenced to begin with.
DIFFERENCE = 1e-3


class Motion:
    """`M v' + D v + F(u) = h(u, t)` over the free degrees of freedom, `D = alpha M + beta K(0) + tau K_GN(u)`.

    `K_GN = 2 J'LJ` is K without tensions; `moving`: whether any of the held degrees of freedom move.

    States and velocities are displacements (ndofs,) and their rates here. Those of a motion on a basis are coordinates: what the
    loop over the steps and its ledger ask for is asked of the motion, and `states.expand` of them is written and returned.
    """

    #: Whether the ledger tells the energies of several elastic terms apart.
    by_term: ClassVar[bool] = True

    def __init__(self, system: System, mass: str, damping: Damping | None) -> None:
        self.system, self.mass = system, system.mass(mass)
        self.alpha, self.beta, self.tau = damping_factors(damping)
        self.free = system.free_dofs(system.supports.held)
        self.moving = system.supports.prescribed.size > 0
        self._several = len(system.elastic_terms) > 1
        self._force, self._Mv = np.zeros(system.ndofs), np.zeros(system.ndofs)

    @property
    def states(self) -> Space:
        """The space of states and their rates; those on the mesh are `states.expand(x)`."""
        return self.system.space

    @property
    def on_mesh(self) -> Motion:
        """The motion whose states are displacements."""
        return self

    @property
    def described(self) -> str:
        """The body in words that fit on one line, for headers."""
        return repr(self.system)

    @property
    def basis(self) -> list[float]:
        """A few numbers by which files know the basis again, empty if states are displacements."""
        return []

    def refuse_other(self, integrator: Any, removing: bool) -> None:
        """Refuse an integrator that does not take this motion, or that elements are taken out; this one takes all."""

    def step_problem(self, integrator: Any, watch: Stopwatch) -> Any:
        """The equation of an implicit step if the motion has its own; None if it is that of `StepProblem`."""
        return None

    def take_out(self, elements: Any) -> None:
        """Go on with the body without these elements."""
        self.system = self.system.without(elements)
        self.mass, self.free = self.system.mass(self.mass.kind), self.free.of(self.system)
        for name in ("at_rest", "constant_loads"):
            self.__dict__.pop(name, None)

    def state(self, x: Array, t: float) -> Array:
        """The state of displacements (ndofs,), or the rate of their velocities; what is held has to be set to what it is."""
        return x

    def energy(self, u: Array) -> float:
        """Strain energy of the terms that have one [J]."""
        return sum((energy for energy in self.system.elastic_energies(u) if not isnan(energy)), 0.0)

    def energy_and_force(self, u: Array, out: Array) -> float:
        """The strain energy of `energy` [J]; the internal force [N] is written to `out` (ndofs,)."""
        if not self.system.without_energy:
            return self.system.energy_and_force(u, out=out)[0]
        np.copyto(out, self.system.internal_force(u))
        return self.energy(u)

    def term_energies(self, u: Array) -> list[float]:
        """Strain energies of the elastic terms, if they are several and told apart [J]; NaN for one without an energy."""
        return self.system.elastic_energies(u) if self._several else []

    def inside_out(self, u: Array) -> NDArray[np.int64]:
        """Elements that are inside out or flat."""
        return self.system.inside_out(self.states.expand(u))

    def mean(self, u: Array, vertices: NDArray[np.int64]) -> Array:
        """(d,) mean displacements of these vertices [m]."""
        means: Array = u.reshape(-1, self.system.mesh.d)[vertices].mean(axis=0)
        return means

    def vertices_held(self, which: NDArray[np.intp]) -> NDArray[np.int64]:
        """Vertices of those of the held degrees of freedom."""
        vertices: NDArray[np.int64] = np.unique(self.free.fixed[which] // self.system.mesh.d)
        return vertices

    def commit(self, u: Array) -> None:
        """Tell terms with a memory that this is the next state."""
        self.system.commit(u)

    def restore(self) -> None:
        """Tell terms with a memory that the motion goes on from the state that was committed last."""
        self.system.restore()

    def ground_forces(self, u: Array, v: Array, t: float, since: float) -> Array:
        """(ndofs,) forces of supports and foundations at displacements and velocities (ndofs,), see `ground_forces` [N]."""
        return ground_forces(self, u, v, t, since)

    @property
    def driven(self) -> bool:
        """Whether loads or terms change the energy, see `driving_force`."""
        return driven(self.system)

    def driving_force(self, u: Array, t: float) -> Array:
        """Force of loads that change with time or have no potential, and of terms without energy [N]."""
        return driving_force(self.system, u, self.moment(t))

    def add_up(self, state: MotionState, sums: Array) -> float:
        """Twice the kinetic energy, linear and angular momentum, to `sums` (8,); returns the potential of steady loads [J]."""
        u, v, mesh = state.u, state.v, self.system.mesh
        if self.mass.kind == "lumped" and self.constant_loads is not None:
            kernels.lumped_momenta(mesh.p, u, v, self.mass.vertex, self.constant_loads, sums)
            return -float(sums[7])
        self.mass.multiply(v, out=self._Mv)
        shape = mesh.nv, mesh.d
        kernels.momenta(mesh.p, u.reshape(shape), v.reshape(shape), self._Mv.reshape(shape), sums)
        return steady_potential(self.system, u, self.moment(state.t))

    @cached_property
    def at_rest(self) -> TangentOperator:
        """Tangent stiffness K(0) of the body at rest, as an operator."""
        return self.system.linear_operator(np.zeros(self.system.ndofs))

    @property
    def damped(self) -> bool:
        """Whether there is any damping."""
        return bool(self.alpha or self.beta or self.tau)

    def moment(self, t: float) -> Moment:
        """The time `t` [s], when loads have their full size, and gravity pulls at the masses of this motion."""
        return Moment(t, 1.0, self.mass.kind)

    def held(self, t: float) -> Array:
        """Displacements of the held degrees of freedom [m]."""
        return self.system.supports.values(Moment(t, 1.0))

    def held_velocities(self, t: float, dt: float) -> Array:
        """Velocities of the held degrees of freedom [m/s], by forward differences."""
        if not self.moving:
            return np.zeros(len(self.free.fixed))
        h = DIFFERENCE * dt
        velocities: Array = (4 * self.held(t + h) - self.held(t + 2 * h) - 3 * self.held(t)) / (2 * h)
        return velocities

    @cached_property
    def constant_loads(self) -> Array | None:
        """(ndofs,) the loads, if they are the same at any time and place [N]."""
        if not constant_loads(self.system):
            return None
        loads = self.system.external_force(np.zeros(self.system.ndofs), self.moment(0.0))
        loads.flags.writeable = False
        return loads

    def loads(self, u: Array, t: float) -> Array:
        """(ndofs,) external forces [N]; the same array every time if they are constant."""
        return self.system.external_force(u, self.moment(t)) if self.constant_loads is None else self.constant_loads

    def add_damping(self, u: Array, v: Array, out: Array) -> None:
        """Add `D v` [N] at displacements `u` to `out`, all (ndofs,)."""
        self.add_linear_damping(v, out)
        if self.tau:
            self._force[:] = 0
            add_damping_force(self.system, u, v, self._force)
            out += self.tau * self._force

    def add_linear_damping(self, v: Array, out: Array) -> None:
        """Add `(alpha M + beta K(0)) v` [N]."""
        if self.alpha:
            out += self.alpha * self.mass.multiply(v)
        if self.beta:
            out += self.beta * self.at_rest.matvec(v)

    def force(self, u: Array, v: Array, t: float) -> Array:
        """(ndofs,) `h - D v - F` [N], the force that moves the body."""
        force = self.loads(u, t) - self.system.internal_force(u)
        damping = np.zeros_like(force)
        self.add_damping(u, v, damping)
        return force - damping

    def accelerations(self, u: Array, v: Array, t: float) -> Array:
        """(ndofs,) `M^-1 (h - D v - F)` [m/s^2], 0 where degrees of freedom are held."""
        return self.mass.solve(self.force(u, v, t))

    def dissipated(self, u0: Array, u1: Array, dt: float) -> float:
        """Energy that damping takes from the body between `u0` and `u1` [J]: `dt v' D v` at the mean velocity."""
        if not self.damped:
            return 0.0
        v = (u1 - u0) / dt
        force = np.zeros_like(v)
        self.add_linear_damping(v, force)
        lost = dt * self.states.dot(v, force)
        if self.tau:  # dzeta' L dzeta / 4 comes with the force
            self._force[:] = 0
            lost += 2 * self.tau / dt * add_secant_damping(self.system, u0, u1, 0.5, self._force)
        return lost


def motion_of(body: System | ReducedLike, mass: str | None, damping: Damping | None) -> Motion:
    """The motion of a body, or of one on a basis; masses are lumped unless others are asked for."""
    if isinstance(body, ReducedLike):
        motion: Motion = body.motion(mass, damping)
        return motion
    return Motion(body, "lumped" if mass is None else mass, damping)


def ground_forces(motion: Motion, u: Array, v: Array, t: float, since: float) -> Array:
    """(ndofs,) forces of supports and foundations on the body at a moment [N].

        M a + D v + F(u) - h(u, t)    of supports, where degrees of freedom are held
        -K_f (u + beta v)             of foundations, whose stiffness counts in Rayleigh's damping too

    Accelerations `a` are those of the equation of motion at this moment; where supports move, theirs: see `held_accelerations`.
    """
    fixed, mass = motion.free.fixed, motion.mass
    moving = motion.force(u, v, t)
    a = np.zeros_like(moving)
    if motion.moving:
        a[fixed] = held_accelerations(motion, t, since)
    if mass.kind == "consistent":  # what is held is coupled to what is not
        a += mass.solve(moving - mass.multiply(a))
    forces = motion.system.foundation_force(u + motion.beta * v)
    forces[fixed] += (mass.multiply(a) - moving)[fixed]
    return forces


def last_step(times: Sequence[float], dt: float) -> float:
    """When the last of the steps that led to `times` began [s]; before the first step, when one of the length `dt` will end.

    Differences over a step that the end of the run cut short would see rounding only: there it is the beginning of the step before.
    """
    if len(times) == 1:
        return times[0] + dt
    short = len(times) > 2 and times[-1] - times[-2] < SHORT * (times[-2] - times[-3])
    return times[-3] if short else times[-2]


def held_accelerations(motion: Motion, t: float, since: float) -> Array:
    """Accelerations of the held degrees of freedom at `t` [m/s^2], by differences over the step that began at `since` [s].

    The functions of the supports are evaluated within the run only.
    """
    h = (t - since) / 3
    here, one, two, three = (motion.held(t - i * h) for i in range(4))
    accelerations: Array = (2 * here - 5 * one + 4 * two - three) / h**2
    return accelerations
