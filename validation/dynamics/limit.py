"""Stability limit of explicit integrators: smallest step at which motions grow, by bisection, against `critical_step`.

A body in equilibrium is disturbed by random velocities, so small that it stays linear. Above the limit the disturbance grows by a
factor per step: `1 + sqrt(8 e)` at `1 + e` times the limit, and only `1 + c e` with damping. Below the limit it never grows. The
number of steps is large enough for the energy at the end to show the growth at the upper end of the bracket. Fewer steps would give
limits that are too large.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields
from pathlib import Path
from typing import NamedTuple

import numpy as np

from skfem_stvk import System, solve_static
from skfem_stvk.solvers.dynamics import EdgeDamping, ForwardEuler, Rayleigh, Status, VelocityVerlet, simulate
from skfem_stvk.solvers.dynamics.critical_step import CriticalStep, critical_step

from ..statics.study import Study
from .scenes import Array, block, expected

#: Steps of a trial, and the width of the bracket relative to the limit.
STEPS, PRECISION = 2000, 1e-3
#: A disturbance grows if its mean kinetic energy in the last quarter of the steps is `GROWING` times that in the third quarter. It
#: also grows if its energy is `GROWN` times the initial one at any time; then it is no longer small, and may grow no further.
GROWING, GROWN = 1.5, 1e6
LIMIT = 0.002
DISTURBANCE = 1e-9  # [m/s]
AROUND = 0.97, 1.03
SIDES = (0.4, 0.1, 0.15)
NONE = Rayleigh()
PRESCRIBED = {"pulled": 0.3, "pressed": -0.12}
INTEGRATORS = (ForwardEuler, VelocityVerlet)


class Case(NamedTuple):
    """Body at displacements `u` (ndofs,), or at rest, and its damping."""

    name: str
    system: System
    u: Array
    damping: Rayleigh | EdgeDamping = NONE


def limit(quick: bool = False, folder: Path | None = None) -> Sequence[Study]:
    """Compare the stability limit of explicit integrators with the critical step; they agree within 0.2 %."""
    cases = list(_cases())[1::5] if quick else list(_cases())
    found = [(case, predicted(case, one), one) for case in cases for one in INTEGRATORS]
    observed = [observed_limit(case, one, critical.step) for case, critical, one in found]
    rows = [
        (
            case.name,
            one.__name__,
            f"{1e3 * critical.step:.4f}",
            f"{1e3 * dt:.4f}",
            f"{dt / critical.step - 1:+.2%}",
            f"{critical.bound / critical.step:.2f}",
        )
        for (case, critical, one), dt in zip(found, observed, strict=True)
    ]
    return (
        Study(
            "Stability limit of explicit integrators",
            f"observed within {LIMIT:.1%} of the critical step; the bound of `critical_step` is below both",
            ("body", "integrator", "critical step in ms", "observed", "off", "bound/critical"),
            tuple(rows),
            tuple(failure for one, dt in zip(found, observed, strict=True) for failure in _failures(*one, dt)),
            (
                f"by bisection to {PRECISION:.1%}; unstable: a disturbance of {DISTURBANCE:g} m/s has more energy in the last "
                f"quarter of {STEPS} steps than in the third",
            ),
        ),
    )


def _cases() -> Iterator[Case]:
    """Yield bodies that are free or clamped, damped, stretched or compressed."""
    free, held = block(3, SIDES), block(3, SIDES, fixed={_foot: "xyz"})
    rest, omega = np.zeros(free.ndofs), critical_step(held).omega
    dampings: dict[str, Rayleigh | EdgeDamping] = {
        "": NONE,
        ", Rayleigh alpha": Rayleigh(alpha=0.3 * omega),
        ", Rayleigh beta": Rayleigh(beta=0.3 / omega),
        ", edges": EdgeDamping(0.3 / omega),
    }
    yield Case("free, at rest", free, rest)
    for damping, one in dampings.items():
        yield Case(f"held, at rest{damping}", held, rest, one)
    for name, by in PRESCRIBED.items():
        system = block(3, SIDES, fixed={_foot: "xyz"}, prescribed={_head: {"x": by * SIDES[0], "y": 0.0, "z": 0.0}})
        u = solve_static(system, steps=4, quiet=True).u
        for damping in ("", ", Rayleigh beta", ", edges"):
            yield Case(f"{name} by {abs(by):.0%}{damping}", system, u, dampings[damping])


def _foot(x: Array) -> Array:
    return x[0] == x[0].min()


def _head(x: Array) -> Array:
    return x[0] == x[0].max()


def predicted(case: Case, integrator: type[ForwardEuler | VelocityVerlet]) -> CriticalStep:
    """Return the critical step with the damping weighted as in the integrator."""
    factors = {one.name: integrator.damping_weight * getattr(case.damping, one.name) for one in fields(case.damping)}
    return critical_step(case.system, case.u, damping=type(case.damping)(**factors))


def observed_limit(case: Case, integrator: type[ForwardEuler | VelocityVerlet], about: float) -> float:
    """Return the smallest step [s] at which motions grow, by bisection within `AROUND` times `about`; NaN if it is outside."""
    low, high = (factor * about for factor in AROUND)
    if grows(case, integrator(dt=low)) or not grows(case, integrator(dt=high)):
        return float("nan")
    while high - low > PRECISION * about:
        middle = (low + high) / 2
        low, high = (low, middle) if grows(case, integrator(dt=middle)) else (middle, high)
    return (low + high) / 2


def grows(case: Case, integrator: ForwardEuler | VelocityVerlet) -> bool:
    """Return whether a small disturbance grows."""
    disturbance = DISTURBANCE * np.random.default_rng(0).standard_normal(case.system.ndofs)
    until = STEPS * float(integrator.dt or 0)
    with expected():
        run = simulate(
            case.system,
            integrator,
            until=until,
            u0=case.u,
            v0=disturbance,
            damping=case.damping,
            quiet=True,
            raise_on_failure=False,
        )
    kinetic = run.ledger["kinetic_energy"]
    _, _, third, last = np.array_split(kinetic, 4)
    return run.status is Status.BLEW_UP or bool(last.mean() > GROWING * third.mean() or kinetic.max() > GROWN * kinetic[0])


def _failures(
    case: Case, critical: CriticalStep, integrator: type[ForwardEuler | VelocityVerlet], observed: float
) -> Iterator[str]:
    what = f"{case.name}, {integrator.__name__}"
    if not abs(observed / critical.step - 1) <= LIMIT:
        yield f"{what}: observed {observed:.4g} s, {critical}"
    if not critical.bound <= min(critical.step, observed):
        yield f"{what}: the bound {critical.bound:.4g} s is not below the observed limit {observed:.4g} s"
