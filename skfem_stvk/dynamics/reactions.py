"""Forces of supports and foundations on a body in motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arguments import Array
from .motion import Motion

#: A step that is shorter than this part of the one before is no step to difference over.
SHORT = 0.3


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
    """When the last step began [s], of those that led to `times`; at first, when the next one of the length `dt` will end.

    Of one that the end of the run cut short, rounding would be all that differences see: there it is the beginning of the step before.
    """
    if len(times) == 1:
        return times[0] + dt
    short = len(times) > 2 and times[-1] - times[-2] < SHORT * (times[-2] - times[-3])
    return times[-3] if short else times[-2]


def held_accelerations(motion: Motion, t: float, since: float) -> Array:
    """How fast the held degrees of freedom gain speed at `t` [m/s^2], by differences of second order over the step that began at `since` [s].

    So the functions of the supports are asked for within the run only.
    """
    h = (t - since) / 3
    here, one, two, three = (motion.held(t - i * h) for i in range(4))
    accelerations: Array = (2 * here - 5 * one + 4 * two - three) / h**2
    return accelerations
