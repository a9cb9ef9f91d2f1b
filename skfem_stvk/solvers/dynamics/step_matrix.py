"""Matrix of one implicit step: sparse, matrix-free or dense, and the substitutes for its tangent."""

from __future__ import annotations

from dataclasses import replace
from enum import Enum
from typing import Any, ClassVar, NamedTuple

import numpy as np
from scipy.sparse import csr_matrix

from ...arguments import Array
from ...edges import ALL, NONE, TENSILE, WARPED, Tensions
from ...linear import Factors, Kind, LinearSolver, Outcome, Solution, Unknowns
from ...linear.amg import Pace
from ...linear.block_cg import BlockJacobiAnalysis, BlockJacobiCg, BlockJacobiFactors
from ...linear.cg import EdgeFactors
from ...linear.dense import DenseFactors
from ...system import FreeOperator, System
from ...system.coordinates import Coordinates, DenseTangent
from ...system.free_tangent import FreeTangent, kind_of
from ...terms.loads.load import APART, Assumed, Moment, Time
from ..newton.problem import Tangent
from ..newton.stopwatch import Stopwatch
from .forces import StartTensions, add_mean_force
from .motion import Motion
from .record import HierarchyOrigin

#: Gauss points at which the force over a step of a body on a basis is averaged. The average is exact for a cubic force.
GAUSS = 0.5 - np.sqrt(3) / 6, 0.5 + np.sqrt(3) / 6


class StepTangent(Enum):
    """Substitutes for the tangent stiffness in an implicit integrator, by their names in the integrator's options.

    exact           K

    clamped         without negative tensions of edges: positive semi-definite

    gauss-newton    without any tension: 2 J'LJ

    warped          K(0), rotated with each element: without the derivative of its rotation (stiffness warping, Mueller 2004)

    diagonal        the diagonal blocks alone (Debunne 2001, Mueller 2001): no solve, but forces reach one vertex per step

    rest            K(0), factorised once: wrong under rotation
    """

    EXACT = "exact"
    CLAMPED = "clamped"
    GAUSS_NEWTON = "gauss-newton"
    WARPED = "warped"
    DIAGONAL = "diagonal"
    REST = "rest"

    @property
    def retained(self) -> Tensions:
        """Tensions that the tangent retains."""
        return {StepTangent.CLAMPED: TENSILE, StepTangent.GAUSS_NEWTON: NONE, StepTangent.WARPED: WARPED}.get(self, ALL)


class Coefficients(NamedTuple):
    """Coefficients of an integrator's equation of motion, `M (c w - m) + D (g w - d) + F - h + rest = 0`, for `w = u_1 - u_0`."""

    c: float  # factor of `w` in the acceleration `c w - m`; m is (ndofs,)
    m: Array
    g: float  # factor of `w` in the velocity `g w - d`; d is (ndofs,) or 0
    d: Array | float
    rest: Array | float = 0.0  # (ndofs,) forces that do not depend on `w`


def kind_of_step(system: System, tangent: StepTangent) -> Kind:
    """Return the kind of the tangent of a step. Diagonal blocks and K(0) are symmetric, without loads that follow the body."""
    return Kind.SYMMETRIC if tangent in (StepTangent.DIAGONAL, StepTangent.REST) else kind_of(system)


class StepMatrix:
    """Matrix of a step from `u0`, `c M + g D + K` over the free degrees of freedom, with the chosen substitute for K.

    `K` is that at the end of the step. With `mean` the force is twice the mean over the step, and its tangent is not symmetric.
    `2 J'LJ` at the middle and the tensions of the beginning replace it. The tensions are used as long as the iteration converges
    fast. For stiff bodies that vibrate faster than the steps, the tensions of the beginning are useless. K at the middle is not
    suitable, because a rotating body has shrunk there: a spinning block of 1e9 Pa took 20 times the iterations. If no term has a
    force between two states, all terms act at the middle, and K there is exact.

    Attributes
    ----------
    tangent
        The `FreeTangent` of the body.
    with_tensions
        Whether the matrix contains the tensions of the beginning.
    """

    def __init__(
        self, motion: Motion, solver: LinearSolver, chosen: StepTangent, mean: bool, watch: Stopwatch, friction: float = 1.0
    ) -> None:
        """`friction` is its factor in the equation, in which it acts in full even if forces of the end have a smaller weight."""
        self._friction = friction
        self._motion, self._system, self._watch = motion, motion.system, watch
        self._chosen, self._mean, self._retained = chosen, mean, chosen.retained
        self._u0, self._at = np.zeros(motion.states.n), np.zeros(motion.states.n)
        self._rest: tuple[int, csr_matrix] | None = None  # version of the pattern, and K(0)
        between = mean and any(term.has_mean_force for term in motion.system.bound_terms)
        self._tensions = StartTensions(motion.system) if between and chosen is not StepTangent.REST else None
        self.with_tensions = True
        self._constant_factors: tuple[Any, Factors] | None = None
        self._free_operator: FreeOperator | None = None
        self._origin: HierarchyOrigin | None = None
        with watch("factor"):
            self.tangent = FreeTangent(motion.system, solver, kind_of_step(motion.system, chosen))
        blocks = Unknowns(*np.divmod(self.tangent.free.free, motion.system.mesh.d))
        self._diagonal = BlockJacobiAnalysis(BlockJacobiCg(), blocks) if chosen is StepTangent.DIAGONAL else None

    def begin(self, u0: Array, c: float, g: float) -> None:
        """Begin a step from `u0` (ndofs,), which is not copied, with the factors `c` of M and `g` of D."""
        self._u0 = u0
        if self._tensions is not None:
            self._tensions.begin(u0)
        self._c, self._g, self.with_tensions = c, g, True
        self._inertia_factor = c + self._motion.alpha * g

    def add_mean_force(self, w: Array, t: Time, out: Array) -> None:
        """Add the mean internal force over the step by `w` to `out`, both (ndofs,) [N]."""
        add_mean_force(self._system, self._u0, self._u0 + w, out, t=t)

    def round_off(self, w: Array, t: Time) -> Array:
        """Return the sums (ndofs,) of `FreeTangent.round_off`, at the end of the step."""
        return self.tangent.round_off(self._u0 + w, self.assuming(w, t))

    def factorise(self, w: Array, t: Time, tangent: Tangent = Tangent.EXACT) -> Factors:
        """Return factors of the chosen tangent, or of a fallback of Newton's method, as in statics.

        K(0), and K of a linear body, are factorised once.
        """
        linear = self._system.constant_tangent and tangent is Tangent.EXACT
        if not linear and self._chosen is not StepTangent.REST:
            return self._factorise(w, t, tangent)
        key = self._c, self._g, self._system.pattern_version
        if self._constant_factors is None or self._constant_factors[0] != key:
            self._constant_factors = key, self._factorise(w, t, Tangent.EXACT)
        return self._constant_factors[1]

    def _factorise(self, w: Array, t: Time, tangent: Tangent) -> Factors:
        K: Any
        exact = tangent is Tangent.EXACT
        retained, multigrid = self._retained if exact else TENSILE, self.tangent.multigrid
        if self._diagonal is not None and exact:
            with self._watch("factor"):
                return _Diagonal(self._diagonal.factorise(self._operator(w, t, retained), self.tangent.kind))
        with self._watch("assemble"):
            if self.tangent.solver.matrix_free:
                K = self._operator(w, t, retained)
            else:
                K = self._matrix(w, t, retained)
                if tangent is Tangent.SHIFTED:
                    self.tangent.add_shift(K)
        with self._watch("factor"):
            if not self.tangent.solver.matrix_free:
                self.tangent.position = self._u0 + w
            if multigrid is None:
                return self.tangent.factorise(K, exact)
            before = multigrid.hierarchy
            factors = self.tangent.factorise(K, exact)
            if multigrid.hierarchy is not before:
                at = self._u0.copy(), w.copy(), Moment.of(t).time
                self._origin = HierarchyOrigin(*at, self._c, self._g, tangent, self.with_tensions)
            return factors

    @property
    def origin(self) -> HierarchyOrigin | None:
        """Origin of multigrid's present hierarchy; None without one."""
        multigrid = self.tangent.multigrid
        if multigrid is None or multigrid.hierarchy is None or self._origin is None:
            return None
        return replace(self._origin, pace=multigrid.pace.first, slow=multigrid.pace.is_slow)

    def forget(self) -> None:
        """Remove the hierarchy of multigrid, so that the next matrix gets a new one.

        Use the present body of the motion. If elements were removed from it, remove the matrices and factors of the previous body.
        """
        self.tangent.forget()
        system = self._motion.system
        if self._system is system:
            return
        self._system = system
        self.tangent.replace_system(system)
        if self._tensions is not None:
            self._tensions = StartTensions(system)
        self._rest = self._constant_factors = self._free_operator = None

    def rebuild(self, origin: HierarchyOrigin) -> None:
        """Build the hierarchy of multigrid that another run had."""
        if self.tangent.multigrid is None:
            return
        self.begin(origin.u0, origin.c, origin.g)
        self.with_tensions = origin.with_tensions
        self._factorise(origin.w, self._motion.moment(origin.t), origin.tangent)
        self.tangent.multigrid.pace = Pace(origin.pace, origin.slow)

    def _parts(self, retained: Tensions) -> tuple[Tensions, Tensions]:
        """Return the tensions in K, with the factor of edge damping, and the additional tensions of the beginning.

        Both include only tensions that `retained` retains.
        """
        factor = 1 + self._motion.tau * self._g
        if retained.warped:
            return WARPED._replace(damped=factor), NONE
        if self._tensions is not None:
            return NONE._replace(damped=factor), retained if self.with_tensions else NONE
        return retained._replace(damped=factor), NONE

    def _position(self, w: Array) -> Array:
        """Return the displacements (ndofs,) at which the tangent is evaluated [m]."""
        if self._chosen is StepTangent.REST:
            return np.zeros_like(w)
        return np.add(self._u0, w / 2 if self._mean else w, out=self._at)

    def assuming(self, w: Array, t: Time) -> Moment:
        """Return the moment at which contacts have the friction and the tangent that belong to the equation."""
        d, moment = self._system.mesh.d, Moment.of(t)
        if not self._system.contacts:
            return moment
        if self._chosen is StepTangent.REST:
            return moment.assuming(Assumed.APART, self._friction)
        states = (self._u0.reshape(-1, d), (self._u0 + w).reshape(-1, d)) if self._mean else None
        return moment.assuming(states, self._friction)

    def _matrix(self, w: Array, t: Time, retained: Tensions) -> csr_matrix:
        """Return the matrix of the step over the free degrees of freedom."""
        within, retained = self._parts(retained)
        at_rest = self._chosen is StepTangent.REST  # K(0) has no stiffness of follower loads, which changes
        position, moment, follows = self._position(w), self.assuming(w, t), not at_rest
        factor = within.damped if at_rest else 1.0
        if self.tangent.needs_only_free and self._tensions is None and not self._motion.beta:
            Kff = self.tangent.free_matrix(position, moment, within, follows)
            if factor != 1:
                Kff.data *= factor
            self._motion.mass.add_to(Kff, self._inertia_factor, self.tangent.free)
            return Kff
        K = self.tangent.matrix(position, moment, within, follows)
        if factor != 1:
            K.data *= factor
        if self._tensions is not None and retained != NONE:
            K.data += self._tensions.values(t, retained)
        if self._motion.beta:
            if self._rest is None or self._rest[0] != self._system.pattern_version:
                self._rest = self._system.pattern_version, self._system.tangent(np.zeros(self._system.ndofs), t=APART)
            K.data += self._motion.beta * self._g * self._rest[1].data
        self._motion.mass.add_to(K, self._inertia_factor)
        return self.tangent.restricted(K)

    def _operator(self, w: Array, t: Time, retained: Tensions) -> FreeOperator:
        """Return K as an operator for products. The mass on its diagonal replaces any other shift."""
        within, retained = self._parts(retained)
        operator = self.tangent.operator(self._position(w), self.assuming(w, t), within)
        others = [(self._motion.beta * self._g, self._motion.at_rest)] if self._motion.beta else []
        if self._tensions is not None and retained != NONE:
            others += self._tensions.operators(t, retained)
        if others:
            operator.scale_and_add(1.0, others)
        if self._free_operator is None:
            free = self.tangent.free.free
            self._lumped = self._motion.mass.vertex[free // self._system.mesh.d]
            self._free_operator = FreeOperator(operator, self.tangent.free, np.zeros(len(free)))
        np.multiply(self._lumped, self._inertia_factor, out=self._free_operator.shift)
        return self._free_operator


class DenseStepMatrix:
    """Dense matrix of a step from `z0` of a body in coordinates, `c M + g D + K`, with the methods of `StepMatrix`. It is exact.

    With `mean` the force over the step is `1/2 F(z0 + a w) + 1/2 F(z0 + b w)` at the two Gauss points. Its work is
    `W(z0 + w) - W(z0)` for a cubic force. Twice its tangent, `a K(z0 + a w) + b K(z0 + b w)`, is symmetric.

    Attributes
    ----------
    inertia
        (m, m) matrix `c M + g D` of the step.
    """

    with_tensions = False
    origin: ClassVar[None] = None

    def __init__(self, motion: Motion, body: Coordinates, mean: bool, watch: Stopwatch) -> None:
        self._motion, self._body, self._mean, self._watch = motion, body, mean, watch
        self._u0, self.tangent = np.zeros(motion.states.n), DenseTangent(body)
        self._key: tuple[float, float] | None = None
        self.inertia = np.zeros((motion.states.n,) * 2)

    def begin(self, u0: Array, c: float, g: float) -> None:
        """Begin a step from `u0` (m,), which is not copied, with the factors `c` of M and `g` of D."""
        self._u0 = u0
        if self._key != (c, g):
            motion = self._motion
            damping = motion.alpha * motion.mass.matrix + motion.beta * motion.at_rest
            self._key, self.inertia = (c, g), c * motion.mass.matrix + g * damping

    def assuming(self, w: Array, t: Time) -> Moment:
        """Return the moment itself: a body in coordinates has no contacts."""
        return Moment.of(t)

    def add_mean_force(self, w: Array, t: Time, out: Array) -> None:
        """Add the mean internal force over the step by `w` to `out`, both (m,)."""
        out += self.response(w)[0] / 2

    def response(self, w: Array) -> tuple[Array, Array]:
        """Return the internal force (m,) of the equation, and its derivative (m, m) by `w`."""
        if not self._mean:
            return self._body.linearize(self._u0 + w)[1:]
        a, b = GAUSS
        _, F, K = self._body.linearize(self._u0 + a * w)
        _, G, L = self._body.linearize(self._u0 + b * w)
        return F + G, a * K + b * L

    def round_off(self, w: Array, t: Time) -> Array:
        """Return the sums (m,) of `DenseTangent.round_off`, at the end of the step."""
        return self.tangent.round_off(self._u0 + w, t, self.response(w)[1])

    def factorise(self, w: Array, t: Time, tangent: Tangent = Tangent.EXACT) -> DenseFactors:
        """Return factors of the exact matrix. For other tangents, replace its eigenvalues by their absolute values."""
        with self._watch("assemble"):
            K = self.inertia + self.response(w)[1]
            follows = self._body.load_stiffness(self._u0 + w, t)
            if follows is not None:
                K += follows
        with self._watch("factor"):
            return self.tangent.factorise(K, tangent is Tangent.EXACT)

    def forget(self) -> None:
        """Do nothing: no data are retained from one matrix to the next."""

    def rebuild(self, origin: HierarchyOrigin) -> None:
        """Do nothing: there is no multigrid."""


class _Diagonal:
    """Inverted diagonal blocks. Their negative eigenvalues are not counted."""

    negative_pivots = None

    def __init__(self, factors: BlockJacobiFactors | EdgeFactors) -> None:
        self._factors = factors

    def solve(self, b: Array, rtol: float = 1e-10, x0: Array | None = None, out: Array | None = None) -> Solution:
        """Return the exact solution for the diagonal blocks."""
        return Solution(self._factors.precondition(b), 0, 0.0, Outcome.SOLVED)
