"""Checks of a user's time integrator on bodies with a known motion."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from ..arguments import Array, flag, number, whole
from ..errors import StvkError
from ..mesh import ElementMesh
from ..system import System
from ..terms import StVK
from .case import NEARBY
from .implementations import ContractViolation, Implementation, guarded
from .manufactured import fitted_order
from .report import Report, judge
from .results import CheckOutcome, Explanation, Naming, Task, largest

#: Young's moduli of the two bodies [Pa]. Each is a bar of length 1.3 m and section 2e-4 m^2 with half of its mass at each end.
YOUNG = {"soft": 1e4, "stiff": 1e10}
LENGTH, SECTION = 1.3, 2e-4
#: Length of the motion for fitted orders and drifts, in periods, and numbers of time steps.
PERIODS, STEPS = 1.5, (60, 120, 240)
#: Allowed distance of a fitted order from the claimed order or a whole number, and drift that counts as zero.
SLACK, NO_DRIFT = 0.25, 1e-9
#: Values of `omega dt` that are tried, amplitude of the vibration over the length, and growth per step that counts as zero.
SCAN, AMPLITUDE, NO_GROWTH = np.geomspace(0.05, 1e3, 40), 1e-4, 1e-6
#: Precision to which Newmark's beta is identified.
EXACT = 1e-3
QUANTITIES = ("energy", "linear momentum", "angular momentum")

Step = Callable[[System, Array, Array, float], Any]


def verify_integrator(
    step: Step,
    *,
    density: float = 1000.0,
    order: int | None = None,
    conserves: Sequence[str] = ("linear momentum",),
    stable: float | None = None,
    quiet: bool = False,
) -> Report:
    """Check a time integrator on a soft and a stiff body of two masses and a spring, whose motion is known.

    The spring is a bar with the energy of St. Venant-Kirchhoff. It rotates, vibrates by 15 % and drifts. The relative motion is
    that of a point in a central field, an ordinary differential equation that is solved to 13 digits.

    - memory: the same arguments give the same result, whatever calls were made in between. A cached force would be stale.
    - order: the error at the end falls with the claimed order, or, without a claim, with a whole order from 1 on.
    - drift: the quantities in `conserves` (energy, linear and angular momentum) do not drift. Drifts of the others fall with the
      step, which they do not if there is damping.
    - stability limit: small vibrations do not grow up to `omega dt = stable`. Without a claim the check goes up to 0.05, and the
      measured limit is reported.

    If a check fails, `named` gives the repair of the step that passes all checks, if there is one. A repair changes the size of the
    force or of the time step, or the state at which a force or velocity is taken. Both sizes are measured, on small vibrations and
    on a drift.

    Parameters
    ----------
    step
        Function `step(system, u, v, dt)` that returns displacements and velocities (ndofs,) at a time `dt` later, for `M v' + F(u)
        = 0`. `system.internal_force(u)` is F [N], `system.tangent(u)` is its derivative, and `system.mass()` is the lumped M, with
        `solve(f)` and `multiply(v)`. The body is free in space, without loads and supports. The result may depend on the arguments
        alone.
    density
        Density of the bar [kg/m^3].
    order
        The claimed order; None if there is no claim. The report states the fitted order.
    conserves
        The quantities that are claimed to be conserved: "energy", "linear momentum", "angular momentum".
    stable
        The claimed limit of `omega dt`: 2 for central differences, 1000 for integrators without a limit.
    quiet
        Whether to hide the progress bar.

    Returns
    -------
    Report
        Use `report.passed`, `print(report)` and `report.save("folder")`.

    Raises
    ------
    StvkError
        if `step` cannot be called, or a claim is out of range.

    Examples
    --------
    >>> def verlet(system, u, v, dt):
    ...     M = system.mass()
    ...     v = v - dt / 2 * M.solve(system.internal_force(u))
    ...     u = u + dt * v
    ...     return u, v - dt / 2 * M.solve(system.internal_force(u))
    >>> verify_integrator(verlet, order=2, conserves=("linear momentum", "angular momentum"), stable=2.0, quiet=True).passed
    True
    """
    if not callable(step):
        raise StvkError(f"step is a {type(step).__name__}; expected a function step(system, u, v, dt) -> (u, v).")
    density = number("density", density, "a density in kg/m^3, a positive number", low=0.0)
    claimed = None if order is None else whole("order", order, "a whole number from 1, or None", least=1, most=12)
    limit = None if stable is None else number("stable", stable, "a positive omega dt up to 1000", low=0.0, high=1e3, closed=True)
    if isinstance(conserves, str) or not set(conserves) <= set(QUANTITIES):
        raise StvkError(f"conserves = {conserves!r}; expected a sequence of {', '.join(map(repr, QUANTITIES))}.")
    quiet = flag("quiet", quiet)
    lines = [
        f"integrator: {getattr(step, '__name__', type(step).__name__)}(system, u, v, dt)",
        f"claims: order {claimed or 'none'}, conserves {', '.join(conserves) or 'nothing'}, "
        f"stable up to omega dt = {'no claim' if limit is None else f'{limit:g}'}",
    ]
    claims = claimed, conserves, limit
    return judge(
        "verify integrator", {"lines": lines}, list(_tasks(step, density, *claims)), quiet, partial(_explain, step, density, claims)
    )


def _tasks(step: Step, density: float, order: int | None, conserves: Sequence[str], stable: float | None) -> Iterator[Task]:
    """Yield the tasks of both bodies."""
    for name, young in YOUNG.items():
        body = _Body(step, young, density)
        task = partial(Task, implementation=body.implementation, needs="", state=name)
        yield task("memory", quantity="u, v", measure=partial(_memory, body))
        yield task("order", quantity="u, v", measure=partial(_order, body, order))
        for quantity in QUANTITIES:
            yield task("drift", quantity=quantity, measure=partial(_drift, body, quantity, quantity in conserves))
        yield task("stability limit", quantity="omega dt", measure=partial(_stability, body, stable))


class _Body:
    """Two masses and a bar in space, with their known motion and the integrator under test."""

    def __init__(self, step: Step, young: float, density: float) -> None:
        self.step, self.implementation = step, Implementation("integrator", None, 6)
        along = np.array([2.0, -1.0, 2.0]) / 3
        self.X = np.stack([np.zeros(3), LENGTH * along])
        mesh = ElementMesh(np.ascontiguousarray(self.X.T), np.array([[0], [1]]))
        self.system = System(mesh, StVK(young=young, area=SECTION, density=density))
        self.m = density * SECTION * LENGTH / 2
        self.omega = float(np.sqrt(2 * young * SECTION / (LENGTH * self.m)))
        across = np.array([1.0, 2.0, 0.0]) / np.sqrt(5)
        #: Initial relative position and velocity, and the velocity of the centre.
        self.r, self.rate = 1.15 * LENGTH * along, 0.6 * self.omega * LENGTH * across
        self.drift = 0.2 * self.omega * LENGTH * np.array([0.3, -0.5, 0.8])
        self.until = PERIODS * 2 * np.pi / self.omega
        self._runs: dict[int, tuple[Array, Array]] = {}

    def state(self, t: float) -> tuple[Array, Array]:
        """Return the exact `u` and `v` (6,) at time `t`."""
        r, rate = self.r, self.rate
        if t > 0:

            def motion(_: float, y: Array) -> Array:
                r = y[:3]
                return np.concatenate([y[3:], -(self.omega**2) / 2 * (r @ r / LENGTH**2 - 1) * r])

            found = solve_ivp(motion, (0, t), np.concatenate([r, rate]), method="DOP853", rtol=1e-13, atol=1e-15 * self.omega)
            r, rate = found.y[:3, -1], found.y[3:, -1]
        centre = self.X.mean(axis=0) + self.drift * t
        x = np.stack([centre - r / 2, centre + r / 2])
        return (x - self.X).ravel(), np.concatenate([self.drift - rate / 2, self.drift + rate / 2])

    def step_once(self, u: Array, v: Array, dt: float) -> tuple[Array, Array]:
        """Return one step of the integrator, called with copies.

        Raise `ContractViolation` if the result does not have the right form.
        """
        found = guarded("step", lambda: self.step(self.system, u.copy(), v.copy(), dt))
        pair = guarded("The result of step", lambda: [np.array(array) for array in found])
        if len(pair) != 2 or any(array.shape != (6,) or array.dtype.kind not in "fiu" for array in pair):
            arrays = ", ".join(f"{array.shape} of {array.dtype}" for array in pair)
            raise ContractViolation(f"step returned {arrays}; expected u and v, two arrays of 6 real numbers.")
        return pair[0].astype(float), pair[1].astype(float)

    def run(self, steps: int) -> tuple[Array, Array]:
        """Return displacements and velocities (steps + 1, 6), including the initial state. They are computed once."""
        if steps not in self._runs:
            states = [self.state(0.0)]
            for _ in range(steps):
                states.append(self.step_once(*states[-1], self.until / steps))
            us, vs = zip(*states, strict=True)
            self._runs[steps] = np.array(us), np.array(vs)
        return self._runs[steps]

    def drifts(self, quantity: str, steps: int) -> float:
        """Return the largest change of a conserved quantity, relative to its scale."""
        u, v = self.run(steps)
        x, V = (u.reshape(-1, 2, 3) + self.X), v.reshape(-1, 2, 3)
        if quantity == "energy":
            kinetic = self.m / 2 * (v**2).sum(axis=1)
            values = kinetic + np.array([self.system.energy(one) if np.isfinite(one).all() else np.nan for one in u])
            scale = float(kinetic[0])
        elif quantity == "linear momentum":
            values, scale = self.m * V.sum(axis=1), float(self.m * np.abs(V[0]).sum())
        else:
            each = self.m * np.cross(x, V)
            values, scale = each.sum(axis=1), float(np.abs(each[0]).sum())
        return float(np.abs(values - values[0]).max() / scale)


def _memory(body: _Body) -> dict[str, Any]:
    """Compare steps with the same steps after a step from a distant state, and after one that begins or ends nearby."""
    u, v = body.state(0.0)
    far, dt, off = body.state(body.until / 3), body.until / STEPS[0], []
    moved = body.step_once(u, v, dt)[0]
    for start, between in ((u, far[0]), ((1 + NEARBY) * u, u), ((1 + NEARBY) * moved, u)):
        body.step_once(*far, dt)
        first = np.concatenate(body.step_once(start, v, dt))
        body.step_once(*far, dt)
        body.step_once(between, v, dt)
        size = np.repeat([np.abs(first[:6]).max(), np.abs(first[6:]).max()], 6)
        off.append(np.abs((np.concatenate(body.step_once(start, v, dt)) - first) / size).max())
    reason = "the same arguments must give the same step; if not, a force or state of an earlier call is cached and stale"
    return {"measured": float(np.max(off)), "limit": 1e-12, "scale": f"{size[0]:.3e} (largest displacement)", "reason": reason}


def _order(body: _Body, claimed: int | None) -> dict[str, Any]:
    u, v = body.state(body.until)
    errors = []
    for steps in STEPS:
        us, vs = body.run(steps)
        errors.append(float(np.hypot(np.linalg.norm(us[-1] - u), np.linalg.norm(vs[-1] - v) / body.omega) / LENGTH))
    values = " -> ".join(f"{error:.1e}" for error in errors)
    if not np.isfinite(errors).all() or min(errors) == 0:
        return {"measured": np.nan, "limit": SLACK, "scale": f"order; errors {values}", "reason": "the motion is not finite"}
    order = float(np.log2(errors[-2] / errors[-1]))
    expected = claimed or max(round(order), 1)
    why = "a whole order; order 0 means wrong masses, or a force of the wrong sign or size" if claimed is None else (
        "the claimed order; one order less usually means a force or velocity at the wrong end of the step, or at one end only"
    )  # fmt: skip
    scale = f"order {expected}; fitted {order:.2f}, errors {values} of the length"
    return {
        "measured": max(expected - order, 0.0) if claimed else abs(expected - order),
        "limit": SLACK,
        "scale": scale,
        "reason": why,
    }


def _drift(body: _Body, quantity: str, claimed: bool) -> dict[str, Any]:
    drifts = [body.drifts(quantity, steps) for steps in STEPS]
    values = " -> ".join(f"{drift:.1e}" for drift in drifts)
    if claimed or max(drifts) <= NO_DRIFT:
        reason = "claimed to be conserved" if claimed else "no drift"
        return {
            "measured": float(np.max(drifts)),
            "limit": NO_DRIFT,
            "scale": f"initial magnitude; drifts {values}",
            "reason": reason,
        }
    order = fitted_order(1 / np.array(STEPS), drifts)
    reason = "a drift that does not decrease with the step means damping, or a force that is not the derivative of the energy"
    scale = f"order 1 at least; fitted {order:.2f}, drifts {values}"
    return {"measured": np.maximum(1 - order, 0.0), "limit": SLACK, "scale": scale, "reason": reason}


def _growth(body: _Body, omega_dt: float) -> float:
    """Return the spectral radius of the step of small vibrations along the bar, minus 1."""
    A = _amplification(body, omega_dt)
    return float(np.abs(np.linalg.eigvals(A)).max() - 1) if np.isfinite(A).all() else np.inf


def _amplification(body: _Body, omega_dt: float) -> Array:
    """Return the amplification matrix (2, 2) of small vibrations along the bar, for `u` and `v / omega`.

    Central differences, with both signs of the amplitude, cancel the even terms.
    """
    along = np.concatenate([-body.r, body.r]) / np.linalg.norm(body.r) / np.sqrt(2)
    dt, eps = omega_dt / body.omega, AMPLITUDE * LENGTH
    A = np.zeros((2, 2))
    for column, (a, b) in enumerate(((eps, 0.0), (0.0, eps * body.omega))):
        (u, v), (w, z) = (body.step_once(sign * a * along, sign * b * along, dt) for sign in (1, -1))
        A[:, column] = (u - w) @ along / (2 * eps), (v - z) @ along / (2 * eps * body.omega)
    return A


def _stability(body: _Body, claimed: float | None) -> dict[str, Any]:
    tried = [
        float(SCAN[0]),
        *(float(x) for x in SCAN[1:] if claimed is None or x < claimed),
        *([0.99 * claimed] if claimed else []),
    ]
    stable_limit = 0.0
    growth = {omega_dt: _growth(body, omega_dt) for omega_dt in tried}
    for below, above in pairwise([0.0, *tried]):
        if growth[above] > NO_GROWTH:
            stable_limit = below
            break
        stable_limit = above
    worst = (
        max(growth[x] for x in tried if x <= (claimed or SCAN[0])) if claimed is None or claimed > SCAN[0] else growth[tried[-1]]
    )
    reason = "small vibrations must not grow; growth at every step size means explicit Euler, or a force of the wrong sign"
    scale = f"amplification per step, less 1, up to omega dt = {claimed or SCAN[0]:g}; stable up to {stable_limit:.3g} at least"
    return {"measured": max(worst, 0.0), "limit": NO_GROWTH, "scale": scale, "reason": reason}


def _explain(step: Step, density: float, claims: tuple[int | None, Sequence[str], float | None], report: Report) -> None:
    """Name the repairs of the step that make it pass every check."""
    failures = report.failures()
    if not failures:
        return
    naming, soft = Naming(before=largest(failures)), _Body(step, YOUNG["soft"], density)

    def repaired() -> Iterator[Explanation]:
        for (name, words), repair in (*_repairs_of_size(step, soft), *_REPAIRS_OF_STATE.items()):
            results = [task.run() for task in _tasks(partial(repair, step), density, *claims)]
            passed = all(result.outcome is CheckOutcome.PASSED for result in results)
            yield Explanation(name, words, largest(results) if passed else np.inf)

    with suppress(ContractViolation, np.linalg.LinAlgError):  # no repair is known for a step that cannot be measured
        naming.explain(repaired())
    if not naming.explanations and any(result.check == "stability limit" for result in failures):
        naming.explain(_newmark_beta(soft))
    if not naming.explanations:
        least = {result.check: result.reason for result in failures}
        naming.smallest = " ".join(f"By {check}: {reason}." for check, reason in least.items())
    report.named = naming


Repair = Callable[[Step, System, Array, Array, float], Any]


class _ScaledSystem:
    """System whose energy, forces and tangent are multiplied by a factor."""

    def __init__(self, system: System, factor: float) -> None:
        self._system, self._factor = system, factor

    def __getattr__(self, name: str) -> Any:
        return getattr(self._system, name)

    def energy(self, u: Array) -> float:
        return self._factor * self._system.energy(u)

    def internal_force(self, u: Array) -> Array:
        return self._factor * self._system.internal_force(u)

    def tangent(self, u: Array) -> Any:
        return self._factor * self._system.tangent(u)


def _repairs_of_size(step: Step, body: _Body) -> Iterator[tuple[tuple[str, str], Repair]]:
    """Yield repairs of the size of the time step and of the force.

    The time step is measured by the path of a drifting body, the force by the frequency of small vibrations at small steps.
    """
    dt = 0.02 / body.omega
    drift = np.tile(body.drift, 2)
    moved, _ = body.step_once(np.zeros(6), drift, dt)
    b = float(moved @ drift / (drift @ drift) / dt)
    if abs(b - 1) > 1e-3 and np.isfinite(b) and abs(b) > 1e-3:

        def of_another_time(step: Step, system: System, u: Array, v: Array, dt: float) -> Any:
            return step(system, u, v, dt / b)

        yield (f"dt x {b:.3f}", f"a free body moves by {b:.3f} dt in one step"), of_another_time
    coarse, fine = (_stiffness(body, omega_dt) for omega_dt in (0.04, 0.02))
    c = (4 * fine - coarse) / 3
    if abs(c - 1) > 1e-3 and np.isfinite(c) and abs(c) > 1e-3:

        def of_another_force(step: Step, system: System, u: Array, v: Array, dt: float) -> Any:
            return step(_ScaledSystem(system, 1 / c), u, v, dt)  # type: ignore[arg-type]  # a stand-in

        words = f"the force is {c:.3f} x the correct one, or the mass {1 / c:.3f} x"
        words += " (3 x: the consistent mass in place of the lumped one)" if abs(c - 3) < 1e-2 else ""
        yield (f"force x {c:.3f}", words if c > 0 else "the force has the wrong sign"), of_another_force


def _stiffness(body: _Body, omega_dt: float) -> float:
    """Return the square of the observed frequency over `omega^2`. It is negative if small vibrations grow exponentially."""
    A = _amplification(body, omega_dt)
    if not np.isfinite(A).all():
        return np.nan
    angles = np.log(np.linalg.eigvals(A).astype(complex)) / omega_dt
    return float(((angles[0] - angles[1]) ** 2).real / -4)


def _newmark_beta(body: _Body) -> Iterator[Explanation]:
    """Yield Newmark's beta of an implicit step with gamma = 1/2.

    For such a step, `cos(theta) = 1 - x^2/2 / (1 + beta x^2)` with `x = omega dt`.
    """
    found = []
    for x in (0.5, 1.0):
        A = _amplification(body, x)
        if not (np.isfinite(A).all() and abs(np.linalg.det(A) - 1) < EXACT):
            return
        found.append(float(1 / (2 - np.trace(A)) - 1 / x**2))
    beta, off = found[0], abs(found[1] - found[0])
    if off < EXACT and EXACT < beta < 0.25 - EXACT:
        limit = 2 / np.sqrt(1 - 4 * beta)
        words = f"small vibrations follow Newmark's beta = {beta:.4f}, stable up to omega dt = {limit:.3g}; beta = 1/4 has no limit"
        yield Explanation(f"beta = {beta:.3f}", words, off)


def _accelerated(system: System, u: Array) -> Array:
    return -system.mass().solve(system.internal_force(u))


def _with_new_force(step: Step, system: System, u: Array, v: Array, dt: float) -> Any:
    moved, rate = step(system, u, v, dt)
    return moved, rate + dt / 2 * (_accelerated(system, moved) - _accelerated(system, u))


def _with_second_half(step: Step, system: System, u: Array, v: Array, dt: float) -> Any:
    moved, rate = step(system, u, v, dt)
    return moved, rate + dt / 2 * _accelerated(system, moved)


def _with_new_velocity(step: Step, system: System, u: Array, v: Array, dt: float) -> Any:
    moved, rate = step(system, u, v, dt)
    return moved + dt * (rate - v), rate


def _with_first_half(step: Step, system: System, u: Array, v: Array, dt: float) -> Any:
    half_moved, rate = step(system, u, v, dt)
    moved = half_moved + dt**2 / 2 * _accelerated(system, u)
    return moved, rate + dt / 2 * (_accelerated(system, moved) - _accelerated(system, half_moved))


#: Name and words of each repair that takes a force or a velocity at another state.
_REPAIRS_OF_STATE: dict[tuple[str, str], Repair] = {
    (
        "old force",
        "the second half of the velocity update uses the force at the start of the step; expected the force at the end",
    ): _with_new_force,
    ("velocity of the middle", "the returned velocity is the one at the middle of the step"): _with_second_half,
    (
        "old velocity",
        "displacements are updated with the velocity at the start of the step, as in explicit Euler; expected that at the end",
    ): _with_new_velocity,
    ("no dt^2/2 a", "displacements lack dt^2/2 times the acceleration at the start of the step"): _with_first_half,
}
