"""Where a body is and how it moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arguments import Array


@dataclass
class State:
    """A moment of a motion. Integrators change it in place, once a step has succeeded.

    Attributes
    ----------
    t : time [s].
    u, v, a : (ndofs,) displacements [m], velocities [m/s], and accelerations [m/s^2] where the integrator keeps them, otherwise zero.
    reaction : (ndofs,) what the supports did over the last step [N], at the degrees of freedom that are held; where none of them moves, and their
        work is nothing, explicit integrators leave it zero.
    """

    t: float
    u: Array
    v: Array
    a: Array
    reaction: Array

    @classmethod
    def at(cls, t: float, u: Array, v: Array) -> State:
        """Copies of `u` and `v`, without accelerations and reactions yet."""
        return cls(t, u.copy(), v.copy(), np.zeros_like(u), np.zeros_like(u))

    def copy(self) -> State:
        """One that stays as it is."""
        return State(self.t, *(array.copy() for array in (self.u, self.v, self.a, self.reaction)))

    def become(self, other: State) -> None:
        """All that the other one is, in the arrays of this one."""
        self.t = other.t
        for name in ("u", "v", "a", "reaction"):
            np.copyto(getattr(self, name), getattr(other, name))
