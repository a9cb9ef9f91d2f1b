"""The equilibrium of a system: residuals and tangents over the free degrees of freedom, on arrays that are made once."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ..arguments import Array
from ..edges import ALL, TENSILE, Tensions
from ..errors import StateError, StvkError, name_ids
from ..linear import BlockJacobiCg, Factors, Kind, LinearSolver, Solution, Unknowns
from ..linear.choose import direct
from ..linear.inertia import COUNTED, inertia, transposition
from ..nonlinear.problem import Residual, Tangent, dot, norm
from ..nonlinear.stopwatch import Stopwatch
from ..system import FreeOperator, System, TangentOperator
from ..system.rigid import rigid_modes
from ..terms.load import Time

#: What is added to a tangent without any stiffness in some direction, as a part of the largest diagonal entry of each vertex.
SHIFT = 1e-4
#: Loads and reactions below this part of the largest on the path count as this part: where they go back to zero, nothing else is left to
#: be small against.
NOTHING = 1e-6
#: How often on a path it is asked whether CG met negative curvature or its own round-off.
MOST_DOUBTS = 3
#: A Jacobian is symmetric to this part of its largest entry.
SYMMETRIC = 1e-12
#: Part of the load factor, or of 1, over which loads and prescribed displacements are differenced; exact for what grows linearly.
DIFFERENCE = 1e-6


class Equilibrium:
    """`F(u) = f_ext(u, t)` over the free degrees of freedom.

    Attributes
    ----------
    free : the free and held degrees of freedom.
    solver : the linear solver; a direct one where it had to take over.
    largest : of the forces on the path so far [N].
    symmetric : whether the last Jacobian that was factorised is, to `SYMMETRIC` of its largest entry.
    """

    def __init__(self, system: System, solver: LinearSolver, watch: Stopwatch) -> None:
        self.system, self.solver, self._watch = system, solver, watch
        self.free = system.free_dofs(system.supports.held)
        self._kind = kind_of(system)
        self.symmetric = self._kind is not Kind.GENERAL
        self._turned: NDArray[np.int64] | None = None
        self._u = np.zeros(system.ndofs)
        self.largest = 0.0
        self._exact: Factors | None = None
        self._operator: TangentOperator | None = None
        self._K: csr_matrix | None = None
        self._Kff: csr_matrix | None = None
        self._doubts = MOST_DOUBTS
        with watch("factor"):
            self._analysis = self.solver.analyse(self._unknowns())

    @property
    def n(self) -> int:
        """Number of unknowns."""
        return len(self.free.free)

    @property
    def iterative(self) -> bool:
        """Whether linear solves iterate."""
        return self.solver.iterative

    @property
    def dead(self) -> bool:
        """Whether no load depends on where the body goes."""
        return self.system.dead

    def dot(self, x: Array, y: Array) -> float:
        """`x . y` of two vectors of unknowns, or of two of all degrees of freedom."""
        return dot(x, y)

    def norm(self, x: Array) -> float:
        """`|x|`."""
        return norm(x)

    def direction(self, x: Array) -> Array:
        """(ndofs,) displacements `x` (n,) of the free degrees of freedom."""
        return self.free.vector(x)

    def unknowns_of(self, v: Array) -> Array:
        """(n,) displacements of the free degrees of freedom."""
        free: Array = v[self.free.free]
        return free

    def place(self, u: Array, t: float) -> Array:
        """`u`, in place, with the held degrees of freedom where they are at `t`."""
        u[self.free.fixed] = self.held(t)
        return u

    def stiffness_norm(self, u: Array, t: Time) -> float:
        """The largest sum of a row of K, or twice that of the blocks of its diagonal [N/m]."""
        K = self.operator(u, t)
        if isinstance(K, csr_matrix):
            return float(abs(K).sum(axis=1).max())
        return 2 * float(np.abs(K.diagonal_blocks()).sum(axis=2).max())

    def elastic_along(self, u: Array, v: Array) -> Array | None:
        """(5,) coefficients of the strain energy along `u + s v`; None if that is no quartic."""
        return self.system.energy_along(u, v) if self.system.quartic else None

    def take_over(self, u: Array, t: Time) -> bool:
        """Whether a direct solver takes over, here and on the rest of the path, where CG did not solve with the Jacobian at `u`.

        It does if CG met its round-off, as in slender bodies: if a factorisation finds no negative eigenvalue. It is asked for up to `COUNTED`
        unknowns, and a few times on a path.
        """
        n = len(self.free.free)
        if not self.solver.iterative or n > COUNTED or not self._doubts:
            return False
        self._doubts -= 1
        counts = inertia(*self.matrix(u, t))
        if counts is None or counts.negative:
            return False
        self.solver, self._exact = direct(n), None
        with self._watch("factor"):
            self._analysis = self.solver.analyse(self._unknowns())
        return True

    def residual(self, u: Array, t: Time) -> Residual:
        """What is not in equilibrium at `u` (ndofs,)."""
        with self._watch("assemble"):
            external = self.system.external_force(u, t)
            force = self.system.internal_force(u)
            force -= external
            free = force[self.free.free]
            size, scale = norm(free), norm(external) + norm(force[self.free.fixed])
            if not np.isfinite(size + scale):
                raise StateError(f"The residual overflows at displacements of up to {np.abs(u).max():.1e}.")
            return Residual(free, size, max(scale, NOTHING * self.largest))

    def accept(self, u: Array, t: Time) -> None:
        """A state of the path: its forces are something that others are small against."""
        residual = self.residual(u, t)
        self.largest = max(self.largest, residual.scale, residual.size)

    def slope(self, residual: Residual, v: Array) -> float:
        """`r . v` [J]."""
        return float(residual.free @ v[self.free.free])

    def round_off(self, u: Array, t: Time) -> float:
        """Size of the residual that is left by rounding alone [N]."""
        with self._watch("assemble"):
            sums = self.system.round_off(u) + np.abs(self.system.external_force(u, t))
            return float(np.finfo(float).eps) * norm(sums[self.free.free])

    def held(self, t: Time) -> Array:
        """Where the held degrees of freedom are at `t` [m]."""
        return self.system.supports.values(t)

    def rate(self, u: Array, t: float) -> tuple[Array, Array]:
        """(n,) `-dr/dt` over the free degrees of freedom [N] and (ndofs,) how the held ones move, by the tangent that was made last."""
        dt = DIFFERENCE * max(abs(t), 1.0) * (1 if t < 0.5 else -1)  # functions of t may end at 0 and 1
        forces, moves = self.change(u, t, t + dt)
        return forces / dt, moves / dt

    def change(self, u: Array, t: float, later: float) -> tuple[Array, Array]:
        """(n,) how loads and prescribed displacements at `later` push the free degrees of freedom more than those at `t` [N], and (ndofs,) how
        the held ones move [m], by the tangent that was made last."""
        with self._watch("assemble"):
            loads = self.system.external_force(u, later) - self.system.external_force(u, t)
        moves = np.zeros(self.system.ndofs)
        moves[self.free.fixed] = self.held(later) - self.held(t)
        return loads[self.free.free] - self.force_of(moves), moves

    def step_limit(self, u: Array, v: Array) -> float:
        """How far along `u + s v` no more elements turn inside out."""
        with self._watch("assemble"):
            return self.system.step_limit(u, v)

    def on_this_side(self, u: Array, found: Array) -> bool:
        """Whether no element would be flat on the straight way from `u` to `found`: turned by less than 180 degrees, not through itself.

        Nothing is said of states with elements inside out, which have to turn.
        """
        return len(self.inside_out(u)) > 0 or self.step_limit(u, found - u) > 1

    def energy_along(self, u: Array, v: Array, t: Time) -> Array:
        """(5,) coefficients of the potential along `u + s v`, but for the constant one."""
        with self._watch("assemble"):
            c = self.system.energy_along(u, v)
            c[1] -= dot(self.system.external_force(u, t), v)
            return c

    def factorise(self, u: Array, t: Time, tangent: Tangent = Tangent.EXACT) -> Factors:
        """The Jacobian at `u`, or what stands in for it, factorised."""
        K: Any
        kept, shifted = ALL if tangent is Tangent.EXACT else TENSILE, tangent is Tangent.SHIFTED
        self._u = u
        with self._watch("assemble"):
            if self.solver.matrix_free:
                K = self._free_operator(u, kept, shifted)
            else:
                self._K = self._jacobian(u, t, kept)
                K = self._Kff = self.free.matrix(self._K, out=self._Kff)
                if shifted:
                    K.setdiag(K.diagonal() + self._shift(K.diagonal()))
        with self._watch("factor"):
            factors = self._analysis.factorise(K, self._kind_of(K, tangent))
        if tangent is Tangent.EXACT:
            self._exact = factors
        return factors

    def matrix(self, u: Array, t: Time) -> tuple[csr_matrix, Unknowns]:
        """The Jacobian at `u` over the free degrees of freedom, beside what is factorised, and its unknowns."""
        with self._watch("assemble"):
            K = self.free.matrix(self.system.jacobian(u, t))
        return K, Unknowns(self.free.free // self.system.mesh.d, self.free.free % self.system.mesh.d, K.indptr, K.indices)

    def negative_pivots(self) -> int | None:
        """Of the exact tangent that was factorised last; None if there is none yet, or the solver does not know."""
        with self._watch("factor"):
            return None if self._exact is None else self._exact.negative_pivots

    def solve(self, factors: Factors, b: Array, rtol: float, start: Array | None = None, out: Array | None = None) -> Solution:
        """The solution of `K_ff x = b`, in `out` if there is one; iterative solvers look for it from `start` on, or from zero."""
        with self._watch("solve"):
            return factors.solve(b, rtol, start, out)

    def inside_out(self, u: Array) -> NDArray[np.int64]:
        """Ids of the elements that are inside out at `u`."""
        with self._watch("assemble"):
            return self.system.inside_out(u)

    def named(self, elements: NDArray[np.int64]) -> str:
        """The first few elements, and where they are; nothing of none."""
        if not len(elements):
            return ""
        x = self.system.mesh.p[:, self.system.mesh.t[:, elements[0]]].mean(axis=1)
        return f"{name_ids(elements, 'element')}, the first one near x = ({', '.join(f'{c:.4g}' for c in x)})"

    def smallest_volume_ratio(self, u: Array) -> float:
        """The smallest ratio of volumes now and at rest."""
        with self._watch("assemble"):
            return self.system.smallest_volume_ratio(u)

    def energies(self, u: Array, t: Time) -> tuple[float, float]:
        """Strain energy and potential [J]; that is NaN if a load has none."""
        with self._watch("assemble"):
            energy = self.system.energy(u)
            return energy, self.system.potential(u, t) if self.system.conservative else float("nan")

    def force_of(self, w: Array) -> Array:
        """(n,) what displacements `w` (ndofs,) of held degrees of freedom do to the free ones, by the tangent that was made last."""
        with self._watch("assemble"):
            K = self._operator if self.solver.matrix_free else self._K
            assert K is not None
            force: Array = (K @ w)[self.free.free]
            return force

    @property
    def quartic(self) -> bool:
        """Whether the residual is the gradient of a potential that is a quartic along any line."""
        return self.system.dead and self.system.quartic

    def operator(self, u: Array, t: Time) -> FreeOperator | csr_matrix:
        """The exact Jacobian over the free degrees of freedom, beside what is factorised; a matrix where loads have a stiffness."""
        if self.system.dead:
            return FreeOperator(self.system.linear_operator(u), self.free)
        return self.matrix(u, t)[0]

    def _shift(self, diagonal: Array) -> Array:
        """(n,) a little stiffness for each free degree of freedom, small against the largest of its vertex."""
        vertex = self.free.free // self.system.mesh.d
        largest = np.zeros(self.system.mesh.nv)
        np.maximum.at(largest, vertex, diagonal)
        return SHIFT * np.where(largest > 0, largest, largest.max())[vertex]

    def _kind_of(self, K: Any, tangent: Tangent) -> Kind:
        """What a tangent is: with loads that follow the body symmetric, too, where the rim of their surface is held or they are closed."""
        if self._kind is not Kind.GENERAL:
            return Kind.POSITIVE_DEFINITE if tangent is not Tangent.EXACT and self.system.dead else self._kind
        if self._turned is None:
            self._turned = transposition(K)
        skewed = float(np.abs(K.data - K.data[self._turned]).max(initial=0.0))
        self.symmetric = skewed <= SYMMETRIC * float(np.abs(K.data).max(initial=0.0))
        return Kind.SYMMETRIC if self.symmetric else Kind.GENERAL

    def _jacobian(self, u: Array, t: Time, kept: Tensions) -> csr_matrix:
        """In the place of the one before."""
        return self.system.jacobian(u, t, out=self._K, kept=kept)

    def _prepare(self, u: Array, kept: Tensions) -> TangentOperator:
        """The operator of all degrees of freedom, in the place of the one before."""
        if self._operator is None:
            self._operator = self.system.linear_operator(u, kept=kept)
        else:
            self._operator.prepare(u, kept=kept)
        return self._operator

    def _free_operator(self, u: Array, kept: Tensions, shifted: bool) -> FreeOperator:
        operator = self._prepare(u, kept)
        if not shifted:
            return FreeOperator(operator, self.free)
        diagonal = np.einsum("vcc->vc", operator.diagonal_blocks()).ravel()[self.free.free]
        return FreeOperator(operator, self.free, self._shift(diagonal))

    def _unknowns(self) -> Unknowns:
        free, d = self.free.free, self.system.mesh.d
        if self.solver.matrix_free:
            return Unknowns(free // d, free % d)
        structure = self.free.structure
        return Unknowns(free // d, free % d, structure.indptr, structure.indices, self._rigid_modes)

    def _rigid_modes(self) -> Array:
        """(n, r) rigid motions of the body as it is deformed now."""
        mesh = self.system.mesh
        return rigid_modes(mesh.p.T + self._u.reshape(-1, mesh.d))[self.free.free]


def kind_of(system: System) -> Kind:
    """What its Jacobian is."""
    return Kind.SYMMETRIC if system.conservative else Kind.GENERAL


def with_loads(solver: LinearSolver, system: System) -> LinearSolver:
    """The solver, which takes a matrix where loads have a stiffness: operators have that of elastic terms alone.

    Raises
    ------
    StvkError
        if it takes none.
    """
    if system.dead or not solver.matrix_free:
        return solver
    if not isinstance(solver, BlockJacobiCg):
        raise StvkError(
            f"solver = '{solver.name}', which forms no matrix; expected one that does, such as 'amg-cg' or 'superlu': a load depends on "
            "where the body goes, and its stiffness is added to a matrix."
        )
    return replace(solver, assembled=True)
