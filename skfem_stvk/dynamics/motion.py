"""The equation of motion of a system: masses, damping, loads and reactions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arguments import Array
from ..nonlinear.problem import dot
from ..system import TangentOperator
from ..system.protocol import SystemLike
from ..terms.load import Moment
from .damping import Damping, damping_factors
from .forces import add_damping_force, add_secant_damping, constant_loads

#: A step that is shorter than this part of the one before is too short for differences.
SHORT = 0.3
#: Part of a time step over which prescribed displacements are differenced to begin with.
DIFFERENCE = 1e-3


class Motion:
    """`M v' + D v + F(u) = h(u, t)` over the free degrees of freedom, `D = alpha M + beta K(0) + tau K_GN(u)`.

    `K_GN = 2 J'LJ` is K without tensions; `moving`: whether any of the held degrees of freedom move.
    """

    def __init__(self, system: SystemLike, mass: str, damping: Damping | None) -> None:
        self.system, self.mass = system, system.mass(mass)
        self.alpha, self.beta, self.tau = damping_factors(damping)
        self.free = system.free_dofs(system.supports.held)
        self.moving = system.supports.prescribed.size > 0
        self._force = np.zeros(system.ndofs)
        self._at_rest: tuple[int, TangentOperator] | None = None
        self._constant: tuple[int, Array | None] | None = None

    @property
    def at_rest(self) -> TangentOperator:
        """Tangent stiffness K(0) of the body at rest, as an operator; made anew when elements were taken out."""
        if self._at_rest is None or self._at_rest[0] != self.system.removals:
            self._at_rest = self.system.removals, self.system.linear_operator(np.zeros(self.system.ndofs))
        return self._at_rest[1]

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

    @property
    def constant_loads(self) -> Array | None:
        """(ndofs,) the loads, if they are the same at any time and place [N]."""
        if self._constant is None or self._constant[0] != self.system.removals:
            loads = None
            if constant_loads(self.system):
                loads = self.system.external_force(np.zeros(self.system.ndofs), self.moment(0.0))
                loads.flags.writeable = False
            self._constant = self.system.removals, loads
        return self._constant[1]

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
        lost = dt * dot(v, force)
        if self.tau:  # dzeta' L dzeta / 4 comes with the force
            self._force[:] = 0
            lost += 2 * self.tau / dt * add_secant_damping(self.system, u0, u1, 0.5, self._force)
        return lost


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
