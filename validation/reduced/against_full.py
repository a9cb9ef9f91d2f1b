"""Comparison of a bent and twisted bar on bases of several kinds and sizes with the full bar."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import skfem

from skfem_stvk import (
    EnergyMomentum,
    GeneralizedAlpha,
    Isotropic,
    Newmark,
    ReducedSystem,
    StVK,
    StvkWarning,
    System,
    Traction,
    modes,
    simulate,
    solve_static,
)
from skfem_stvk.arguments import Array
from skfem_stvk.mesh import ElementMesh

from ..study import Study

LENGTH, HEIGHT, WIDTH = 5.0, 1.0, 0.5
MATERIAL = Isotropic(young=1e6, poisson=0.3, density=1e3)
#: Loads on the end in static solves [Pa], one for bending and one for twist. The motion starts under the fraction `PART` of both.
BEND, TWIST, PART = 2500.0, 80e3, 0.5
#: Factors of both loads for the snapshots. The compared state has the factors (1, 1), which are not among them.
SEEN = ((1.0, 0.0), (0.0, 1.0), (0.6, -0.6))
SIZES, QUICK_SIZES = (5, 10, 20, 30, 45), (5, 20)
CELLS, QUICK_CELLS = 4, 2
UNTIL, DT = 4.0, 0.02
PERIODS, QUICK_PERIODS = 30, 5


class Kind(NamedTuple):
    """Kind of a basis: the number of modes as a function of the size, and the use of derivatives and snapshots."""

    name: str
    modes: Any
    derivatives: bool
    snapshots: bool


KINDS = (
    Kind("modes", lambda size: size, False, False),
    Kind("modes and derivatives", lambda size: 12, True, False),
    Kind("snapshots", lambda size: 0, False, True),
    Kind("all three", lambda size: 12, True, True),
)


def bar(n: int) -> ElementMesh:
    """Return the bar with `n` cells over its height, each of six tetrahedra."""
    x = [np.linspace(0, LENGTH, 5 * n + 1), np.linspace(0, HEIGHT, n + 1), np.linspace(0, WIDTH, max(n // 2, 1) + 1)]
    return ElementMesh.of(skfem.MeshTet.init_tensor(*x))


def end(x: Array) -> Array:
    found: Array = x[0] > LENGTH - 1e-9
    return found


def clamp(x: Array) -> Array:
    found: Array = x[0] < 1e-9
    return found


def body(n: int, bend: float = 1.0, twist: float = 1.0) -> System:
    """Return the bar, clamped at one end, with factors of both loads at the other end."""
    if not (bend or twist):
        return System(bar(n), StVK(MATERIAL), fixed={clamp: "xyz"})

    def load(x: Array, t: float) -> Array:
        y, z = x[1] - HEIGHT / 2, x[2] - WIDTH / 2
        return t * np.stack([0 * y, -twist * TWIST * z, twist * TWIST * y - bend * BEND])

    return System(bar(n), [StVK(MATERIAL), Traction(end, load)], fixed={clamp: "xyz"})


@cache
def solved(n: int, bend: float = 1.0, twist: float = 1.0) -> tuple[Array, ...]:
    """Return the states of the full bar on the path to these loads."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StvkWarning)
        return tuple(step.u for step in solve_static(body(n, bend, twist), steps=4, quiet=True).history)


def _snapshots(n: int) -> Array:
    return np.stack([u for loads in SEEN for u in solved(n, *loads)], axis=1)


@cache
def on_basis(n: int, kind: Kind, size: int, loads: float = 1.0) -> ReducedSystem:
    """Return the bar on a basis of this kind and size, with this factor of both loads."""
    seen = _snapshots(n) if kind.snapshots else None
    size = size if seen is None or kind.modes(size) else min(size, seen.shape[1])
    return ReducedSystem(body(n, loads, loads), size, kind.modes(size), kind.derivatives, snapshots=seen, quiet=True)


def off(found: Array, truth: Array) -> float:
    """Return the relative error `|found - truth| / |truth|`."""
    return float(np.linalg.norm(found - truth) / np.linalg.norm(truth))


def at_rest(quick: bool) -> Iterable[Study]:
    """Yield the study of the error of the static state against size, by the kind of the basis."""
    n, sizes = (QUICK_CELLS, QUICK_SIZES) if quick else (CELLS, SIZES)
    truth = solved(n)[-1]
    errors: dict[str, list[float]] = {}
    for kind in KINDS:
        errors[kind.name] = []
        for size in sizes:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", StvkWarning)
                result = solve_static(on_basis(n, kind, size), steps=4, quiet=True, raise_on_failure=False)
            errors[kind.name].append(off(result.u, truth) if result.t == 1 else np.nan)
    last = {name: several[-1] for name, several in errors.items()}
    better = last["modes and derivatives"] < min(last["modes"] / 3, 0.2)
    wrong = (
        () if better else (f"error with modes and derivatives: {last['modes and derivatives']:.1%}, modes: {last['modes']:.1%}",)
    )
    mesh, moved = bar(n), np.abs(truth).max() / LENGTH
    yield Study(
        "The bar at rest: error of the displacements against size",
        "modal derivatives reduce the error of modes to less than a third, and to less than 20 %",
        ("basis", *(f"r = {size}" for size in sizes)),
        tuple((name, *(_percent(e) for e in several)) for name, several in errors.items()),
        wrong,
        (
            f"{mesh.nt} tetrahedra, {3 * mesh.nv} unknowns, bending and twist; displacement of the end: {moved:.2f} of the length",
            f"snapshots: the {_snapshots(n).shape[1]} states on the paths to {len(SEEN)} other loads, so that r <= this number",
        ),
    )


def _percent(error: float) -> str:
    return "-" if error != error else f"{error:.2%}"


def in_motion(quick: bool) -> Iterable[Study]:
    """Yield the study of the error of the whole motion after the removal of the loads."""
    n, sizes = (QUICK_CELLS, QUICK_SIZES) if quick else (CELLS - 1, SIZES[1:-1])
    until = UNTIL / 4 if quick else UNTIL
    full = body(n, 0.0, 0.0)
    u0 = solved(n, PART, PART)[-1]
    probes, integrator = {"end": end}, Newmark(DT)
    columns = [f"end {axis}" for axis in "xyz"]
    truth = _path(simulate(full, integrator, until=until, u0=u0, probes=probes, quiet=True), columns)
    rows, last = [], {}
    for kind in KINDS:
        found = []
        for size in sizes:
            reduced = on_basis(n, kind, size, 0.0)
            path = _path(simulate(reduced, integrator, until=until, u0=u0, probes=probes, quiet=True), columns)
            found.append(float(np.abs(path - truth).max() / np.abs(truth).max()))
        rows.append((kind.name, *map(_percent, found)))
        last[kind.name] = found[-1]
    better = last["modes and derivatives"] < 0.5 * last["modes"]
    yield Study(
        "The released bar: error of the path of its end against size",
        "modal derivatives reduce the error of modes to less than a half",
        ("basis", *(f"r = {size}" for size in sizes)),
        tuple(rows),
        () if better else (f"modes and derivatives: {last['modes and derivatives']:.1%}, modes alone: {last['modes']:.1%}",),
        (f"Newmark's method, dt = {DT:g} s, over {until:g} s; largest distance divided by the largest displacement",),
    )


def conserved_energy(quick: bool) -> Iterable[Study]:
    """Yield the study of the energy of the released bar over many periods, by the integrator."""
    n, size = (QUICK_CELLS, 10) if quick else (CELLS - 1, 20)
    reduced = on_basis(n, KINDS[1], size, 0.0)
    u0 = solved(n, PART, PART)[-1]
    lowest = float(modes(body(n, 0.0, 0.0), 1).frequencies[0])
    periods = QUICK_PERIODS if quick else PERIODS
    rows, wrong, rates = (
        [],
        [],
        {"EnergyMomentum": EnergyMomentum(DT), "Newmark": Newmark(DT), "GeneralizedAlpha": GeneralizedAlpha(DT)},
    )
    for name, integrator in rates.items():
        run = simulate(reduced, integrator, until=periods / lowest, u0=u0, quiet=True)
        total = run.ledger["total_energy"]
        drift = float(np.abs(total / total[0] - 1).max())
        rows.append((name, f"{drift:.0e}", f"{total[-1] / total[0] - 1:+.1e}", str(run.ledger.steps - 1), f"{run.iterations}"))
        if name == "EnergyMomentum" and not drift < 1e-10:
            wrong.append(f"{name}: relative error of the energy = {drift:.0e}")
    yield Study(
        "The released bar: energy over many periods",
        "the mean of the force at the two Gauss points (EnergyMomentum) conserves the energy to 1e-10",
        ("integrator", "largest error", "at the end", "steps", "iterations"),
        tuple(rows),
        tuple(wrong),
        (f"r = {size}, dt = {DT:g} s, {periods} periods of the lowest mode ({lowest:.2f} Hz), no damping",),
    )


def _path(run: Any, columns: list[str]) -> Array:
    return np.stack([run.ledger[name] for name in columns])
