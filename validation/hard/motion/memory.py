"""Runs of very many steps: only the ledger may grow."""

from __future__ import annotations

import os
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

from skfem_stvk import Gravity, StVK, System
from skfem_stvk.solvers.dynamics import EnergyMomentum, ForwardEuler, Integrator, LinearBackwardEuler, simulate
from skfem_stvk.solvers.dynamics.integrators.integrator import Stepper
from skfem_stvk.solvers.dynamics.motion import Motion
from skfem_stvk.solvers.dynamics.record import MotionState

from .. import meshes

#: Fraction of the steps before the first memory measurement; largest growth of Python's memory after it, without the ledger
#: [bytes].
WARM, MOST = 0.2, 1e5
#: Largest energy error relative to the energy; linearised backward Euler dissipates energy and is exempt.
ENERGY, DISSIPATES = 0.05, ("LinearBackwardEuler",)
DT = 5e-4
#: Integrators, with numbers of steps of the quick and of the complete table.
LONG: tuple[tuple[Integrator, int, int], ...] = (
    (ForwardEuler(dt=DT), 20_000, 1_000_000),
    (EnergyMomentum(dt=10 * DT), 400, 20_000),
    (LinearBackwardEuler(dt=DT), 2_000, 100_000),
)


class Growth(NamedTuple):
    """Result of a long run.

    Attributes
    ----------
    ledger, other, process
        Memory of the ledger's rows, growth of Python's other memory after `WARM` of the steps, and growth of the process since
        then, including memory that allocators retain [bytes].
    energy
        Closure error at the end relative to the largest strain energy.
    """

    name: str
    steps: int
    seconds: float
    ledger: float
    other: float
    process: float
    energy: float

    @property
    def holds(self) -> bool:
        """Whether only the ledger grew, and the energy error is within its limit."""
        return self.other <= MOST and (abs(self.energy) <= ENERGY or self.name in DISSIPATES)


class Watched:
    """Stepper that measures the memory once, at a given time [s]."""

    def __init__(self, stepper: Stepper, when: float) -> None:
        self._stepper, self._when, self.before, self.process = stepper, when, 0.0, 0.0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stepper, name)

    def step(self, state: MotionState, t: float) -> None:
        self._stepper.step(state, t)
        if t >= self._when:
            self._when, self.before, self.process = float("inf"), traced(), resident()


def traced() -> float:
    """Return Python's memory since tracing began, without ledgers [bytes]."""
    snapshot = tracemalloc.take_snapshot().filter_traces(
        [tracemalloc.Filter(False, "*ledger.py"), tracemalloc.Filter(False, tracemalloc.__file__)]
    )
    return float(sum(trace.size for trace in snapshot.traces))


def resident() -> float:
    """Return the resident memory of this process [bytes]; 0 if the system has no such file."""
    file = Path("/proc/self/statm")
    return float(file.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") if file.exists() else 0.0


def grown(integrator: Integrator, steps: int, watched: Callable[[Stepper, float], Watched] = Watched) -> Growth:
    """Measure a small cantilever that swings for `steps` steps."""
    assert integrator.dt is not None
    until, made = steps * integrator.dt, []

    def stepper(motion: Motion) -> Watched:
        made.append(watched(type(integrator).stepper(integrator, motion), WARM * until))
        return made[0]

    observed = type(integrator)(dt=integrator.dt)
    object.__setattr__(observed, "stepper", stepper)
    material = StVK(young=1e5, poisson=0.3, density=1e3)
    system = System(meshes.bar(2.0, 1), [material, Gravity(g=(0, 0, -0.3))], fixed={lambda x: x[0] == 0: "xyz"})
    begin = perf_counter()
    tracemalloc.start()
    run = simulate(system, observed, until=until, quiet=True)
    seconds, other, process = perf_counter() - begin, traced() - made[0].before, resident() - made[0].process
    tracemalloc.stop()
    closure, most = run.ledger["closure_error"][-1], run.ledger["strain_energy"].max()
    return Growth(integrator.name, steps, seconds, run.ledger.rows().nbytes, other, process, float(closure / most))
