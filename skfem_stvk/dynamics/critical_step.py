"""The largest step that explicit integrators can take."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..edges import ALL, Tensions
from ..system import System, TangentOperator
from ..system.system import checked_system
from ..terms.load import Moment
from .damping import Damping, damping_factors
from .largest import bound_on_eigenvalues, largest_eigenvalue

#: Estimates with damping at most, until the step changes by less than this part.
MOST, PRECISION = 6, 1e-4


@dataclass(frozen=True)
class CriticalStep:
    """The largest stable step of central differences (velocity Verlet, symplectic Euler) at a state.

    Attributes
    ----------
    step : from the largest eigenvalue of `M^-1 K` [s].
    bound : a smaller one that is safe [s], from the norms of the blocks of K alone.
    omega, omega_bound : circular frequencies [1/s] without damping, the largest one and what it does not exceed; without damping the steps
        are 2 over them.
    products : of K with a vector, that `step` took.
    """

    step: float
    bound: float
    omega: float
    omega_bound: float
    products: int

    def __str__(self) -> str:
        return f"critical step {self.step:.4g} s, safe bound {self.bound:.4g} s"


class LargestFrequency:
    """Critical steps of a system, again and again as it deforms; nothing but room is kept from one state to the next.

    With lagged velocities in the damping forces, `M a_n + D v_{n-1/2} + F(u_n) = h`, a step `T` is stable as long as

        T^2 x'Kx + 2 T x'Dx <= 4 x'Mx        for all motions x that the supports allow,        D = alpha M + beta K0 + tau K_GN(u)

    which for a damping ratio `xi` is `T <= (2/omega) (sqrt(1 + xi^2) - xi)`: damping makes the step smaller.
    The stiffness of loads that have a potential and are not dead counts by a bound on its own largest eigenvalue.
    `ForwardEuler` is that scheme. `VelocityVerlet` takes damping at a predicted velocity, and has the step of twice the damping.

    Eigenvalues are looked for from a random motion on, always the same: that of the state before would save a fifth of the products, and miss
    what has become the largest one elsewhere.

    Parameters
    ----------
    damping : `Rayleigh`, `EdgeDamping`, or several.
    """

    def __init__(self, system: System, damping: Damping | None = None) -> None:
        checked_system(system)
        self._system, self._mass, self._damping = system, system.mass(), damping_factors(damping)
        self._is_free = np.ones(system.ndofs, dtype=bool)
        self._is_free[system.supports.held] = False
        moving = self._is_free.reshape(-1, system.mesh.d).any(axis=1)
        self._vertex = np.where(moving, self._mass.vertex, 0.0)
        self._operator: TangentOperator | None = None
        self._at_rest: TangentOperator | None = None
        self._products = 0

    def at(self, u: ArrayLike, t: float = 0.0) -> CriticalStep:
        """At displacements `u` (ndofs,) [m]; loads that depend on where the body goes are those at time `t`.

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
        """The safe bound alone [s], for the time of a few products. Errors as of `at`."""
        return self._solve(u, t, self._bound)[1]

    def _solve(self, u: ArrayLike, t: float, elastic: Callable[[TangentOperator], float]) -> tuple[float, float]:
        """The largest `omega^2` without damping, and the step.

        It is where `T^2 lam + 2 T alpha = 4`, with the largest eigenvalue `lam` of `K + 2/T (beta K0 + tau K_GN)`, a convex function of 1/T:
        found by chords from 1/T = 0 on, and in the end shortened by what those have left.
        """
        alpha, beta, tau = self._damping
        loads = self._of_loads(u, t)

        def estimate(K: TangentOperator) -> float:
            return elastic(K) + loads

        square = estimate(self._prepared(u, np.inf))
        step = _root(square, alpha + (beta + tau) * square)
        if beta + tau == 0 or square == 0:
            return square, step
        for _ in range(MOST):
            largest = estimate(self._prepared(u, step))
            before, excess = step, (step**2 * largest + 2 * step * alpha) / 4
            step = _root(square, alpha + max(largest - square, 0.0) * step / 2)
            if abs(step - before) <= PRECISION * step:
                break
        return square, min(step, before / max(excess, 1.0))

    def _prepared(self, u: ArrayLike, step: float) -> TangentOperator:
        """`K + 2/T (beta K0 + tau K_GN)` at `u`: `(1 + c) 2 J'LJ + tensions` is `1 + c` times a K with less of them."""
        more, share = 2 * self._damping.tau / step, 2 * self._damping.beta / step
        kept = Tensions(1 / (1 + more), 1 / (1 + more)) if more else ALL
        if self._operator is None:
            self._operator = self._system.linear_operator(u, kept=kept)
        else:
            self._operator.prepare(u, kept=kept)
        if share and self._at_rest is None:
            self._at_rest = self._system.linear_operator(np.zeros(self._system.ndofs))
        if more or share:
            self._operator.scale_and_add(1 + more, [(share, self._at_rest)] if share and self._at_rest is not None else [])
        return self._operator

    def _of_loads(self, u: ArrayLike, t: float) -> float:
        """What the stiffness of loads adds to the largest eigenvalue at most [1/s^2], by Gershgorin's circles; 0 if they have none."""
        K = self._system.load_stiffness(u, Moment(t, 1.0))
        if K is None:
            return 0.0
        mass = np.repeat(self._mass.vertex, self._system.mesh.d)[self._is_free]
        rows = abs(K[self._is_free][:, self._is_free]) @ (1 / np.sqrt(mass))
        return float((rows / np.sqrt(mass)).max())

    def _bound(self, K: TangentOperator) -> float:
        return bound_on_eigenvalues(K, self._vertex)

    def _largest(self, K: TangentOperator) -> float:
        """Not above the bound, and not below the largest one unless that is farther away than the residual."""
        bound = self._bound(K)
        if bound == 0:
            return 0.0
        mass = np.repeat(self._mass.vertex, self._system.mesh.d)
        x = np.random.default_rng(0).standard_normal(len(mass)) / np.sqrt(np.where(self._is_free, mass, np.inf))
        found = largest_eigenvalue(K.matvec, self._mass, x)
        self._products += found.products
        return min(max(found.value + found.residual, 0.0), bound)


def critical_step(system: System, u: ArrayLike | None = None, *, damping: Damping | None = None) -> CriticalStep:
    """The largest stable step of explicit integrators with the lumped mass, at displacements `u` (ndofs,) [m], by default at rest.

    With `damping` it is that of `ForwardEuler`; for `VelocityVerlet` damping counts twice, and it is that of twice the damping.

    Raises
    ------
    MaterialError
        if a material has no density, or a vertex that can move has no mass.
    StateError
        if `u` does not have one finite entry for each degree of freedom, or K overflows.
    StvkError
        if `damping` is no damping.

    >>> import numpy as np
    >>> from skfem_stvk import SimplexMesh, StVK
    >>> line = SimplexMesh(np.linspace(0, 1, 11)[None], np.stack([np.arange(10), np.arange(1, 11)]))
    >>> bar = System(line, StVK(young=4.0, poisson=0.3, density=1.0))
    >>> critical = critical_step(bar)             # the time that a wave of speed 2 m/s takes through an element of 0.1 m
    >>> round(critical.step, 4), round(critical.bound, 3)
    (0.05, 0.05)
    """
    return LargestFrequency(system, damping).at(np.zeros(system.ndofs) if u is None else u)


def _root(k: float, c: float) -> float:
    """The `T > 0` of `T^2 k + 2 T c = 4`; infinity if there is none."""
    rate = c + np.sqrt(c**2 + 4 * k)
    return float(4 / rate) if rate > 0 else np.inf
