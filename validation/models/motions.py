"""Bar in motion: released under its weight with one clamped end, or thrown with a spin and a bending velocity."""

from __future__ import annotations

import warnings
from functools import cache
from typing import NamedTuple

import numpy as np

from skfem_stvk import Gravity, StvkError, StvkWarning, System, VelocityVerlet, critical_step, simulate
from skfem_stvk.arguments import Array

from .models import LENGTH, TRUE, Model, bar, system_of

#: Gravity [m/s^2], which lowers the end of the released bar by about half of the length; spin of the thrown bar [rad/s], and
#: bending speed of its ends [m/s].
GRAVITY, SPIN, BEND = (0.0, 0.0, -0.4), 1.5, 0.8
#: Duration [s]; time step over the critical step of StVK, or of the model if that is smaller.
UNTIL, QUICK_UNTIL, PART = 8.0, 0.5, 0.5
ACROSS, QUICK_ACROSS = 3, 1
#: Number of times at which paths are compared.
MOMENTS = 400


class Path(NamedTuple):
    """Motion of a model.

    Times (m,) and displacements (m, 3) of the tip at `MOMENTS`, drifts of energy and angular momentum, the last state, and the
    status. The energy drift is relative to the largest kinetic energy, the other to the initial angular momentum. A drift is NaN if
    its scale is zero.
    """

    times: Array
    tip: Array
    energy: float
    spin: float
    u: Array
    said: str


def released(model: Model, quick: bool) -> Path:
    """Simulate the bar clamped at its wall; its weight acts suddenly at rest."""
    mesh = bar(QUICK_ACROSS if quick else ACROSS)
    system = system_of(model, mesh, [Gravity(GRAVITY)], {"wall": "xyz"})
    return _followed(system, np.zeros(system.ndofs), quick)


def thrown(model: Model, quick: bool) -> Path:
    """Simulate the free bar, which spins about a transverse axis and bends up and down."""
    mesh = bar(QUICK_ACROSS if quick else ACROSS)
    v = SPIN * np.cross([0, 1, 0], mesh.p.T - [LENGTH / 2, 0.5, 0.5])
    v[:, 2] += BEND * np.cos(2 * np.pi * mesh.p[0] / LENGTH)
    return _followed(system_of(model, mesh), v.ravel(), quick)


def stable_step(system: System) -> float:
    """Return the critical step of explicit integration at rest [s]; NaN if it cannot be computed."""
    try:
        return critical_step(system).step
    except StvkError:
        return np.nan


@cache
def _usual_step(n: int) -> float:
    return stable_step(system_of(TRUE, bar(n)))


def _followed(system: System, v: Array, quick: bool) -> Path:
    until = QUICK_UNTIL if quick else UNTIL
    steps = np.array([_usual_step(QUICK_ACROSS if quick else ACROSS), stable_step(system)])
    count = int(np.ceil(until / (PART * np.nanmin(steps))))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StvkWarning)
        run = simulate(
            system,
            VelocityVerlet(until / count),
            until=until,
            v0=v,
            probes={"tip": "tip"},
            quiet=True,
            raise_on_failure=False,
        )
    ledger, times = run.ledger, np.linspace(0, until, MOMENTS)
    tip = np.stack([np.interp(times, ledger["time"], ledger[f"tip {axis}"], right=np.nan) for axis in "xyz"], axis=1)
    total, kinetic = ledger["total_energy"], np.max(ledger["kinetic_energy"])
    momentum = np.stack([ledger[f"angular_momentum_{axis}"] for axis in "xyz"], axis=1)
    energy = np.abs(total - total[0]).max() / kinetic
    first = np.linalg.norm(momentum[0])
    spin = np.linalg.norm(momentum - momentum[0], axis=1).max() / first if first > 0 else np.nan
    said = "ended" if run.success else run.status.name.lower()
    return Path(times, tip, float(energy), float(spin), run.u, said)


def off(path: Path, truth: Path) -> float:
    """Return the largest distance of two paths over the largest displacement of the second; infinite if the first ended early."""
    apart = np.linalg.norm(path.tip - truth.tip, axis=1).max() / np.linalg.norm(truth.tip, axis=1).max()
    return float(apart) if apart == apart else np.inf
