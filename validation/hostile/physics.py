"""Random legal systems at extreme scales: a success is judged in extended precision by other code, all else says why."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from skfem_stvk import EnergyMomentum, NodalLoad, System, VelocityVerlet, simulate, solve_static
from skfem_stvk.arguments import Array
from skfem_stvk.dynamics import Run, SimulationError
from skfem_stvk.statics import SolveError, StaticResult

from .case import Case, Verdict, Wrong, in_words
from .extreme_bodies import Body, body
from .spokes import Spokes, long

AT_REST, IN_MOTION = 400, 200
#: Of the residual relative to loads and reactions: ten times what `solve_static` asks for.
RESIDUAL = 1e-7
#: Of a motion in double precision from the same steps in extended precision, and of the drift of energy.
MOTION = 1e-7
#: Loads that a body meets, over those that strain it by about 1, and how often.
SIZES = (0.0, 1e-300, 1e-12, 1e-6, 1e-4, 1e-3, 1e-2, 0.1, 1e3, 1e300)
SHARES = (0.04, 0.04, 0.1, 0.15, 0.15, 0.2, 0.15, 0.09, 0.04, 0.04)


def cases() -> Iterator[Case]:
    """Bodies at rest and in motion, by their seeds."""
    for seed in range(AT_REST):
        yield Case(f"at rest, seed {seed}", partial(at_rest, seed), judged_at_rest, refused, quick=seed < 5)
    for seed in range(IN_MOTION):
        yield Case(
            f"in motion, seed {seed}", partial(in_motion, seed), judged_in_motion, refused, seconds=60, quick=seed in (4, 5, 10)
        )


def refused(error: BaseException) -> bool:
    """Errors for bad input, and solves and runs that say why they did not end well."""
    return in_words(error) or (isinstance(error, SolveError | SimulationError) and error.__cause__ is None and len(str(error)) > 20)


class Solved(NamedTuple):
    """A result, and what it was of."""

    body: Body
    result: Any
    load: Array
    held: Array


def at_rest(seed: int, folder: Path) -> Solved:
    """A body that is held at one end, and loaded at some of its vertices: not at all, little, a lot."""
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


def judged_at_rest(solved: Solved) -> None:
    """The judge: finite, in balance, and no element inside out."""
    result: StaticResult = solved.result
    told = "; ".join(solved.body.notes)
    _finite({"u": result.u, "t": result.t}, told)
    _finite({"stress": result.stress("von_mises"), "energies": list(result.energies().values())}, told)
    exact, d = solved.body.exact, solved.body.mesh.d
    F = exact.force(result.u)
    residual = (F - long(solved.load)).ravel()
    balance, scale = residual.copy(), np.concatenate([long(solved.load).ravel(), residual[solved.held]])
    balance[solved.held] = 0
    limit = RESIDUAL * _norm(scale) + _rounding(solved.body, result.u)
    if not _norm(balance) <= limit:
        raise Wrong(Verdict.SILENT, f"a success out of balance: {_norm(balance):.2e} > {limit:.2e}; {told}")
    if exact.mesh.k == d and not (exact.volume_ratios(result.u) > -1e-9).all():
        raise Wrong(Verdict.SILENT, f"a success with elements inside out; {told}")


def in_motion(seed: int, folder: Path) -> Solved:
    """A free body with random velocities, by Verlet's method with the step that is found, or with energy and momenta kept."""
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


def judged_in_motion(solved: Solved) -> None:
    """The judge: finite; the steps of Verlet's method made again in extended precision; of the other, energy and momentum kept."""
    run: Run = solved.result
    told = "; ".join(solved.body.notes)
    _finite({"u": run.u, "v": run.v, "t": run.t, "ledger": run.ledger.rows()}, told)
    exact, d = solved.body.exact, solved.body.mesh.d
    mass, v0 = exact.mass[:, None], long(solved.load).reshape(-1, d)
    if isinstance(run.integrator, VelocityVerlet):
        u, rounded = (_again(exact, mass, v0, run.ledger["time"], error) for error in (0.0, _error_of_forces(exact)))
        error, limit = _norm(long(run.u).reshape(-1, d) - u), MOTION * _norm(u) + 100 * _norm(rounded - u)
        if not error <= limit:
            raise Wrong(Verdict.SILENT, f"u is off by {error:.1e} > {limit:.1e}; {told}")
        return
    v = long(run.v).reshape(-1, d)
    before = (mass * v0**2).sum() / 2
    gained = (mass * v**2).sum() / 2 + exact.energy(run.u) - before
    rounded = 1e2 * abs(exact.energy(_wiggled(run.u)) - exact.energy(run.u)) + _error_of_forces(exact) * exact.energy(run.u)
    said = 2 * np.abs(run.ledger["closure_error"]).max()  # what the ledger says itself is no silence
    if not abs(gained) <= MOTION * before + rounded + said:
        raise Wrong(Verdict.SILENT, f"energy is {gained / before:.1e} of itself too large; {told}")
    lost = _norm((mass * (v - v0)).sum(axis=0))
    said = _norm(np.array([np.ptp(run.ledger[f"linear_momentum_{axis}"]) for axis in "xyz"[:d]]))
    if not lost <= MOTION * _norm(mass * v0) + 2 * said:
        raise Wrong(Verdict.SILENT, f"momentum is off by {lost / _norm(mass * v0):.1e}; {told}")


def _again(exact: Spokes, mass: Array, v: Array, times: Array, error: float) -> Array:
    """u by velocity Verlet, from u = 0; with forces that are off by this part of themselves at random."""
    rng, u, a = np.random.default_rng(0), np.zeros_like(v), np.zeros_like(v)
    for dt in np.diff(long(times)):
        v = v + dt / 2 * a
        u = u + dt * v
        wrong = error * rng.uniform(-1, 1, u.shape) * exact.magnitude(u) if error else 0.0
        a = (wrong - exact.force(u)) / mass
        v = v + dt / 2 * a
    return u


def _finite(values: dict[str, Any], told: str) -> None:
    for name, value in values.items():
        if not np.isfinite(np.ma.filled(value, 0.0)).all():
            raise Wrong(Verdict.SILENT, f"a success with {name} not finite; {told}")


def _rounding(one: Body, u: Array) -> np.longdouble:
    """What rounding leaves of forces: of those that cancel at vertices, of u itself, and of flat elements."""
    exact = one.exact
    wiggle = exact.force(_wiggled(u)) - exact.force(u)
    return 1e3 * _error_of_forces(exact) * _norm(exact.magnitude(u)) + 1e2 * _norm(wiggle)


def _wiggled(u: Array) -> Array:
    """Displacements that are off by rounding."""
    return long(u) * (1 + 1e-16 * np.random.default_rng(0).standard_normal(len(u)))


def _error_of_forces(exact: Spokes) -> float:
    """Part of the forces of elements that the edge form may lose: eps, times the square of the flattest one's aspect ratio, and
    times the ratio of the extreme moduli, which grows without bound as Poisson's ratio nears its limits."""
    flat = np.abs(exact.G).max(axis=(1, 2)) * np.abs(exact.P @ np.swapaxes(exact.P, 1, 2)).max(axis=(1, 2))
    bulk = (exact.mesh.k * exact.lam + 2 * exact.mu) / (2 * exact.mu)
    return float(2.2e-15 * max(1.0, flat.max()) * max(bulk, 1 / bulk))


def _norm(x: Array) -> np.longdouble:
    return np.longdouble(np.sqrt((long(x) ** 2).sum()))
