"""Largest stable step of explicit integrators, from the largest eigenvalue of (K, M) and from a bound on it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...arguments import Array
from ...edges import ALL
from ...space import Space
from ...system import System, TangentOperator
from ...system.coordinates import checked_system
from ...system.mass import Mass
from ...terms.loads.load import APART, Assumed, Moment
from .damping import Damping, damping_factors

#: Largest number of estimates with damping, and the relative change of the step at which they end.
MOST, PRECISION = 6, 1e-4
#: Relative residual of the eigenvalue, and largest number of products with K.
RESIDUAL, MOST_PRODUCTS = 1e-3, 300
#: Relative length below which a direction, made orthogonal to the others, is only round-off.
SHORT = 1e-8
#: Number of products with norms of blocks. Each of them improves the bound.
SWEEPS = 5


@dataclass(frozen=True)
class CriticalStep:
    """Largest stable step of central differences (velocity Verlet, symplectic Euler) at a state.

    Attributes
    ----------
    step
        Step from the largest eigenvalue of `M^-1 K` [s].
    bound
        Smaller, safe step [s], from the norms of the blocks of K alone.
    omega, omega_bound
        Largest circular frequency without damping, and an upper bound on it [1/s]. Without damping the steps are `2/omega` and
        `2/omega_bound`.
    products
        Number of products of K with a vector that `step` took.
    """

    step: float
    bound: float
    omega: float
    omega_bound: float
    products: int

    def __str__(self) -> str:
        return f"critical step {self.step:.4g} s, safe bound {self.bound:.4g} s"


class LargestFrequency:
    """Critical steps of a system as it deforms. Only scratch arrays are retained from one state to the next.

    With lagged velocities in the damping forces, `M a_n + D v_{n-1/2} + F(u_n) = h`, a step `T` is stable as long as

        T^2 x'Kx + 2 T x'Dx <= 4 x'Mx        for all motions x that the supports allow,        D = alpha M + beta K0 + tau K_GN(u)

    For a damping ratio `xi` this is `T <= (2/omega) (sqrt(1 + xi^2) - xi)`, so damping makes the step smaller. The stiffness of
    loads that have a potential and are not dead counts by a bound on its own largest eigenvalue. `ForwardEuler` is this scheme.
    `VelocityVerlet` evaluates damping at a predicted velocity, so its step is that of twice the damping.

    The search for an eigenvalue always begins with the same random motion. The mode of the previous state would save a fifth of the
    products. It could miss an eigenvalue that has become the largest one elsewhere.

    Parameters
    ----------
    damping
        Damping, as `Rayleigh`, `EdgeDamping`, or several.

    Attributes
    ----------
    vertex
        (nv,) lumped masses [kg], 0 for constrained vertices.
    """

    def __init__(self, system: System, damping: Damping | None = None) -> None:
        checked_system(system)
        self._system, self._mass, self._damping = system, system.mass(), damping_factors(damping)
        self._operator: TangentOperator | None = None
        self._products, self._is_free = 0, self._mass.free.ravel()
        self.vertex = np.where(self._mass.free.any(axis=1), self._mass.vertex, 0.0)
        self._at_rest: TangentOperator | None = None

    def at(self, u: ArrayLike, t: float = 0.0) -> CriticalStep:
        """Return the critical step at displacements `u` (ndofs,) [m] and time `t` [s].

        Raises
        ------
        StateError
            if `u` does not have one finite entry for each degree of freedom, or K overflows.
        """
        self._products = 0
        square_bound, bound = self._solve(u, t, self._bound)
        square, step = self._solve(u, t, self._largest)
        omega_bound = float(np.sqrt(square_bound))
        return CriticalStep(max(step, bound), bound, min(float(np.sqrt(square)), omega_bound), omega_bound, self._products)

    def bound(self, u: ArrayLike, t: float = 0.0) -> float:
        """Return the safe bound alone [s]. It costs a few products. Raises the errors of `at`."""
        return self._solve(u, t, self._bound)[1]

    def _solve(self, u: ArrayLike, t: float, elastic: Callable[[TangentOperator], float]) -> tuple[float, float]:
        """Return the largest `omega^2` without damping, and the step.

        The step `T` solves `T^2 lam + 2 T alpha = 4`, where `lam` is the largest eigenvalue of `K + 2/T (beta K0 + tau K_GN)`.
        `lam` is a convex function of 1/T, so chords from 1/T = 0 on find the solution. The last step is shortened to account for
        the remaining error.
        """
        alpha, beta, tau = self._damping
        loads = self._of_loads(u, t)

        def estimate(K: TangentOperator) -> float:
            return elastic(K) + loads

        square = estimate(self._prepared(u, t, np.inf))
        step = _root(square, alpha + (beta + tau) * square)
        if beta + tau == 0 or square == 0:
            return square, step
        for _ in range(MOST):
            largest = estimate(self._prepared(u, t, step))
            before, excess = step, (step**2 * largest + 2 * step * alpha) / 4
            step = _root(square, alpha + max(largest - square, 0.0) * step / 2)
            if abs(step - before) <= PRECISION * step:
                break
        return square, min(step, before / max(excess, 1.0))

    def _prepared(self, u: ArrayLike, t: float, step: float) -> TangentOperator:
        """Return `K + 2/T (beta K0 + tau K_GN)` at `u` as an operator. `K_GN` has the terms with a damping force only."""
        tau_share, beta_share = 2 * self._damping.tau / step, 2 * self._damping.beta / step
        retained, touching = ALL._replace(damped=1 + tau_share), Moment(t, 1.0, contact=Assumed.TOUCHING)
        if self._operator is None:
            self._operator = self._system.linear_operator(u, kept=retained, t=touching)
        else:
            self._operator.prepare(u, kept=retained, t=touching)
        if beta_share and self._at_rest is None:
            self._at_rest = self._system.linear_operator(np.zeros(self._system.ndofs), t=APART)
        if beta_share and self._at_rest is not None:
            self._operator.scale_and_add(1.0, [(beta_share, self._at_rest)])
        return self._operator

    def _of_loads(self, u: ArrayLike, t: float) -> float:
        """Return a bound on the increase of the largest eigenvalue by the stiffness of loads [1/s^2], from Gershgorin's circles."""
        K, space = self._system.load_stiffness(u, Moment(t, 1.0)), self._system.space
        if K is None:
            return 0.0
        mass, rows = np.repeat(self._mass.vertex, self._system.mesh.d)[self._is_free], np.zeros(space.n)
        rows[self._is_free] = abs(K[self._is_free][:, self._is_free]) @ (1 / np.sqrt(mass))
        return space.comm.most(float((space.share(rows)[self._is_free] / np.sqrt(mass)).max(initial=0.0)))

    def _bound(self, K: TangentOperator) -> float:
        return bound_on_eigenvalues(K, self.vertex)

    def _largest(self, K: TangentOperator) -> float:
        """Return an upper estimate of the largest eigenvalue: the Rayleigh quotient plus the residual, at most the bound."""
        bound = self._bound(K)
        if bound == 0:
            return 0.0
        mass = np.repeat(self._mass.vertex, self._system.mesh.d)
        x = self._system.space.random() / np.sqrt(np.where(self._is_free, mass, np.inf))
        found = largest_eigenvalue(K.matvec, self._mass, x, self._system.space)
        self._products += found.products
        return min(max(found.value + found.residual, 0.0), bound)


def critical_step(system: System, u: ArrayLike | None = None, *, damping: Damping | None = None) -> CriticalStep:
    """Return the largest stable step of explicit integrators with the lumped mass.

    Parameters
    ----------
    system
        Body with densities, and its supports.
    u
        (ndofs,) displacements [m], by default zero.
    damping
        `Rayleigh`, `EdgeDamping` or a list of them. The step is then that of `ForwardEuler`. For `VelocityVerlet` damping counts
        twice, so pass twice the damping.

    Returns
    -------
    CriticalStep
        The `step` [s] from the largest eigenvalue of `M^-1 K`, and the safe `bound` [s] from the norms of the blocks of K.

    Raises
    ------
    MaterialError
        if a material has no density, or a vertex that can move has no mass.
    StateError
        if `u` does not have one finite entry for each degree of freedom, or K overflows.
    StvkError
        if `damping` is no damping.

    Examples
    --------
    >>> import numpy as np
    >>> from skfem_stvk import ElementMesh, StVK, System
    >>> line = ElementMesh(np.linspace(0, 1, 11)[None], np.stack([np.arange(10), np.arange(1, 11)]))
    >>> bar = System(line, StVK(young=4.0, poisson=0.3, density=1.0))
    >>> critical = critical_step(bar)             # the time that a wave of speed 2 m/s takes through an element of 0.1 m
    >>> round(critical.step, 4), round(critical.bound, 3)
    (0.05, 0.05)
    """
    return LargestFrequency(system, damping).at(np.zeros(system.ndofs) if u is None else u)


def _root(k: float, c: float) -> float:
    """Return the `T > 0` that solves `T^2 k + 2 T c = 4`; infinity if there is none."""
    rate = c + np.sqrt(c**2 + 4 * k)
    return float(4 / rate) if rate > 0 else np.inf


class Largest(NamedTuple):
    """Eigenpair of `K x = value M x`."""

    value: float  # Rayleigh quotient of x [1/s^2]: not above the largest eigenvalue
    residual: float  # residual norm for `M^-1/2 K M^-1/2` [1/s^2]: an eigenvalue lies within it of `value`
    vector: Array  # x (ndofs,), of length one in M
    products: int  # number of products with K


def largest_eigenvalue(product: Callable[[Array], Array], mass: Mass, x: Array, space: Space) -> Largest:
    """Return the largest eigenvalue of (K, M), by locally optimal conjugate gradients (LOBPCG, Knyazev 2001).

    The iteration starts from `x` (ndofs,). Lanczos' method needs as many products and stores all vectors so far; LOBPCG stores the
    last three. scipy's `lobpcg` finds the same eigenvalue on slender, mixed and compact bodies, membranes and single tetrahedra. It
    takes one or two products more (14 for 13, 26 for 24), and 1.4 to 2.1 times the time.
    """
    dot = space.dot

    def unit(v: Array) -> Array:
        size = np.sqrt(dot(v, mass.multiply(v)))
        return v / size if size > 0 else v

    x = unit(x)
    Kx, products, size = product(x), 1, 0.0
    p = Kp = np.zeros_like(x)
    while True:
        value = dot(x, Kx)
        size = max(size, abs(value))
        w = mass.solve(Kx) - value * x
        residual = float(np.sqrt(max(dot(w, mass.multiply(w)), 0.0)))
        if residual <= RESIDUAL * size or products >= MOST_PRODUCTS:
            return Largest(value, residual, x, products)
        w = unit(w - dot(w, mass.multiply(x)) * x)
        Kw, products = product(w), products + 1
        basis, images = [x, w], [Kx, Kw]
        for other, image in zip(basis, images, strict=True):
            along = dot(other, mass.multiply(p))
            p, Kp = p - along * other, Kp - along * image
        length = np.sqrt(dot(p, mass.multiply(p)))
        if length > SHORT:
            basis.append(p / length)
            images.append(Kp / length)
        small = np.array([[dot(a, image) for image in images] for a in basis])
        first, *others = np.linalg.eigh((small + small.T) / 2)[1][:, -1]
        p, Kp = _combined(others, basis[1:]), _combined(others, images[1:])
        x, Kx = first * x + p, first * Kx + Kp


def bound_on_eigenvalues(K: TangentOperator, vertex: Array) -> float:
    """Return an upper bound on the eigenvalues of (K, M) [1/s^2], with M lumped to the masses `vertex` (nv,).

        value <= max_a (k_a s_a + sum_b |K_ab| s_b) / (m_a s_a)        for any s > 0

    `k_a` is the largest eigenvalue of the diagonal block, and `|K_ab|` are the norms of the others. These are Gershgorin's circles
    of blocks, scaled. The iteration starts from `s = m^-1/2`. The next `s_a` is the numerator divided by `m_a`, so that the bound
    decreases (Collatz, Wielandt). Constrained vertices have the mass zero. Where parts of a divided body share an edge, the sum of
    the norms of their contributions to `K_ab` replaces `|K_ab|`, which is not larger.
    """
    own = _largest_of_blocks(K.diagonal_blocks().astype(np.float64))
    inverse = np.divide(1.0, vertex, out=np.zeros(len(vertex)), where=vertex > 0)
    s, bound = np.sqrt(inverse), np.inf
    for _ in range(SWEEPS):
        sums = K.space.counted(own * s)
        K.add_norms(s, sums)
        K.space.share(sums)
        sums *= inverse
        rows = np.divide(sums, s, out=np.zeros(len(s)), where=s > 0)
        bound, s = min(bound, K.space.comm.most(float(rows.max()))), sums
    return bound


def _largest_of_blocks(blocks: Array) -> Array:
    """Return upper bounds (nv,) on the eigenvalues of symmetric blocks (nv, d, d), by traces (Wolkowicz, Styan 1980).

    They are exact for d < 3.
    """
    d = blocks.shape[1]
    mean = np.einsum("vcc->v", blocks) / d
    spread = np.einsum("vij,vij->v", blocks, blocks) - d * mean**2
    return np.maximum(mean + np.sqrt(np.maximum(spread, 0) * (d - 1) / d), 0)


def _combined(factors: Sequence[float], vectors: Sequence[Array]) -> Array:
    return np.einsum("i,ij->j", factors, np.stack(vectors))
