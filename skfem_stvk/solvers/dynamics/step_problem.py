"""Equation of one implicit step as a nonlinear problem."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...arguments import Array
from ...errors import StateError
from ...results.monitors import named_elements
from ...system.equation import Equation
from ...system.free_tangent import EPS
from ...terms.loads.load import Moment, Time
from ..newton.problem import Residual
from ..newton.stopwatch import Stopwatch
from .forces import add_damping_force, add_secant_damping, passes_inversion
from .motion import Motion
from .record import MotionState
from .step_matrix import Coefficients, DenseStepMatrix, StepMatrix

#: Smallest ratio of successive residuals that counts as slow convergence.
SLOW = 0.5


class StepProblem(Equation):
    """One step from `u_0` as a `Problem`. Its state is the displacement `w` over the step, in the states of the motion.

    If `u_1` were the state, rounding would leave an error `eps |u| / |w|` in the velocities. `full` is the last residual. At
    constrained degrees of freedom it is the reaction [N]. `offset` are the constant forces of inertia and damping.

    Parameters
    ----------
    matrix
        The matrix of the step over the free degrees of freedom.
    mean
        Whether the internal force is twice the mean over the step, as for energy and momentum; otherwise `F(u_1)`.
    secant
        Whether edge damping uses the difference of the squared elongations over the step as their rate; otherwise it uses
        velocities.
    """

    #: Relative tolerance of iterative linear solves. With it, Newton's method converges as with a direct solver.
    #: It takes a sixth more time than 1e-5. With 1e-5 and a large `rtol`, small steps of Newmark's method had errors of 1e-5, not
    #: 3e-9.
    #: With the tolerances of an inexact Newton method, from 0.1 on, every `EnergyMomentum` step of a stiff body rotating by 0.3 rad
    #: was cut.
    largest_rtol = 1e-8

    def __init__(
        self, motion: Motion, matrix: StepMatrix | DenseStepMatrix, watch: Stopwatch, mean: bool = False, secant: bool = False
    ) -> None:
        super().__init__(motion.body, matrix.tangent, watch)
        self.motion, self.matrix, self._mean, self._secant = motion, matrix, mean, secant
        self.factorise = matrix.factorise
        self._u0, self.offset, self._force, self._inertia, self._internal, self.full = (np.zeros(motion.states.n) for _ in range(6))
        self._last: tuple[Array, Residual] | None = None  # displacements over the step, and their residual
        self.no_step_limit = self.no_step_limit or passes_inversion(self.system)
        self.ignores_inversion = (
            self.ignores_inversion or self.body is not self.system
        )  # on a basis, elements are checked in saved states

    def forget(self) -> None:
        """Use the present body of the motion, and remove data of its matrix from previous steps."""
        self.body, self.system = self.motion.body, self.motion.system
        self.matrix.forget()

    @property
    def quartic(self) -> bool:
        return self.system.dead and self.body.quartic and not self._mean and not self.motion.tau

    def begin(self, state: MotionState, coefficients: Coefficients) -> None:
        """Begin a step from this state."""
        with self._watch("assemble"):
            c, m, g, d, rest = coefficients
            np.copyto(self._u0, state.u)
            self.matrix.begin(self._u0, c, g)
            self._before, self._last = np.inf, None
            self._g, self._d, self._inertia_factor = g, d, c + self.motion.alpha * g
            self.motion.mass.multiply(m, out=self.offset)
            self.offset -= rest
            if isinstance(d, np.ndarray):
                self.motion.add_linear_damping(d, self.offset)

    def store_internal_force(self, u: Array, moment: Moment) -> float:
        """Return `Motion.energy` at `u` (ndofs,) [J], and store the internal force for `before_step`."""
        with self._watch("assemble"):
            return self.motion.energy_and_force(u, moment, self._internal)

    def before_step(self, t: float) -> Array:
        """Return the residual (ndofs,) for `w = 0`, from stored forces.

        It is valid for equations at the end of a step without rates.
        """
        with self._watch("assemble"):
            np.subtract(self._internal, self.offset, out=self.full)
            self.full -= self.motion.loads(self._u0, t)
            return self.full

    def reactions(self, w: Array, u: Array, t: float, out: Array) -> Array:
        """Return, in `out`, the forces of the supports after a step by `w` to `u`, from the stored force.

        It is valid for equations at the end of a step.
        """
        with self._watch("assemble"):
            fixed, linear = self.motion.free.fixed, self._linear(w)
            self._add_edge_damping(w, u, linear)
            linear -= self.offset
            linear += self._internal
            linear -= self.motion.loads(u, t)
            return np.take(linear, fixed, out=out, mode="clip")

    def residual(self, w: Array, t: Time) -> Residual:
        if self._last is not None and not self.space.comm.any(not np.array_equal(self._last[0], w)):  # the line search ended there
            return self._last[1]
        with self._watch("assemble"):
            loads = self.motion.loads(self._u0 + w, Moment.of(t).time)
            internal = self._internal_force(w, Moment.of(t))
            inertia = self._linear(w)
            space = self.space
            scale = sum(space.norm(space.restrict(one)) for one in (inertia, self.offset, internal, loads))
            self.full = inertia - self.offset + internal - loads
            free = space.restrict(self.full)
            size = space.norm(free)
            if not np.isfinite(size + scale):
                largest = self.states.comm.most(float(np.abs(self.states.expand(self._u0 + w)).max()))
                raise StateError(f"The residual overflows at displacements of up to {largest:.1e}.")
            if size > SLOW * self._before:
                self.matrix.with_tensions = False
            self._before = size
            self._last = w.copy(), Residual(free, size, scale)
            return self._last[1]

    def round_off(self, w: Array, t: Time) -> float:
        with self._watch("assemble"):
            u1 = self._u0 + w
            sums = self.matrix.round_off(w, t)
            sums += np.abs(self.motion.loads(u1, Moment.of(t).time)) + np.abs(self.offset)
            sums += self.motion.mass.multiply(np.abs(w)) * self._inertia_factor
            return EPS * self.space.norm(self.space.restrict(sums))

    def switch_to_direct(self, w: Array, t: Time) -> bool:
        """Return False: with the mass on its diagonal, K is less ill-conditioned."""
        return False

    def energy_along(self, w: Array, v: Array, t: Time) -> Array:
        """Return the coefficients (5,), without the constant one, of the objective of an implicit step along `w + s v`."""
        with self._watch("assemble"):
            u1 = self._u0 + w
            c, dot = self.body.energy_along(u1, v), self.states.dot
            c[1] -= dot(self.motion.loads(u1, Moment.of(t).time), v)
            Av = self._linear(v)
            c[1] += dot(Av, w) - dot(self.offset, v)
            c[2] += dot(Av, v) / 2
            return c

    def named(self, inside_out: NDArray[np.int64]) -> str:
        return named_elements(self.system.mesh, inside_out)

    def _linear(self, w: Array) -> Array:
        """Return the forces of inertia and of linear damping for displacements `w`; the array is valid until the next call."""
        force: Array = self.motion.mass.multiply(w, out=self._inertia)
        force *= self._inertia_factor
        if self.motion.beta:
            force += self.motion.beta * self._g * (self.motion.at_rest @ w)
        return force

    def _body_state(self, u: Array) -> Array:
        return self._u0 + u

    def _internal_force(self, w: Array, moment: Moment) -> Array:
        """Return the elastic force plus the force of edge damping."""
        u1, force = self._u0 + w, self._force
        if self._mean:
            force[:] = 0
            self.matrix.add_mean_force(w, moment, force)
            force *= 2
        else:
            self.motion.energy_and_force(u1, self.matrix.assuming(w, moment), force)
        self._add_edge_damping(w, u1, force)
        return force

    def _add_edge_damping(self, w: Array, u1: Array, force: Array) -> None:
        """Add the force of edge damping over a step by `w` to `u1`."""
        if not self.motion.tau:
            return
        damping = np.zeros_like(force)
        if self._secant:
            add_secant_damping(self.system, self._u0, u1, 0.5 if self._mean else 1.0, damping)
            damping *= self._g
        else:
            add_damping_force(self.system, u1, self._g * w - self._d, damping)
        force += self.motion.tau * damping
