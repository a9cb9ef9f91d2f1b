"""The stability limit of explicit integrators: where motions begin to grow, found by bisection, against `critical_step`.

A body in equilibrium is disturbed by random velocities, so small that it stays linear. Above the limit the disturbance grows by a factor each step,
`1 + sqrt(8 e)` at `1 + e` times the limit; below it never does.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields
from pathlib import Path
from typing import NamedTuple

import numpy as np

from skfem_stvk import System, solve_static
from skfem_stvk.dynamics import EdgeDamping, ForwardEuler, Rayleigh, VelocityVerlet, simulate
from skfem_stvk.dynamics.critical_step import CriticalStep, critical_step

from ..statics.study import Study
from .scenes import Array, block, expected

#: Steps of a trial, by how much the energy of a growing disturbance has grown then at least, and part of the limit to which it is found.
STEPS, GROWN, PRECISION = 600, 1e6, 1e-2
LIMIT = 0.05
DISTURBANCE = 1e-9  # [m/s]
AROUND = 0.8, 1.25
SIDES = (0.4, 0.1, 0.15)
NONE = Rayleigh()
PRESCRIBED = {"pulled": 0.3, "pressed": -0.12}
INTEGRATORS = (ForwardEuler, VelocityVerlet)


class Case(NamedTuple):
    """A body at displacements `u` (ndofs,), or at rest, and its damping."""

    name: str
    system: System
    u: Array
    damping: Rayleigh | EdgeDamping = NONE


def limit(quick: bool = False, folder: Path | None = None) -> Sequence[Study]:
    """explicit integrators become unstable at the critical step, within 5 %"""
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
            f"observed within {LIMIT:.0%} of the critical step; the bound is below both",
            ("body", "integrator", "critical step in ms", "observed", "off", "bound/critical"),
            tuple(rows),
            tuple(failure for one, dt in zip(found, observed, strict=True) for failure in _failures(*one, dt)),
            (f"by bisection: whether a disturbance of {DISTURBANCE:g} m/s grows to {GROWN:g} times its energy in {STEPS} steps",),
        ),
    )


def _cases() -> Iterator[Case]:
    """Free and held, damped, stretched and pressed."""
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
    """With the damping as it counts in the integrator."""
    factors = {one.name: integrator.damping_weight * getattr(case.damping, one.name) for one in fields(case.damping)}
    return critical_step(case.system, case.u, damping=type(case.damping)(**factors))


def observed_limit(case: Case, integrator: type[ForwardEuler | VelocityVerlet], about: float) -> float:
    """The step [s] from which on motions grow, looked for in `AROUND` times a step; NaN if it is not there."""
    low, high = (factor * about for factor in AROUND)
    if grows(case, integrator(dt=low)) or not grows(case, integrator(dt=high)):
        return float("nan")
    while high - low > PRECISION * about:
        middle = (low + high) / 2
        low, high = (low, middle) if grows(case, integrator(dt=middle)) else (middle, high)
    return (low + high) / 2


def grows(case: Case, integrator: ForwardEuler | VelocityVerlet) -> bool:
    """Whether a small disturbance does."""
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
    return not run.success or bool(kinetic.max() > GROWN * kinetic[0])


def _failures(
    case: Case, critical: CriticalStep, integrator: type[ForwardEuler | VelocityVerlet], observed: float
) -> Iterator[str]:
    what = f"{case.name}, {integrator.__name__}"
    if not abs(observed / critical.step - 1) <= LIMIT:
        yield f"{what}: observed {observed:.4g} s, {critical}"
    if not critical.bound <= min(critical.step, observed):
        yield f"{what}: the bound {critical.bound:.4g} s is not below the observed limit {observed:.4g} s"
