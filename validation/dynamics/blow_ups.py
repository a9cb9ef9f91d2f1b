"""Explicit motions that blow up with automatic steps: number of runs that continue with shorter steps to the end.

After a blow-up, a run continues from its last good state. A bar of 768 tetrahedra is stretched or compressed and released, torn
apart, pushed together, or shaken at random, at speeds up to the speed of sound.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import skfem

from skfem_stvk import ElementMesh, StVK, System, VolumePenalty
from skfem_stvk.solvers.dynamics import Run, Status, VelocityVerlet, simulate

from ..statics.study import Study
from .scenes import Array, expected

YOUNG, DENSITY, LENGTH = 1e5, 1000.0, 2.0
#: Number of runs of each kind, stretches before the release, and speeds relative to the speed of sound.
COUNT, QUICK_COUNT = 11, 2
STRETCHES, SPEEDS = (0.5, 3.0), (0.1, 1.0)
UNTIL = 0.5
TERMS = {"none": (), "compression": (VolumePenalty(kind="compression"),), "barrier": (VolumePenalty(),)}


class Start(NamedTuple):
    """Initial displacements [m] and velocities [m/s], (nv, 3)."""

    u: Array
    v: Array


def blow_ups(quick: bool = False, folder: Path | None = None) -> Sequence[Study]:
    """Count explicit motions with automatic steps that blow up, continue with shorter steps and reach the end."""
    mesh = _bar()
    rows, failures = [], []
    for name, terms in TERMS.items():
        system = System(mesh, [StVK(young=YOUNG, poisson=0.3, density=DENSITY), *terms])
        runs = [moved(system, start) for start in starts(mesh, QUICK_COUNT if quick else COUNT)]
        ends = {status: sum(run.status is status for run in runs) for status in Status}
        halved = sum("blew up" in run.message and run.status is not Status.BLEW_UP for run in runs)
        rows.append(
            (name, *map(str, (len(runs), ends[Status.FINISHED], ends[Status.ENDED_INVERTED], halved, ends[Status.BLEW_UP])))
        )
        if name != "barrier" and ends[Status.BLEW_UP]:
            failures.append(f"volume term {name}: {ends[Status.BLEW_UP]} of {len(runs)} blew up")
    return (
        Study(
            "Explicit motions that blow up",
            "without a volume term, and with a volume term of kind 'compression', all runs reach the end",
            ("volume term", "runs", "finished", "ended inside out", "of these with halved steps", "blew up"),
            tuple(rows),
            tuple(failures),
            (
                f"a free bar of {mesh.nt} tetrahedra, E = {YOUNG:g} Pa, velocity Verlet with dt=None, {UNTIL:g} s; the stiffness "
                "of the barrier has no limit",
            ),
        ),
    )


def _bar() -> ElementMesh:
    """Return a bar twice as long as it is wide and thick."""
    lines = np.linspace(0, LENGTH, 9), *2 * [np.linspace(0, LENGTH / 2, 5)]
    return ElementMesh.of(skfem.MeshTet.init_tensor(*lines))


def starts(mesh: ElementMesh, count: int) -> list[Start]:
    """Return `count` initial states of each kind."""
    x = mesh.p.T - mesh.p.mean(axis=1)
    sound, none = np.sqrt(YOUNG / DENSITY), np.zeros_like(x)
    along = 2 * x[:, :1] / LENGTH * [1.0, 0.0, 0.0]
    speeds = sound * np.linspace(*SPEEDS, count)
    noise = [np.random.default_rng(seed).uniform(-1, 1, x.shape) for seed in range(count)]
    return [
        *(Start((stretch - 1) * x * [1.0, 0.0, 0.0], none) for stretch in np.geomspace(*STRETCHES, count)),
        *(Start(none, speed * along) for speed in speeds),
        *(Start(none, -speed * along) for speed in speeds),
        *(Start(none, speed * way) for speed, way in zip(speeds, noise, strict=True)),
    ]


def moved(system: System, start: Start) -> Run:
    """Return a run until its end or blow-up."""
    with expected():
        return simulate(
            system, VelocityVerlet(), until=UNTIL, u0=start.u.ravel(), v0=start.v.ravel(), quiet=True, raise_on_failure=False
        )
