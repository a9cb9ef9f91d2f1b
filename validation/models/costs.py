"""Cost of a model: W and F, K, a step of each kind, memory, and the critical step; one run, one thread."""

from __future__ import annotations

import warnings
from functools import partial
from typing import Any, NamedTuple

import numba
import numpy as np

from skfem_stvk import LinearBackwardEuler, StvkError, StvkWarning, System, VelocityVerlet, simulate
from skfem_stvk.errors import AnalysisError

from ..bench.costs import best_and_median
from .models import Model, bar, system_of
from .motions import stable_step

#: Cells across: 31 104 tetrahedra; the quick run has one cell across.
ACROSS, QUICK_ACROSS = 12, 1
SECONDS, QUICK_SECONDS = 0.5, 0.01
STEPS = 10


class Cost(NamedTuple):
    """Times, memory and critical step of a model; NaN if the model does not have the quantity.

    Times [ns per tetrahedron] are of W and F, of K, of an explicit and of an implicit step (eq. 9). Memory is in bytes per
    tetrahedron, the critical step in s.
    """

    force: float
    tangent: float
    explicit: float
    implicit: float
    memory: float
    step: float


def cost_of(model: Model, quick: bool) -> Cost:
    """Return the costs of a model in a state with strains of some per cent."""
    mesh, seconds = bar(QUICK_ACROSS if quick else ACROSS), QUICK_SECONDS if quick else SECONDS
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", StvkWarning)
            system = system_of(model, mesh, (), {"wall": "xyz"})
            return _of_system(system, seconds)
    finally:
        numba.set_num_threads(threads)


def _of_system(system: System, seconds: float) -> Cost:
    rng, ns = np.random.default_rng(0), 1e9 / system.mesh.nt
    u = 0.05 / np.cbrt(system.mesh.nt / 24) * rng.uniform(-1, 1, system.ndofs)
    K = system.tangent(u)
    taken = best_and_median({"F": partial(system.internal_force, u), "K": partial(system.tangent, u, out=K)}, seconds)
    step, memory = stable_step(system), sum(system.memory().values())
    dt = 0.5 * step if step == step else 1e-3
    motions = [_step(system, VelocityVerlet(dt)), _step(system, LinearBackwardEuler(20 * dt))]
    explicit, implicit = (one * ns for one in motions)
    return Cost(taken["F"].best * ns, taken["K"].best * ns, explicit, implicit, memory / system.mesh.nt, step)


def _step(system: System, integrator: Any) -> float:
    """Return the time of one step [s], from rest with an initial velocity.

    The time is the difference of a long and a short run, so that it excludes one-time costs.
    """
    v = np.zeros((system.mesh.nv, 3))
    v[:, 2] = 0.1 * system.mesh.p[0]
    try:
        runs = [
            simulate(system, integrator, until=n * integrator.dt, v0=v.ravel(), quiet=True, raise_on_failure=False)
            for n in (STEPS, 3 * STEPS)
        ]
    except AnalysisError:
        raise
    except StvkError:
        return np.nan
    if not all(run.success for run in runs):
        return np.nan
    short, long = (sum(run.seconds.values()) for run in runs)
    return max(long - short, 0.0) / (2 * STEPS)
