"""Random legal systems at extreme scales: independent code in extended precision judges a success; a failure states its reason."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from skfem_stvk import EnergyMomentum, NodalLoad, System, VelocityVerlet, simulate, solve_static
from skfem_stvk.arguments import Array
from skfem_stvk.solvers.dynamics import Run, SimulationError
from skfem_stvk.solvers.statics import SolveError, StaticResult

from .case import Case, Verdict, Wrong, is_readable
from .extended_stvk import ExtendedStVK, long
from .extreme_bodies import Body, body

AT_REST, IN_MOTION = 400, 200
#: Limit of the residual relative to loads and reactions: ten times the tolerance of `solve_static`.
RESIDUAL = 1e-7
#: Limit of the difference of a motion from the same steps in extended precision, and of the drift of energy.
MOTION = 1e-7
#: Loads, relative to those that cause strains of about 1, and their probabilities.
SIZES = (0.0, 1e-300, 1e-12, 1e-6, 1e-4, 1e-3, 1e-2, 0.1, 1e3, 1e300)
SHARES = (0.04, 0.04, 0.1, 0.15, 0.15, 0.2, 0.15, 0.09, 0.04, 0.04)


def cases() -> Iterator[Case]:
    """Yield bodies at rest and in motion, one for each seed."""
    for seed in range(AT_REST):
        yield Case(f"at rest, seed {seed}", partial(at_rest, seed), judge_at_rest, refused, quick=seed < 5)
    for seed in range(IN_MOTION):
        yield Case(
            f"in motion, seed {seed}", partial(in_motion, seed), judge_in_motion, refused, seconds=60, quick=seed in (4, 5, 10)
        )


def refused(error: BaseException) -> bool:
    """Return whether an error is readable: an error for bad input, or a failed solve or run that states its reason."""
    return is_readable(error) or (
        isinstance(error, SolveError | SimulationError) and error.__cause__ is None and len(str(error)) > 20
    )


class Solved(NamedTuple):
    """Result with its body, its load or initial velocities, and the constrained degrees of freedom."""

    body: Body
    result: Any
    load: Array
    constrained: Array


def at_rest(seed: int, folder: Path) -> Solved:
    """Solve a body that is constrained at one end, with a load of random size on some of its vertices."""
    rng = np.random.default_rng(seed)
    one = body(rng)
    x = one.mesh.p[0]
    wall = np.flatnonzero(x <= np.quantile(x, 0.3))
    loaded = np.flatnonzero(x >= np.quantile(x, 0.7))
    size = float(rng.choice(SIZES, p=SHARES))
    with np.errstate(all="ignore"):
        values = size * one.force * rng.standard_normal((one.mesh.d, len(loaded)))
    one.notes.append(f"load {size:g}")
    moved = {"x": float(size * one.unit)} if rng.random() < 0.2 else {}
    free = np.setdiff1d(loaded, wall)
    system = System(
        one.mesh,
        [one.term, NodalLoad(loaded, values)],
        fixed=[(wall, "xyz"[: one.mesh.d])],
        prescribed=[(free[:1], moved)] if moved and len(free) else None,
    )
    result = solve_static(system, steps=int(rng.integers(1, 5)), quiet=True)
    load = np.zeros((one.mesh.nv, one.mesh.d))
    load[loaded] = values.T
    return Solved(one, result, load, system.supports.held)


def judge_at_rest(solved: Solved) -> None:
    """Raise `Wrong` unless the result is finite and in equilibrium, and no element is inverted."""
    result: StaticResult = solved.result
    notes = "; ".join(solved.body.notes)
    _finite({"u": result.u, "t": result.t}, notes)
    _finite({"stress": result.stress("von_mises"), "energies": list(result.energies().values())}, notes)
    exact, d = solved.body.exact, solved.body.mesh.d
    F = exact.force(result.u)
    residual = (F - long(solved.load)).ravel()
    balance, scale = residual.copy(), np.concatenate([long(solved.load).ravel(), residual[solved.constrained]])
    balance[solved.constrained] = 0
    limit = RESIDUAL * _norm(scale) + _rounding(solved.body, result.u)
    if not _norm(balance) <= limit:
        raise Wrong(Verdict.SILENT, f"a success that is not in equilibrium: {_norm(balance):.2e} > {limit:.2e}; {notes}")
    if exact.mesh.k == d and not (exact.volume_ratios(result.u) > -1e-9).all():
        raise Wrong(Verdict.SILENT, f"a success with inverted elements; {notes}")


def in_motion(seed: int, folder: Path) -> Solved:
    """Simulate a free body with random velocities, by velocity Verlet with automatic steps, or by the energy-momentum method."""
    rng = np.random.default_rng([1, seed])
    one = body(rng)
    speed = float(rng.choice([0.0, 1e-200, 1e-6, 1e-2, 0.1, 1.0, 1e3, 1e200], p=[0.05, 0.05, 0.2, 0.2, 0.2, 0.1, 0.1, 0.1]))
    one.notes.append(f"speed {speed:g}")
    with np.errstate(all="ignore"):
        v0 = (speed * one.unit / one.time * rng.standard_normal(one.mesh.p.T.shape)).ravel()
    explicit = bool(rng.random() < 0.6)
    integrator = VelocityVerlet() if explicit else EnergyMomentum(dt=0.02 * one.time)
    stiff = float((one.exact.lam + 2 * one.exact.mu) / long(one.pressure)) if explicit else 1.0  # makes waves faster
    run = simulate(System(one.mesh, one.term), integrator, until=0.2 * one.time / stiff**0.5, v0=v0, quiet=True)
    return Solved(one, run, v0, np.empty(0, dtype=np.int64))


def judge_in_motion(solved: Solved) -> None:
    """Raise `Wrong` unless the motion is finite and correct.

    For velocity Verlet, the same steps are repeated in extended precision. For the energy-momentum method, energy and momentum must
    be conserved.
    """
    run: Run = solved.result
    notes = "; ".join(solved.body.notes)
    _finite({"u": run.u, "v": run.v, "t": run.t, "ledger": run.ledger.rows()}, notes)
    exact, d = solved.body.exact, solved.body.mesh.d
    mass, v0 = exact.mass[:, None], long(solved.load).reshape(-1, d)
    if isinstance(run.integrator, VelocityVerlet):
        u, rounded = (_again(exact, mass, v0, run.ledger["time"], error) for error in (0.0, _error_of_forces(exact)))
        error, limit = _norm(long(run.u).reshape(-1, d) - u), MOTION * _norm(u) + 100 * _norm(rounded - u)
        if not error <= limit:
            raise Wrong(Verdict.SILENT, f"error of u = {error:.1e}; expected at most {limit:.1e}; {notes}")
        return
    v = long(run.v).reshape(-1, d)
    before = (mass * v0**2).sum() / 2
    gained = (mass * v**2).sum() / 2 + exact.energy(run.u) - before
    rounded = 1e2 * abs(exact.energy(_perturbed(run.u)) - exact.energy(run.u)) + _error_of_forces(exact) * exact.energy(run.u)
    reported = 2 * np.abs(run.ledger["closure_error"]).max()  # an error that the ledger reports is not silent
    if not abs(gained) <= MOTION * before + rounded + reported:
        raise Wrong(Verdict.SILENT, f"relative error of the energy = {gained / before:.1e}; {notes}")
    lost = _norm((mass * (v - v0)).sum(axis=0))
    reported = _norm(np.array([np.ptp(run.ledger[f"linear_momentum_{axis}"]) for axis in "xyz"[:d]]))
    if not lost <= MOTION * _norm(mass * v0) + 2 * reported:
        raise Wrong(Verdict.SILENT, f"relative error of the momentum = {lost / _norm(mass * v0):.1e}; {notes}")


def _again(exact: ExtendedStVK, mass: Array, v: Array, times: Array, error: float) -> Array:
    """Return u by velocity Verlet from u = 0. The forces have random relative errors of size `error`."""
    rng, u, a = np.random.default_rng(0), np.zeros_like(v), np.zeros_like(v)
    for dt in np.diff(long(times)):
        v = v + dt / 2 * a
        u = u + dt * v
        wrong = error * rng.uniform(-1, 1, u.shape) * exact.magnitude(u) if error else 0.0
        a = (wrong - exact.force(u)) / mass
        v = v + dt / 2 * a
    return u


def _finite(values: dict[str, Any], notes: str) -> None:
    for name, value in values.items():
        if not np.isfinite(np.ma.filled(value, 0.0)).all():
            raise Wrong(Verdict.SILENT, f"a success with {name} not finite; {notes}")


def _rounding(one: Body, u: Array) -> np.longdouble:
    """Return a bound of the round-off of the forces: from cancellation at vertices, from rounding of u, and from flat elements."""
    exact = one.exact
    change = exact.force(_perturbed(u)) - exact.force(u)
    return 1e3 * _error_of_forces(exact) * _norm(exact.magnitude(u)) + 1e2 * _norm(change)


def _perturbed(u: Array) -> Array:
    """Return displacements with random relative errors of about one rounding."""
    return long(u) * (1 + 1e-16 * np.random.default_rng(0).standard_normal(len(u)))


def _error_of_forces(exact: ExtendedStVK) -> float:
    """Return the relative error of element forces that the edge form may have.

    The error is eps times the square of the aspect ratio of the flattest element, times the ratio of the extreme moduli. The ratio
    of the moduli is unbounded as Poisson's ratio approaches its limits.
    """
    flat = np.abs(exact.G).max(axis=(1, 2)) * np.abs(exact.P @ np.swapaxes(exact.P, 1, 2)).max(axis=(1, 2))
    bulk = (exact.mesh.k * exact.lam + 2 * exact.mu) / (2 * exact.mu)
    return float(2.2e-15 * max(1.0, flat.max()) * max(bulk, 1 / bulk))


def _norm(x: Array) -> np.longdouble:
    return np.longdouble(np.sqrt((long(x) ** 2).sum()))
