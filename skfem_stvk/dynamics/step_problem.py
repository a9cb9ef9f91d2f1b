"""The equation of one implicit step as a nonlinear problem."""

from __future__ import annotations

from enum import Enum
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ..arguments import Array
from ..edges import ALL, NONE, TENSILE, WARPED, Tensions
from ..errors import StateError
from ..linear import Factors, Kind, LinearSolver, Outcome, Solution, Unknowns
from ..linear.amg import Pace
from ..linear.block_cg import BlockJacobiAnalysis, BlockJacobiCg, BlockJacobiFactors
from ..linear.cg import EdgeFactors
from ..nonlinear.problem import Residual, Tangent
from ..nonlinear.stopwatch import Stopwatch
from ..results.monitors import named_elements
from ..system import FreeOperator, System, TangentOperator
from ..system.free_tangent import FreeTangent, kind_of
from ..system.round_off import EPS, below, largest_error
from ..terms import HasMeanForce
from ..terms.load import Moment, Time
from .forces import StartTensions, add_damping_force, add_mean_force, add_secant_damping, passes_inversion
from .motion import Motion
from .record import HierarchyOrigin, MotionState

#: Linear solves of Newton's method are as precise as this at least, so that it converges as with a direct solver, for a sixth more
#: time than with 1e-5: with that, and where `rtol` allows much, small steps of Newmark's method were off by 1e-5 in place of 3e-9.
#: With those of an inexact Newton method, from 0.1 on, every step of energy and momentum of a stiff body that turns by 0.3 rad was
#: cut.
PRECISE = 1e-8
#: A residual that falls by less than this factor in an iteration falls slowly.
SLOW = 0.5


class StepTangent(Enum):
    """What stands in for the tangent stiffness in an implicit integrator, by its name in the integrator's options.

    exact           K
    clamped         without negative tensions of edges: positive semi-definite
    gauss-newton    without any tension: 2 J'LJ
    warped          K(0), turned with each element: without the derivative of its rotation (stiffness warping, Mueller 2004)
    diagonal        the diagonal blocks alone (Debunne 2001, Mueller 2001): no solve, but forces reach one vertex per step
    rest            K(0), made and factorised once: wrong under rotation
    """

    EXACT = "exact"
    CLAMPED = "clamped"
    GAUSS_NEWTON = "gauss-newton"
    WARPED = "warped"
    DIAGONAL = "diagonal"
    REST = "rest"

    @property
    def kept(self) -> Tensions:
        """The tensions that stay in it."""
        return {StepTangent.CLAMPED: TENSILE, StepTangent.GAUSS_NEWTON: NONE, StepTangent.WARPED: WARPED}.get(self, ALL)


class Coefficients(NamedTuple):
    """The equation of motion as an integrator has it, `M (c w - m) + D (g w - d) + F - h + rest = 0`, for `w = u_1 - u_0`."""

    c: float  # of the acceleration, as is m (ndofs,)
    m: Array
    g: float  # of the velocity, as is d (ndofs,) or 0
    d: Array | float
    rest: Array | float = 0.0  # (ndofs,) forces that do not depend on `w`


def kind_of_step(system: System, tangent: StepTangent) -> Kind:
    """The kind of the tangent of a step: diagonal blocks and K(0) are symmetric, without loads that follow the body."""
    return Kind.SYMMETRIC if tangent in (StepTangent.DIAGONAL, StepTangent.REST) else kind_of(system)


class StepProblem:
    """One step from `u_0` as a `Problem`, whose state is the displacement `w` (ndofs,) over the step.

    Of `u_1` itself, rounding would leave `eps |u| / |w|` of the velocities. The last residual (ndofs,) is `full`, at held degrees
    of freedom the reaction [N].

    Parameters
    ----------
    mean : whether the internal force is twice that of energy and momentum, `sum (t_0 + t_1)/2 p_1/2`; otherwise `F(u_1)`. Its
        tangent is not symmetric; `2 J'LJ` at the middle and the tensions of the beginning stand in for it, these for as long as
        that converges fast: in stiff bodies that vibrate faster than the steps they say nothing. K at the middle, where a body that
        turns has shrunk, does not do: a spinning block of 1e9 Pa took 20 times the iterations. If no term has a force between two
        states, all act at the middle, and K there is exact.
    secant : whether edge damping takes the rate of the squared elongations from their difference over the step; otherwise from
        velocities.
    """

    def __init__(
        self, motion: Motion, solver: LinearSolver, chosen: StepTangent, watch: Stopwatch, mean: bool = False, secant: bool = False
    ) -> None:
        self.motion, self.system, self._watch = motion, motion.system, watch
        self._chosen, self._mean, self._secant = chosen, mean, secant
        n = motion.system.ndofs
        self._u0, self._offset, self._force, self._arrived, self._at, self._w, self.full = (np.zeros(n) for _ in range(7))
        self._rest: Any = None  # K(0)
        between = mean and any(isinstance(term, HasMeanForce) for term in motion.system.bound_terms)
        self._tensions = StartTensions(motion.system) if between and chosen is not StepTangent.REST else None
        self._unlimited = motion.system.constant_tangent or passes_inversion(motion.system)
        self._lasting_factors: tuple[Any, Factors] | None = None
        self._free_operator: FreeOperator | None = None
        self._origin: HierarchyOrigin | None = None
        with watch("factor"):
            self.tangent = FreeTangent(motion.system, solver, kind_of_step(motion.system, chosen), lambda: self._u0 + self._w)
        self.free = self.tangent.free
        self.states, self.space = motion.states, motion.states.on(self.free.free)
        blocks = Unknowns(*np.divmod(self.free.free, motion.system.mesh.d))
        self._diagonal = BlockJacobiAnalysis(BlockJacobiCg(), blocks) if chosen is StepTangent.DIAGONAL else None

    @property
    def iterative(self) -> bool:
        return self.tangent.solver.iterative

    @property
    def quartic(self) -> bool:
        return self.system.dead and self.system.quartic and not self._mean and not self.motion.tau

    def begin(self, state: MotionState, coefficients: Coefficients) -> None:
        """Begin a step from this state."""
        with self._watch("assemble"):
            c, m, g, d, rest = coefficients
            np.copyto(self._u0, state.u)
            if self._tensions is not None:
                self._tensions.begin(state.u)
            self._before, self._with_tensions = np.inf, True
            self._c, self._g, self._d = c, g, d
            self.motion.mass.multiply(m, out=self._offset)
            self._offset -= rest
            if isinstance(d, np.ndarray):
                self.motion.add_linear_damping(d, self._offset)

    def arrive(self, u: Array) -> float:
        """`Motion.energy` at `u` (ndofs,) [J]; the internal force that comes with it is where `before_step` begins."""
        with self._watch("assemble"):
            return self.motion.energy_and_force(u, self._arrived)

    def before_step(self, t: float) -> Array:
        """(ndofs,) the residual for `w = 0`, from forces that are known; for equations at the end of a step, without a rate."""
        with self._watch("assemble"):
            np.subtract(self._arrived, self._offset, out=self.full)
            self.full -= self.motion.loads(self._u0, t)
            return self.full

    def residual(self, w: Array, t: Time) -> Residual:
        with self._watch("assemble"):
            loads = self.motion.loads(self._u0 + w, Moment.of(t).time)
            internal = self._internal_force(w)
            inertia = self._linear(w)
            space = self.space
            scale = sum(space.norm(space.restrict(one)) for one in (inertia, self._offset, internal, loads))
            self.full = inertia - self._offset + internal - loads
            free = space.restrict(self.full)
            size = space.norm(free)
            if not np.isfinite(size + scale):
                raise StateError(f"The residual overflows at displacements of up to {np.abs(self._u0 + w).max():.1e}.")
            if size > SLOW * self._before:
                self._with_tensions = False
            self._before = size
            return Residual(free, size, scale)

    def round_off(self, w: Array, t: Time) -> float:
        with self._watch("assemble"):
            u1 = self._u0 + w
            sums = below(self._largest_error, self.system.round_off(u1))
            sums += np.abs(self.system.external_force(u1, t)) + np.abs(self._offset)
            sums += self.motion.mass.multiply(np.abs(w)) * self._inertia_factor
            return EPS * self.space.norm(self.space.restrict(sums))

    @cached_property
    def _largest_error(self) -> Array:
        return largest_error(self.system)

    def factorise(self, w: Array, t: Time, tangent: Tangent = Tangent.EXACT) -> Factors:
        """The tangent that was chosen, or one that Newton's method falls back on, as in statics; K(0) stays what it is, and so does
        K of a body that is linear."""
        linear = self.system.constant_tangent and tangent is Tangent.EXACT
        if not linear and self._chosen is not StepTangent.REST:
            return self._factorise(w, t, tangent)
        key = self._c, self._g, self.system.pattern_version
        if self._lasting_factors is None or self._lasting_factors[0] != key:
            self._lasting_factors = key, self._factorise(w, t, Tangent.EXACT)
        return self._lasting_factors[1]

    def _factorise(self, w: Array, t: Time, tangent: Tangent) -> Factors:
        K: Any
        exact = tangent is Tangent.EXACT
        kept, self._w = self._chosen.kept if exact else TENSILE, w
        if self._diagonal is not None and exact:
            with self._watch("factor"):
                return _Diagonal(self._diagonal.factorise(self._operator(w, kept), self.tangent.kind))
        with self._watch("assemble"):
            if self.tangent.solver.matrix_free:
                K = self._operator(w, kept)
            else:
                K = self._matrix(w, t, kept)
                if tangent is Tangent.SHIFTED:
                    K.setdiag(K.diagonal() + self.tangent.shift(K.diagonal()))
        with self._watch("factor"):
            multigrid = self.tangent.multigrid
            before = None if multigrid is None else multigrid.hierarchy
            factors = self.tangent.factorise(K, exact)
            if multigrid is not None and multigrid.hierarchy is not before:
                at = self._u0.copy(), w.copy(), Moment.of(t).time
                self._origin = HierarchyOrigin(*at, self._c, self._g, tangent.value, self._with_tensions)
            return factors

    @property
    def origin(self) -> HierarchyOrigin | None:
        """The origin of the hierarchy that multigrid keeps; None where there is none."""
        multigrid = self.tangent.multigrid
        if multigrid is None or multigrid.hierarchy is None or self._origin is None:
            return None
        return self._origin._replace(pace=multigrid.pace.first, slow=multigrid.pace.is_slow)

    def forget(self) -> None:
        """Drop the hierarchy of multigrid, so that the next matrix gets a new one, and follow the motion to its present body."""
        self.tangent.forget()
        if self.system is not self.motion.system:
            self._follow(self.motion.system)

    def _follow(self, system: System) -> None:
        """Go on with the torn body: drop matrices and factors of the body with more elements."""
        self.system = system
        self.tangent.follow(system)
        self.free = self.tangent.free
        if self._tensions is not None:
            self._tensions = StartTensions(system)
        self._rest = self._lasting_factors = self._free_operator = None
        self.__dict__.pop("_largest_error", None)

    def rebuild(self, origin: HierarchyOrigin) -> None:
        """Build the hierarchy of multigrid again that another run kept."""
        if self.tangent.multigrid is None:
            return
        np.copyto(self._u0, origin.u0)
        if self._tensions is not None:
            self._tensions.begin(origin.u0)
        self._c, self._g, self._with_tensions = origin.c, origin.g, origin.with_tensions
        self._factorise(origin.w, self.motion.moment(origin.t), Tangent(origin.tangent))
        self.tangent.multigrid.pace = Pace(origin.pace, origin.slow)

    def solve(self, factors: Factors, b: Array, rtol: float) -> Solution:
        """The solution of `K x = b`, as precise as `PRECISE` at least."""
        with self._watch("solve"):
            return factors.solve(b, min(rtol, PRECISE))

    def take_over(self, w: Array, t: Time) -> bool:
        """Never: with the mass on its diagonal K is not so ill-conditioned."""
        return False

    def negative_pivots(self) -> int | None:
        with self._watch("factor"):
            return None if self.tangent.exact is None else self.tangent.exact.negative_pivots

    def energy_along(self, w: Array, v: Array, t: Time) -> Array:
        """(5,) coefficients along `w + s v` of what an implicit step is the minimum of, but for the constant one."""
        with self._watch("assemble"):
            u1 = self._u0 + w
            c, dot = self.system.energy_along(u1, v), self.states.dot
            c[1] -= dot(self.system.external_force(u1, t), v)
            Av = self._linear(v)
            c[1] += dot(Av, w) - dot(self._offset, v)
            c[2] += dot(Av, v) / 2
            return c

    def step_limit(self, w: Array, v: Array) -> float:
        if self._unlimited:
            return float("inf")
        with self._watch("assemble"):
            return self.system.step_limit(self._u0 + w, v)

    def on_this_side(self, w: Array, found: Array) -> bool:
        """As in `Problem`; always true of states with elements inside out, which have to turn."""
        return len(self.inside_out(w)) > 0 or self.step_limit(w, found - w) > 1

    def inside_out(self, w: Array) -> NDArray[np.int64]:
        """As in `Problem`; none of a body that is linear: its one state is what it is, and no other way leads there."""
        if self.system.constant_tangent:
            return np.empty(0, dtype=np.int64)
        with self._watch("assemble"):
            return self.system.inside_out(self._u0 + w)

    def named(self, inside_out: NDArray[np.int64]) -> str:
        return named_elements(self.system.mesh, inside_out)

    def force_of(self, w: Array) -> Array:
        """(n,) force on the free degrees of freedom where held ones move by `w` (ndofs,), by the tangent that was made last."""
        with self._watch("assemble"):
            return self.tangent.force_of(w)

    def _linear(self, w: Array) -> Array:
        """Forces of inertia and of linear damping for displacements `w`."""
        force = self._inertia_factor * self.motion.mass.multiply(w)
        if self.motion.beta:
            force += self.motion.beta * self._g * self.motion.at_rest.matvec(w)
        return force

    @property
    def _inertia_factor(self) -> float:
        return self._c + self.motion.alpha * self._g

    def _internal_force(self, w: Array) -> Array:
        """The elastic force and that of edge damping."""
        u0, u1, force = self._u0, self._u0 + w, self._force
        if self._mean:
            force[:] = 0
            add_mean_force(self.system, u0, u1, force)
            force *= 2
        else:
            self.motion.energy_and_force(u1, force)
        if self.motion.tau:
            damping = np.zeros_like(force)
            if self._secant:
                add_secant_damping(self.system, u0, u1, 0.5 if self._mean else 1.0, damping)
                damping *= self._g
            else:
                add_damping_force(self.system, u1, self._g * w - self._d, damping)
            force += self.motion.tau * damping
        return force

    def _parts(self, kept: Tensions) -> tuple[float, Tensions, Tensions]:
        """The factor of K and the tensions within, and tensions of the beginning beside it, as far as they are `kept`.

        Edge damping, a part of `2 J'LJ`, is the factor: `factor (2 J'LJ + tensions / factor)`.
        """
        factor = 1 + self.motion.tau * self._g
        if kept.warped:
            return factor, WARPED, NONE
        if self._tensions is not None:
            return factor, NONE, kept if self._with_tensions else NONE
        return factor, Tensions(kept.positive / factor, kept.negative / factor), NONE

    def _where(self, w: Array) -> Array:
        """(ndofs,) displacements at which the tangent is taken [m]."""
        if self._chosen is StepTangent.REST:
            return np.zeros_like(w)
        return np.add(self._u0, w / 2 if self._mean else w, out=self._at)

    def _matrix(self, w: Array, t: Time, kept: Tensions) -> csr_matrix:
        """The matrix of the step over the free degrees of freedom."""
        factor, within, kept = self._parts(kept)
        at_rest = self._chosen is StepTangent.REST  # loads follow the body, and change: they are not in K(0)
        where, moment = self._where(w), None if at_rest else t
        if self.tangent.straight and self._tensions is None and not self.motion.beta:
            Kff = self.tangent.free_matrix(where, moment, within)
            if factor != 1:
                Kff.data *= factor
            self.motion.mass.add_to(Kff, self._inertia_factor, self.free)
            return Kff
        K = self.tangent.matrix(where, moment, within)
        if factor != 1:
            K.data *= factor
        if self._tensions is not None and kept != NONE:
            K.data += self._tensions.values(t, kept)
        if self.motion.beta:
            if self._rest is None:
                self._rest = self.system.tangent(np.zeros(self.system.ndofs))
            K.data += self.motion.beta * self._g * self._rest.data
        self.motion.mass.add_to(K, self._inertia_factor)
        return self.tangent.restricted(K)

    def _operator(self, w: Array, kept: Tensions) -> FreeOperator:
        """K for products; with the mass on its diagonal it needs no other shift."""
        operator = self._prepared(w, kept)
        if self._free_operator is None:
            free = self.free.free
            self._lumped = self.motion.mass.vertex[free // self.system.mesh.d]
            self._free_operator = FreeOperator(operator, self.free, np.zeros(len(free)))
        np.multiply(self._lumped, self._inertia_factor, out=self._free_operator.shift)
        return self._free_operator

    def _prepared(self, w: Array, kept: Tensions) -> TangentOperator:
        factor, within, kept = self._parts(kept)
        operator = self.tangent.operator(self._where(w), within)
        others = [(self.motion.beta * self._g, self.motion.at_rest)] if self.motion.beta else []
        if self._tensions is not None and kept != NONE:
            others += self._tensions.operators(kept)
        if factor != 1 or others:
            operator.scale_and_add(factor, others)
        return operator


class _Diagonal:
    """Inverted diagonal blocks; nobody counts their negative eigenvalues."""

    negative_pivots = None

    def __init__(self, factors: BlockJacobiFactors | EdgeFactors) -> None:
        self._factors = factors

    def solve(self, b: Array, rtol: float = 1e-10, x0: Array | None = None, out: Array | None = None) -> Solution:
        """Exact, of the diagonal blocks."""
        return Solution(self._factors.precondition(b), 0, 0.0, Outcome.SOLVED)
