"""Soft block that spins and vibrates in free flight: drifts of energy and momenta with each integrator.

The block of unstructured tetrahedra spins at about 10 rad/s about an axis that is not a principal axis, and vibrates with about a
tenth of its energy. Its centre of mass is at rest at the origin, except in one run with a translation. The block also falls from
rest, where its strain is an error of the linear solves.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from skfem_stvk import System
from skfem_stvk.arguments import Array
from skfem_stvk.solvers.dynamics import (
    BackwardEuler,
    EnergyMomentum,
    ForwardEuler,
    GeneralizedAlpha,
    Integrator,
    Ledger,
    LinearBackwardEuler,
    Newmark,
    VelocityVerlet,
    critical_step,
    simulate,
)
from skfem_stvk.solvers.dynamics.integrators import ANGULAR_MOMENTUM, ENERGY, LINEAR_MOMENTUM

from ..study import Study
from .scenes import COLOURS, MARKERS, block

QUANTITIES = (ENERGY, LINEAR_MOMENTUM, ANGULAR_MOMENTUM)
DT, UNTIL, QUICK_UNTIL = 1e-3, 2.0, 0.2
#: Relative tolerance of each solve; limit of the drift over all steps of quantities that an integrator declares as conserved.
RTOL, KEPT = 1e-12, 1e-10
#: Numbers of steps of the runs that are solved to round-off. Limits of the drift: `EXACT`, and `FAR` for the angular momentum about
#: the origin of the body with a translation.
STEPS, QUICK_STEPS = 100_000, 1000
#: Second body of these runs with 6 n^3 tetrahedra, in addition to the one with six: n, its step in critical steps, and numbers of
#: steps. The first body has a seventh of the critical step.
REAL, TIMES, REAL_STEPS, QUICK_REAL_STEPS = 6, 10.0, 2500, 20
ROUND_OFF, EXACT, FAR = 3e-16, 1e-12, 1e-10
SPIN, THROUGH = (1.0, 2.0, 10.0), (3.0, 1.5, -1.0)  # [rad/s], [m/s]
SIDES = (0.4, 0.1, 0.15)
INTEGRATORS: tuple[Integrator, ...] = (
    ForwardEuler(dt=DT / 4),
    VelocityVerlet(dt=DT / 4),
    LinearBackwardEuler(dt=DT, rtol=RTOL),
    BackwardEuler(dt=DT, rtol=RTOL),
    Newmark(dt=DT, rtol=RTOL),
    GeneralizedAlpha(dt=DT, rtol=RTOL),
    EnergyMomentum(dt=DT, rtol=RTOL),
)


class Flight(NamedTuple):
    """Motion with its largest drifts.

    Drifts of energy and angular momentum are relative to the initial values, that of linear momentum to `sqrt(2 m E)`.
    """

    integrator: Integrator
    ledger: Ledger
    seconds: float
    drifts: dict[str, float]


def flight(quick: bool = False, folder: Path | None = None) -> Sequence[Study]:
    """Measure drifts of a spinning soft body; with energy-momentum, energy and both momenta are conserved to 1e-12."""
    long = _long(QUICK_STEPS if quick else STEPS, QUICK_REAL_STEPS if quick else REAL_STEPS)
    return _all(quick, folder), long


def _all(quick: bool, folder: Path | None) -> Study:
    flights = [fly(block(3, SIDES), one, QUICK_UNTIL if quick else UNTIL) for one in INTEGRATORS]
    return Study(
        "Free flight",
        f"quantities that an integrator declares as conserved drift by at most {KEPT:g}",
        ("integrator", "dt in ms", "steps", *QUANTITIES, "declared", "seconds"),
        tuple(map(_row, flights)),
        tuple(failure for one in flights for failure in _failures(one, KEPT)),
        (
            f"largest drift over {flights[0].ledger['time'][-1]:g} s; energy and angular momentum relative to initial "
            "values, linear momentum to sqrt(2 m E)",
        ),
        () if folder is None else (_picture(flights, folder),),
    )


def _long(steps: int, real_steps: int) -> Study:
    """Measure drifts with solves to round-off: a body of six tetrahedra in small steps, and a larger body in large steps."""
    small, large = block(1, SIDES), block(REAL, SIDES)
    dt = TIMES * critical_step(large).step
    resting, flying = (fly(small, EnergyMomentum(dt=DT, rtol=ROUND_OFF), steps * DT, v) for v in ((0.0, 0.0, 0.0), THROUGH))
    real = fly(large, EnergyMomentum(dt=dt, rtol=ROUND_OFF), real_steps * dt)
    flights = (
        ("centre of mass at rest at the origin", small, resting, EXACT),
        ("with a translation", small, flying, FAR),
        ("at rest at the origin, large steps", large, real, EXACT),
    )
    return Study(
        "Free flight, energy and momentum",
        f"energy and both momenta to {EXACT:g} with the centre of mass at rest at the origin, to {FAR:g} with a translation",
        ("EnergyMomentum", "tetrahedra", "dt/critical", "steps", *QUANTITIES, "seconds"),
        tuple(_long_row(name, system, one) for name, system, one, _ in flights),
        tuple(f"{name}: {failure}" for name, _, one, most in flights for failure in _failures(one, most)),
        (f"rtol = {ROUND_OFF:g}; far from the origin, angular momentum about the origin is a small difference of large numbers",),
    )


def fly(system: System, integrator: Integrator, until: float, through: Sequence[float] = (0.0, 0.0, 0.0)) -> Flight:
    """Simulate a free flight and measure its drifts."""
    begin = perf_counter()
    ledger = simulate(system, integrator, until=until, v0=first_velocities(system, through), quiet=True).ledger
    return Flight(integrator, ledger, perf_counter() - begin, _drifts(ledger, system.mass().total))


def first_velocities(system: System, through: Sequence[float] = (0.0, 0.0, 0.0)) -> Array:
    """Return initial velocities (ndofs,) [m/s]: a spin, a vibration without net momentum, and a translation."""
    p, mass = system.mesh.p, system.mass().vertex
    v = np.cross(SPIN, p.T) + 0.3 * np.sin(40 * p).T
    v += np.array(through) - np.einsum("a,ac->c", mass, v) / mass.sum()
    return v.ravel()


def _drifts(ledger: Ledger, mass: float) -> dict[str, float]:
    energy = ledger["total_energy"]
    linear, angular = (np.stack([ledger[f"{kind}_momentum_{axis}"] for axis in "xyz"], axis=1) for kind in ("linear", "angular"))
    sizes = (abs(energy[0]), np.sqrt(2 * mass * energy[0]), np.linalg.norm(angular[0]))
    drifts = (np.abs(energy - energy[0]), *(np.linalg.norm(one - one[0], axis=1) for one in (linear, angular)))
    return {name: float(drift.max() / size) for name, drift, size in zip(QUANTITIES, drifts, sizes, strict=True)}


def _row(one: Flight) -> tuple[str, ...]:
    integrator, drifts = one.integrator, (f"{one.drifts[quantity]:.1e}" for quantity in QUANTITIES)
    declared = ", ".join(quantity.split()[0] for quantity in QUANTITIES if quantity in integrator.conserves)
    return integrator.name, f"{1e3 * (integrator.dt or 0):g}", str(one.ledger.steps - 1), *drifts, declared, f"{one.seconds:.1f}"


def _long_row(name: str, system: System, one: Flight) -> tuple[str, ...]:
    _, _, steps, *drifts, _, seconds = _row(one)
    ratio = (one.integrator.dt or 0) / critical_step(system).step
    return name, str(system.mesh.nt), f"{ratio:.2g}", steps, *drifts, seconds


def _failures(one: Flight, limit: float) -> Iterator[str]:
    for quantity in one.integrator.conserves:
        if not one.drifts[quantity] <= limit:
            yield f"{one.integrator.name}: {quantity} drifts by {one.drifts[quantity]:.1e}"


def _picture(flights: Sequence[Flight], folder: Path) -> Path:
    """Plot total energy over time, and its drift."""
    figure = Figure(figsize=(6.4, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    for colour, mark, one in zip(COLOURS, MARKERS, flights, strict=True):
        t, energy = one.ledger["time"], one.ledger["total_energy"]
        style: dict[str, Any] = {"color": colour, "lw": 1.3, "marker": mark, "ms": 4.5, "markevery": 0.2}
        left.plot(t, energy / energy[0], label=one.integrator.name, **style)
        every = max(1, len(t) // 200)
        right.semilogy(t[every::every], np.maximum.accumulate(np.abs(energy / energy[0] - 1))[every::every], **style)
    left.set(xlabel="t [s]", ylabel="total energy / first", title="Energy of a spinning soft block")
    right.set(xlabel="t [s]", ylabel="largest drift so far", title="Drift of the energy")
    figure.legend(loc="outside upper center", ncols=3, fontsize=9, frameon=False)
    for axes in (left, right):
        axes.title.set_fontsize(9)
        axes.tick_params(labelsize=9)
        axes.grid(True, alpha=0.3)
    path = folder / "dynamics-flight.png"
    figure.savefig(path, dpi=140)
    return path
