"""The motion of a body whose displacements are those of a few coordinates, and the equation of one of its steps."""

from __future__ import annotations

from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..dynamics.damping import Damping
from ..dynamics.forces import driving_force, steady_potential
from ..dynamics.integrators import INTEGRATORS, Implicit, Integrator
from ..dynamics.motion import Motion, ground_forces
from ..dynamics.record import MotionState
from ..dynamics.step_problem import Coefficients
from ..errors import StateError, StvkError
from ..linear.choose import is_auto
from ..linear.space import Space
from ..nonlinear.problem import Residual, Tangent
from ..nonlinear.stopwatch import Stopwatch
from ..system.round_off import EPS, below
from ..terms.load import Moment, Time
from .basis import AtRest
from .equilibrium import SYMMETRIC, DenseFactors, DenseProblem, OnBasis, largest_error_on

#: The points of Gauss at which the force over a step is averaged: exact for a cubic.
GAUSS = 0.5 - np.sqrt(3) / 6, 0.5 + np.sqrt(3) / 6
NO_ELEMENTS: NDArray[np.int64] = np.empty(0, dtype=np.int64)


class Coordinates(NamedTuple):
    """The numbers of free coordinates, and of those of what is prescribed."""

    free: NDArray[np.int64]
    fixed: NDArray[np.int64]


class ReducedMass:
    """`columns' M columns` (m, m) of lumped masses M."""

    kind: ClassVar[str] = "lumped"

    def __init__(self, matrix: Array, free: int) -> None:
        self.matrix, self._free = matrix, free
        self._factors = DenseFactors(matrix[:free, :free].copy())

    def multiply(self, v: Array, out: Array | None = None) -> Array:
        """`M v` (m,)."""
        product: Array = np.dot(self.matrix, v, out=out)
        return product

    def solve(self, f: Array) -> Array:
        """Accelerations (m,) under forces (m,), zero of what is prescribed: lifts are orthogonal to the basis in M."""
        a = np.zeros_like(f)
        a[: self._free] = self._factors.solve(f[: self._free]).x
        return a


class ReducedMotion(Motion):
    """`M q'' + D q' + dW/dq = V' h` over the coordinates of a basis: states are `z = (q, s)` (m,), see `OnBasis`.

    Masses are lumped, damping is Rayleigh's. A step costs what m x m matrices cost, whatever the mesh; full displacements are made
    where states are saved, for reactions in the ledger and for loads that are not the same at any time and place.
    """

    by_term: ClassVar[bool] = False

    def __init__(self, reduced: OnBasis, mass: str | None, damping: Damping | None) -> None:
        if mass not in (None, "lumped"):
            raise StvkError(f"mass = {mass!r} for a reduced system; expected 'lumped': its basis is orthonormal in those masses.")
        super().__init__(reduced.body, "lumped", damping)
        if self.tau:
            raise StvkError("EdgeDamping resists at each edge, which a reduced system does not see. Take Rayleigh(alpha, beta).")
        self.reduced, r, m = reduced, reduced.size, reduced.columns.shape[1]
        self._on_mesh = Motion(reduced.body, "lumped", damping)
        self.free = Coordinates(np.arange(r), np.arange(r, m))  # type: ignore[assignment]
        self._momenta_of(reduced)
        self._known: tuple[Array, tuple[float, Array, Array]] | None = None
        self._stiffness_at_rest = reduced.response(np.zeros(m))[2].copy()
        self.damping_matrix = self.alpha * self.mass.matrix + self.beta * self._stiffness_at_rest
        self._plain = self.system.dead
        self._nowhere = np.zeros(self.system.ndofs)
        self._steady = self._steady_loads() if self._plain else None
        self._all_steady = None if self._on_mesh.constant_loads is None else self._steady
        self._rest: AtRest | None = None
        self._rows: dict[bytes, Array] = {}

    def _momenta_of(self, reduced: OnBasis) -> None:
        """Masses, and linear and angular momentum as linear and bilinear forms of coordinates and their rates."""
        d, B, X, masses = self.system.mesh.d, reduced.columns, self.system.mesh.p, self.mass.vertex
        along = [np.ascontiguousarray(B[i::d]) for i in range(d)]  # (nv, m) displacements by component
        weighed = [masses[:, None] * one for one in along]
        self.mass = ReducedMass(sum(a.T @ b for a, b in zip(along, weighed, strict=True)), reduced.size)  # type: ignore[assignment]
        m = B.shape[1]
        linear, turning = np.zeros((6, m)), np.zeros((3, m, m))
        for i in range(d):
            linear[i] = weighed[i].sum(axis=0)
        for k, (i, j) in enumerate([(1, 2), (2, 0), (0, 1)]):
            if i < d and j < d:
                linear[3 + k] = X[i] @ weighed[j] - X[j] @ weighed[i]
                one = along[i].T @ weighed[j]
                turning[k] = one - one.T
        self._sums = np.vstack([self.mass.matrix, linear, turning.reshape(3 * m, m)])

    def _steady_loads(self) -> Array:
        """(m,) loads that are the same at any time and place."""
        moment = self.moment(0.0)
        steady = self.system.external_force(self._nowhere, moment) - driving_force(self.system, self._nowhere, moment)
        return self.states.restrict(steady)

    @cached_property
    def states(self) -> Space:
        return self.system.space.spanned_by(self.reduced.columns)

    @property
    def on_mesh(self) -> Motion:
        return self._on_mesh

    @property
    def described(self) -> str:
        return repr(self.reduced)

    @property
    def basis(self) -> list[float]:
        return self.reduced.signature

    def refuse_other(self, integrator: Integrator, removing: bool) -> None:
        if integrator.conserves_reduced is None:
            known = ", ".join(name for name, one in INTEGRATORS.items() if one.conserves_reduced is not None)
            raise StvkError(f"{integrator.name} does not work on a reduced system; expected one of {known}.")
        tangent, solver = getattr(integrator, "tangent", "exact"), getattr(integrator, "solver", "auto")
        if tangent != "exact" or not is_auto(solver):
            raise StvkError(
                f"{integrator.name}(tangent={tangent!r}, solver={solver!r}) for a reduced system, whose tangent is exact, small "
                "and full: leave both out."
            )
        if removing:
            raise StvkError("remove: a reduced system was made of all its elements. Simulate its body: reduced.body.")

    def step_problem(self, integrator: Implicit, watch: Stopwatch) -> ReducedStep:
        return ReducedStep(self, integrator.mean, watch)

    def state(self, x: Array, t: float) -> Array:
        return self.reduced.state(x, self.moment(t))

    def held(self, t: float) -> Array:
        return self.reduced.amounts(Moment(t, 1.0))

    def response(self, z: Array) -> tuple[float, Array, Array]:
        """Strain energy [J], forces (m,) and stiffness (m, m) at `z`: once for each state that is asked for again."""
        if self._known is None or not np.array_equal(self._known[0], z):
            energy, force, K = self.reduced.response(z)
            self._known = z.copy(), (energy, force.copy(), K.copy())
        return self._known[1]

    def energy(self, u: Array) -> float:
        return self.response(u)[0]

    def term_energies(self, u: Array) -> list[float]:
        return []

    def mean(self, u: Array, vertices: NDArray[np.int64]) -> Array:
        key = vertices.tobytes()
        if key not in self._rows:
            self._rows[key] = self.reduced.columns.reshape(self.system.mesh.nv, self.system.mesh.d, -1)[vertices].mean(axis=0)
        means: Array = self._rows[key] @ u
        return means

    def vertices_held(self, which: NDArray[np.intp]) -> NDArray[np.int64]:
        moves = self.reduced.columns[self.system.supports.held][:, self.reduced.size + which]
        dofs = self.system.supports.held[np.abs(moves).max(axis=1) > 0]
        vertices: NDArray[np.int64] = np.unique(dofs // self.system.mesh.d)
        return vertices

    def ground_forces(self, u: Array, v: Array, t: float, since: float) -> Array:
        """Return those of the body; K at rest carries forces that the basis leaves at free degrees of freedom to the ground.

        That is `M a + D v + F - h` with the accelerations `a = V V' (h - D v - F)` of the basis.
        """
        forces, left = ground_forces(self._on_mesh, u, v, t, since), -self._on_mesh.force(u, v, t)
        basis, mass = self.reduced.columns[:, : self.reduced.size], self._on_mesh.mass
        left -= mass.multiply(basis @ (basis.T @ left))
        if self._rest is None:
            self._rest = AtRest(self.system)
        carried = self._on_mesh.at_rest.matvec(self._rest.solve(left))
        held = self._on_mesh.free.fixed
        forces[held] -= carried[held]
        return forces

    def commit(self, u: Array) -> None:
        """Do nothing: bodies with a memory have no reduced ones."""

    def restore(self) -> None:
        """Do nothing, as in `commit`."""

    @property
    def constant_loads(self) -> Array | None:
        return self._all_steady

    def loads(self, u: Array, t: float) -> Array:
        return self.reduced.loads(u, self.moment(t)) if self._all_steady is None else self._all_steady

    def driving_force(self, u: Array, t: float) -> Array:
        where = self._nowhere if self._plain else self.states.expand(u)
        return self.states.restrict(driving_force(self.system, where, self.moment(t)))

    def add_up(self, state: MotionState, sums: Array) -> float:
        u, v = state.u, state.v
        products, m = self._sums @ v, len(v)
        sums[0] = v @ products[:m]
        sums[1:7] = products[m : m + 6]
        sums[4:7] += products[m + 6 :].reshape(3, m) @ u
        if self._steady is not None:
            return -float(self._steady @ u)
        return steady_potential(self.system, self.states.expand(u), self.moment(state.t))

    def add_linear_damping(self, v: Array, out: Array) -> None:
        if self.alpha or self.beta:
            out += self.damping_matrix @ v

    def force(self, u: Array, v: Array, t: float) -> Array:
        force = self.loads(u, t) - self.response(u)[1]
        if self.damped:
            force -= self.damping_matrix @ v
        return force

    def load_stiffness(self, u: Array, t: float) -> Array | None:
        """(m, m) what loads that follow the body add to the tangent; None if there are none."""
        return None if self.system.dead else self.reduced.load_stiffness_of(u, self.moment(t))


class ReducedStep(DenseProblem):
    """One step from `z_0` as a `Problem`, whose state is the change `w` (m,) of the coordinates over the step.

        (c M + g D) w + F - h - offset = 0        F(z_0 + w), or F(z_0 + a w) + F(z_0 + b w) at the two points of Gauss

    `mean`: the latter, twice the mean of the force over the step, whose work is `W(z_0 + w) - W(z_0)` for a cubic force; its
    tangent `a K(z_0 + a w) + b K(z_0 + b w)` is symmetric. The last residual (m,) is `full`, of what is prescribed the reaction.
    """

    iterative: ClassVar[bool] = False
    origin: ClassVar[None] = None

    def __init__(self, motion: ReducedMotion, mean: bool, watch: Stopwatch) -> None:
        super().__init__(motion.reduced, watch)
        self.motion, self.reduced, self._mean = motion, motion.reduced, mean
        self._u0, self._offset = np.zeros(self.states.n), np.zeros(self.states.n)
        self._key: tuple[float, float] | None = None
        self._A = self._tangent = np.zeros((self.states.n,) * 2)
        self._at: Array | None = None
        self._K = self._A
        self.full: Array = self._offset

    @property
    def quartic(self) -> bool:
        return self.reduced.quartic and self.motion.system.dead and not self._mean

    def begin(self, state: MotionState, coefficients: Coefficients) -> None:
        """Begin a step from this state."""
        c, m, g, d, rest = coefficients
        if self._key != (c, g):
            self._key, self._A = (c, g), c * self.motion.mass.matrix + g * self.motion.damping_matrix
        np.copyto(self._u0, state.u)
        self._at = None
        self.motion.mass.multiply(np.asarray(m), out=self._offset)
        self._offset -= rest
        if isinstance(d, np.ndarray):
            self.motion.add_linear_damping(d, self._offset)

    def forget(self) -> None:
        """Do nothing: there is no multigrid."""

    def arrive(self, u: Array) -> float:
        """The strain energy at `u` (m,) [J]; the force that comes with it is where `before_step` begins."""
        with self._watch("assemble"):
            return self.motion.response(u)[0]

    def before_step(self, t: float) -> Array:
        """(m,) the residual for `w = 0`, of equations at the end of a step, without a rate."""
        with self._watch("assemble"):
            self.full = self.motion.response(self._u0)[1] - self._offset - self.motion.loads(self._u0, t)
            return self.full

    def residual(self, w: Array, t: Time) -> Residual:
        with self._watch("assemble"):
            internal = self._forces(w)
            inertia, loads = self._A @ w, self.motion.loads(self._u0 + w, Moment.of(t).time)
            self.full = inertia - self._offset + internal - loads
            space = self.space
            free = space.restrict(self.full)
            size = space.norm(free)
            scale = sum(space.norm(space.restrict(one)) for one in (inertia, self._offset, internal, loads))
            if not np.isfinite(size + scale):
                raise StateError(f"The residual overflows at coordinates of up to {np.abs(self._u0 + w).max():.1e}.")
            return Residual(free, size, scale)

    def round_off(self, w: Array, t: Time) -> float:
        sums = np.abs(self._A) @ np.abs(w) + np.abs(self._offset) + np.abs(self.motion.loads(self._u0 + w, Moment.of(t).time))
        sums += below(self._largest_error, np.abs(self._K) @ np.abs(self._u0 + w))
        return EPS * self.space.norm(self.space.restrict(sums))

    @cached_property
    def _largest_error(self) -> Array:
        return largest_error_on(self.reduced)

    def factorise(self, w: Array, t: Time, tangent: Tangent = Tangent.EXACT) -> DenseFactors:
        with self._watch("assemble"):
            if self._at is None or not np.array_equal(self._at, w):
                self._forces(w)
            self._tangent = self._A + self._K
            follows = self.motion.load_stiffness(self._u0 + w, Moment.of(t).time)
            if follows is not None:
                self._tangent += follows
            K, symmetric = self._tangent[self._free, self._free], True
            if not self.motion.system.conservative:
                symmetric = bool(np.abs(K - K.T).max() <= SYMMETRIC * np.abs(K).max())
        return self._factors(K, symmetric, tangent)

    def force_of(self, w: Array) -> Array:
        """(n,) force on the free coordinates where prescribed ones change by `w`, by the tangent that was made last."""
        force: Array = self._tangent[self._free] @ w
        return force

    def energy_along(self, w: Array, v: Array, t: Time) -> Array:
        """(5,) coefficients along `w + s v` of what an implicit step is the minimum of, but for the constant one."""
        with self._watch("assemble"):
            u1 = self._u0 + w
            c, Av = self.reduced.energy_along_states(u1, v), self._A @ v
            dot = self.states.dot
            c[1] += dot(Av, w) - dot(self._offset, v) - dot(self.motion.loads(u1, Moment.of(t).time), v)
            c[2] += dot(Av, v) / 2
            return c

    def step_limit(self, w: Array, v: Array) -> float:
        """Infinite: elements are not looked at within a step."""
        return float("inf")

    def on_this_side(self, w: Array, found: Array) -> bool:
        """Always true, as with `step_limit`."""
        return True

    def inside_out(self, w: Array) -> NDArray[np.int64]:
        """None: elements are looked at in the states that are saved."""
        return NO_ELEMENTS

    def named(self, inside_out: Any) -> str:
        """Empty: there are none."""
        return ""

    def _forces(self, w: Array) -> Array:
        """(m,) `F` of the equation, with its tangent in `_K`."""
        self._at = w.copy()
        if not self._mean:
            _, force, self._K = self.motion.response(self._u0 + w)
            return force
        force, K = np.zeros_like(w), np.zeros_like(self._A)
        for part in GAUSS:
            _, one, stiffness = self.reduced.response(self._u0 + part * w)
            force += one
            K += part * stiffness
        self._K = K
        return force
