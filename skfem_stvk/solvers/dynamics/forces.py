"""Forces of a system that occur only in motions: mean forces between two states, and damping forces."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.sparse import csr_matrix

from ...arguments import Array
from ...edges import NONE, Tensions
from ...mesh.displacements import array_to_fill, by_vertex
from ...system import System, TangentOperator
from ...system.operator import refuse_overflow
from ...terms import is_load
from ...terms.loads.load import Assumed, Moment, Time


def add_mean_force(
    system: System,
    u0: Array,
    u1: Array,
    out: Array,
    *,
    weights: tuple[float, float] = (0.5, 0.5),
    theta: float = 0.5,
    t: Time = 0.0,
) -> float:
    """Add the mean force of two states to `out` (ndofs,) [N].

    The mean tensions act along the edges of an intermediate configuration `p`.

        f_a = sum_b t_ab (p_a - p_b)        t = L (w0 zeta(u0) + w1 zeta(u1)),  p = X + (1 - theta) u0 + theta u1

    With `w0 = w1 = theta = 1/2` the work of the force over `u1 - u0` is `W(u1) - W(u0)` to round-off, for any states. Forces and
    torques balance about `p`. Hence energy and momenta are conserved. With other weights of sum 1 the work is larger by
    `(w1 - w0) R`. `R = 1/4 dzeta' L dzeta >= 0` with `dzeta = zeta(u1) - zeta(u0)`, which is zero for rigid motions.

    Laws without edges, such as `NeoHookean`, use a discrete gradient of their energy instead (`kernels.discrete_gradient`), with
    the same work. A term without a mean force, such as a `VolumePenalty`, adds `(w0 + w1)` times its force at `p` and nothing to R.
    The work of that force is the difference of its energies to second order only; for foundations it is exact. Returns R [J].

    >>> import skfem
    >>> from skfem_stvk import StVK, System
    >>> body = System(skfem.MeshTet().refined(2), StVK(young=1e5, poisson=0.3))
    >>> rng, force = np.random.default_rng(0), np.zeros(body.ndofs)
    >>> u0, u1 = rng.normal(size=(2, body.ndofs))
    >>> R = add_mean_force(body, u0, u1, force)
    >>> bool(abs(force @ (u1 - u0) / (body.energy(u1) - body.energy(u0)) - 1) < 1e-12)
    True
    """

    def add(x: Array, y: Array, force: Array) -> float:
        R = 0.0
        for term in system.terms_at(t):
            R += term.mean_force(x, y, weights, theta, force)
        return R

    return _combined(system, {"u0": u0, "u1": u1}, add, out, "The energy of the change", "the mean force")


def add_damping_force(system: System, u: Array, v: Array, out: Array) -> float:
    """Add the resistance of the edges to the rate of their squared elongations to `out` (ndofs,).

    The velocities are `v` (ndofs,) [m/s].

        f_a = sum_b t_ab (p_a - p_b)        t = L dzeta/dt,  dzeta_ab/dt = 2 (p_a - p_b) . (v_a - v_b)

    Multiplied by a relaxation time tau [s], it is the force `tau K_GN(u) v`, with the Gauss-Newton tangent `K_GN = 2 J' L J`. It
    dissipates the power `2 tau R` with Rayleigh's function `R = 1/4 dzeta/dt' L dzeta/dt >= 0`. The resistance is the derivative of
    R by `v`. Rigid motions meet no resistance, including rotations of a body that has rotated far. `LinearElastic` is the
    exception: it adds `K v`. Terms that cannot be damped, such as foundations and volume penalties, add nothing.
    Returns R [J/s^2].
    """

    def add(y: Array, x: Array, force: Array) -> float:
        return sum(term.damping_force(x, y, force) for term in system.bound_terms if term.damped)

    return _combined(system, {"v": v, "u": u}, add, out, "The damping", "the damping force")


def add_secant_damping(system: System, u0: Array, u1: Array, theta: float, out: Array) -> float:
    """Add the resistance of the edges to the whole change from `u0` to `u1`, instead of to the rate as in `add_damping_force`.

        f_a = sum_b t_ab (p_a - p_b)        t = L (zeta(u1) - zeta(u0)),  p = X + (1 - theta) u0 + theta u1

    Multiplied by `tau/dt`, it is a force. For `theta = 1/2` its work over `u1 - u0` is exactly `2 R`,
    `R = 1/4 dzeta' L dzeta >= 0`. R is zero for rigid motions of any size, including rotations. Returns R [J].
    """
    edges = [term for term in system.bound_terms if term.has_mean_force and term.damped]

    def add(x: Array, y: Array, force: Array) -> float:
        return sum(term.mean_force(x, y, (-1.0, 1.0), theta, force) for term in edges)

    return _combined(system, {"u0": u0, "u1": u1}, add, out, "The damping", "the damping force")


def _combined(
    system: System, states: dict[str, Array], add: Callable[[Array, Array, Array], float], out: Array, energy: str, force: str
) -> float:
    """Call `add(x, y, out)` for two states, by name, in each part of a divided body. Return the sum of its results.

    Forces at shared nodes are added up in `out`, which must be zero before in a divided body. Messages about an overflow name the
    `energy` and the `force`, and have the largest displacement of the second state.
    """
    total = array_to_fill(system.mesh, out)

    def of_part() -> float:
        x, y = (by_vertex(system.mesh, u, name) for name, u in states.items())
        R = float(add(x, y, total))
        refuse_overflow(R, energy, y)
        refuse_overflow(total, f"out, with {force} added,", y)
        return R

    R = system.space.comm.sum_of(of_part)
    system.space.share(total)
    return R


def damped_beside_edges(system: System) -> list[str]:
    """Return the names of the terms, other than laws on edges, in the Gauss-Newton tangent: `tau K_GN` damps them, too."""
    elastic, loads = iter(system.bound_terms), iter(system.bound_loads)
    bound: list[tuple[Any, Any]] = [(term, next(loads if is_load(term) else elastic)) for term in system.terms]
    return [type(term).__name__ for term, one in bound if not (one.dead if is_load(term) else one.damped)]


def passes_inversion(system: System) -> bool:
    """Return whether all elements have finite restoring forces when they are inverted."""
    return all(term.passes_inversion for *_, term in system.on_elements)


class StartTensions:
    """Part of the tangent due to the tensions at the beginning of a step, `sum t_i(u_0) Lap_i`, computed at the first request.

    It is the difference of two tangents at `u_0`: one with the retained tensions, one without tensions. Contacts have none.
    """

    def __init__(self, system: System) -> None:
        self._system, self._u0 = system, np.zeros(system.ndofs)
        self._matrices: list[csr_matrix | None] = [None, None]
        self._version = system.pattern_version  # of the matrices
        self._operators: list[TangentOperator] = []
        self._matrices_for: Tensions | None = None
        self._operators_for: Tensions | None = None

    def begin(self, u0: Array) -> None:
        """Begin a step from `u0` (ndofs,)."""
        np.copyto(self._u0, u0)
        self._matrices_for = self._operators_for = None

    def values(self, t: Time, retained: Tensions) -> Array:
        """Return the values of a matrix of the system's pattern, with the tensions that `retained` retains."""
        difference, without = self._matrices
        if self._version != self._system.pattern_version:
            difference, without, self._version = None, None, self._system.pattern_version
        if self._matrices_for != retained or difference is None:
            apart = Moment.of(t).assuming(Assumed.APART)
            difference = self._system.jacobian(self._u0, apart, out=difference, kept=retained)
            without = self._system.jacobian(self._u0, apart, out=without, kept=NONE)
            difference.data -= without.data
            self._matrices, self._matrices_for = [difference, without], retained
        values: Array = difference.data
        return values

    def operators(self, t: Time, retained: Tensions) -> list[tuple[float, TangentOperator]]:
        """Return factors and operators, in the form that `TangentOperator.scale_and_add` takes."""
        apart = Moment.of(t).assuming(Assumed.APART)
        if not self._operators:
            self._operators = [self._system.linear_operator(self._u0, kept=which, t=apart) for which in (retained, NONE)]
        elif self._operators_for != retained:
            for operator, which in zip(self._operators, (retained, NONE), strict=True):
                operator.prepare(self._u0, kept=which, t=apart)
        self._operators_for = retained
        return list(zip((1.0, -1.0), self._operators, strict=True))
