"""Methods of the table, and a run of a method on a scene."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from time import perf_counter
from typing import NamedTuple

import numpy as np

from skfem_stvk.solvers.dynamics import BackwardEuler, EnergyMomentum, ForwardEuler, Integrator, LinearBackwardEuler, simulate

from ..case import Array
from ..judge import Verdict
from ..methods import Run
from . import plain
from .judge import judged
from .scene import Scene


class Answer(NamedTuple):
    """Answer of a method: last displacements and velocities, whether it claims success, counts, status and message."""

    u: Array
    v: Array
    claims_success: bool
    steps: int
    iterations: int
    status: str
    said: str


def _plain(scene: Scene) -> Answer:
    u, v, steps = plain.simulated(scene)
    return Answer(u, v, True, steps, 0, "finished", "")


class Method(NamedTuple):
    """Function that returns an integrator for a step [s], and whether the volume term is used.

    The function is None for the method without checks.
    """

    integrator: Callable[[float], Integrator] | None
    volume: bool = False

    def solve(self, scene: Scene) -> Answer:
        """Return the answer of the method."""
        if self.integrator is None:
            return _plain(scene)
        body = scene.body()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            run = simulate(
                body.system(self.volume),
                self.integrator(scene.dt),
                until=scene.until,
                u0=body.u0,
                v0=body.v0,
                damping=scene.damping,
                quiet=True,
                raise_on_failure=False,
            )
        return Answer(run.u, run.v, run.success, run.ledger.steps - 1, run.iterations, run.status.value, run.message)


#: Methods by name, in the order of the table; all but the first are this package's.
METHODS = {
    "plain eq. 9": Method(None),
    "forward Euler": Method(lambda dt: ForwardEuler(dt=dt)),
    "forward Euler, dt=None": Method(lambda dt: ForwardEuler()),
    "eq. 9": Method(lambda dt: LinearBackwardEuler(dt=dt)),
    "eq. 9 + volume": Method(lambda dt: LinearBackwardEuler(dt=dt), volume=True),
    "backward Euler": Method(lambda dt: BackwardEuler(dt=dt)),
    "backward Euler + volume": Method(lambda dt: BackwardEuler(dt=dt), volume=True),
    "energy-momentum": Method(lambda dt: EnergyMomentum(dt=dt)),
    "energy-momentum + volume": Method(lambda dt: EnergyMomentum(dt=dt), volume=True),
}
OURS = tuple(METHODS)[1:]


def run(scene: Scene, name: str) -> Run:
    """Run a method on a scene, and judge its answer."""
    method, begin = METHODS[name], perf_counter()
    with np.errstate(all="ignore"):
        answer = method.solve(scene)
        seconds = perf_counter() - begin
        ending = scene.with_volume if method.volume else scene.truth
        system = scene.body().system(method.volume)
        judgement = judged(system, answer.u, answer.v, answer.claims_success, answer.said, ending)
    faulty = answer.claims_success and judgement.verdict is not Verdict.RIGHT
    status = judgement.why if faulty else answer.status
    return Run(name, method.volume, answer.steps, answer.iterations, seconds, status, answer.said, answer.u, judgement, unsaid=())
