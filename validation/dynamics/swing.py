"""Bar of soft tissue, 30 x 15 x 15 cm, that hangs from one end and gets an initial sideways velocity.

It swings by half of its length.
"""

from __future__ import annotations

from time import perf_counter, thread_time
from typing import NamedTuple

import numba
import numpy as np
import skfem

from skfem_stvk import ElementMesh, Gravity, StVK, System
from skfem_stvk.arguments import Array
from skfem_stvk.solvers.dynamics import Integrator, LinearBackwardEuler, Run

from .scenes import reached

LENGTH, SIDE, PUSH, GRAVITY = 0.3, 0.15, 2.0, (0.0, 0.0, -9.81)
YOUNG, POISSON, DENSITY = 3e4, 0.4, 1000.0
RTOL, TANGENT = LinearBackwardEuler.rtol, "clamped"
REPEATS = 3


class Timed(NamedTuple):
    """Run, and the wall time of a step [s]."""

    run: Run
    seconds: float

    @property
    def steps(self) -> int:
        """Number of steps of the run."""
        return self.run.ledger.steps - 1

    @property
    def iterations(self) -> float:
        """Iterations of the linear solver per step."""
        return self.run.iterations / self.steps


def bar(n: int, young: float = YOUNG) -> System:
    """Return the bar with `n` cells across and `2 n` along, each of 6 tetrahedra."""
    across, along = np.linspace(0, SIDE, n + 1), np.linspace(-LENGTH, 0, 2 * n + 1)
    mesh = ElementMesh.of(skfem.MeshTet.init_tensor(across, across, along))
    material = StVK(young=young, poisson=POISSON, density=DENSITY)
    return System(mesh, [material, Gravity(GRAVITY)], fixed={lambda x: x[2] == 0: "xyz"})


def push(n: int) -> Array:
    """Return the initial velocities (ndofs,) [m/s]."""
    p = bar(n).mesh.p
    v = np.zeros(p.T.shape)
    v[:, 0] = -PUSH * p[2] / LENGTH
    return v.ravel()


def eq9(rate: float, rtol: float = RTOL) -> LinearBackwardEuler:
    """Return linearised backward Euler with the parameters of the timings."""
    return LinearBackwardEuler(dt=1 / rate, rtol=rtol, tangent=TANGENT)


def clock() -> float:
    """Return the time [s]: on one thread CPU time, otherwise wall time."""
    return thread_time() if numba.get_num_threads() == 1 else perf_counter()


def timed(system: System, integrator: Integrator, v: Array, until: float, repeats: int = REPEATS) -> Timed:
    """Return the fastest of a few runs."""
    best, run = np.inf, None
    end = {"end": lambda x: (x[2] == -LENGTH) & (x[0] == 0) & (x[1] == 0)}
    for _ in range(repeats):
        begin = clock()
        run = reached(system, integrator, until=until, v0=v, probes=end)
        best = min(best, clock() - begin)
    assert run is not None
    return Timed(run, best / (run.ledger.steps - 1))
