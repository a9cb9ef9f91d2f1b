"""A toy integrator: symplectic Euler that updates positions before velocities."""

from dataclasses import dataclass
from typing import ClassVar

from skfem_stvk.solvers.dynamics.integrators import ANGULAR_MOMENTUM, LINEAR_MOMENTUM, Explicit
from skfem_stvk.solvers.dynamics.integrators.explicit import ExplicitStepper


@dataclass(frozen=True)
class DriftKick(Explicit):
    """Steps `u <- u + T v`, then `v <- v + T M^-1 (h - F(u))`."""

    order: ClassVar[int] = 1
    conserves: ClassVar[frozenset[str]] = frozenset({LINEAR_MOMENTUM, ANGULAR_MOMENTUM})
    reversible: ClassVar[bool] = False

    def stepper(self, motion):
        return DriftKickStepper(motion, self.name)


class DriftKickStepper(ExplicitStepper):
    """Stepper with one force evaluation per step."""

    def step(self, state, t):
        h = t - state.t
        state.u += h * state.v
        self.move_supports(state, t)
        self.evaluate(state)
        state.v += h * self.inverse * (self.external(state.u, state.v, t) - self.internal)
