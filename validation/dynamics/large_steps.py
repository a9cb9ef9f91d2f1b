"""Linearised backward Euler (eq. 9) with steps far above the explicit limit, with each tangent.

A soft cantilever of tetrahedra is released and swings down under its weight, by half of its length. The reference is velocity
Verlet below its critical step.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from skfem_stvk import solve_static
from skfem_stvk.solvers.dynamics import LinearBackwardEuler, Run, VelocityVerlet, simulate
from skfem_stvk.solvers.dynamics.critical_step import critical_step
from skfem_stvk.solvers.dynamics.step_matrix import StepTangent

from ..statics.study import Study
from .scenes import TIP, Array, cantilever, expected

#: Time steps in critical steps, and the least number of steps.
TIMES, QUICK_TIMES, LEAST = (1, 3, 10, 30, 100, 300, 1000), (1, 30, 1000), 20
UNTIL = 0.3
#: Time steps of the short table, in critical steps.
GLANCE = 1, 10, 100, 1000
#: Tangents that are claimed to stay bounded with all steps; the others are only shown. A body is out of bounds if its energy
#: exceeds `TOO_MUCH` times the work of its weight.
ROBUST, TOO_MUCH = ("exact", "clamped", "gauss-newton"), 3.0
#: Limits of the error at the critical step, and of the last state if steps are larger than `LARGE`: these runs end in equilibrium.
ACCURATE, SETTLED, LARGE = 0.1, 0.01, 100


class Trial(NamedTuple):
    """Run with its step in critical steps, the error of the tip at `UNTIL`, and the distance of the last state from equilibrium."""

    times: float
    tangent: str
    run: Run
    error: float
    distance: float

    @property
    def lost(self) -> float:
        """Lost energy relative to the work of the weight; NaN if there was no work."""
        ledger = self.run.ledger
        work = np.abs(ledger["potential_energy"]).max()
        return float(-ledger["closure_error"][-1] / work) if work else np.nan

    @property
    def iterations(self) -> float:
        """Iterations of conjugate gradients per step."""
        return self.run.iterations / (self.run.ledger.steps - 1)

    @property
    def bounded(self) -> bool:
        """Whether the run reached the end with bounded energy at all times."""
        ledger = self.run.ledger
        own = ledger["kinetic_energy"] + ledger["strain_energy"]
        return self.run.success and bool(own.max() <= TOO_MUCH * np.abs(ledger["potential_energy"]).max())


def large_steps(quick: bool = False, folder: Path | None = None) -> Sequence[Study]:
    """Test linearised backward Euler with steps 1 to 1000 times the explicit limit and each tangent."""
    system = cantilever(2)
    critical = critical_step(system).step
    reference = simulate(system, VelocityVerlet(dt=critical / 4), until=UNTIL, probes=TIP, quiet=True).ledger
    rest = solve_static(system, quiet=True).u
    times = QUICK_TIMES if quick else TIMES
    trials = [
        _trial(one.value, factor, critical, np.array([reference[f"tip {axis}"][-1] for axis in "xyz"]), rest)
        for one in StepTangent
        for factor in times
    ]
    return (
        Study(
            "Large steps: eq. 9 beyond the explicit limit",
            f"bounded with {', '.join(ROBUST)}; above {LARGE} times the limit they end in equilibrium, within {SETTLED:.0%}",
            (
                "tangent",
                "dt/critical",
                "dt in ms",
                "steps",
                "CG iterations per step",
                "error",
                "from equilibrium",
                "energy lost",
                "how it ended",
            ),
            tuple(map(_row, trials)),
            tuple(failure for trial in trials for failure in _failures(trial)),
            (
                f"{system!r}, critical step {1e3 * critical:.3f} ms; at least {LEAST} steps, at least {UNTIL:g} s",
                f"error of the tip's displacement at {UNTIL:g} s, against velocity Verlet with a quarter of the critical step, "
                "if a step ends by then; from equilibrium: distance of the last state",
                "energy lost relative to the work of the weight; negative: energy was gained; if a motion blew up, "
                "all values are those of the last good state",
            ),
        ),
        _at_a_glance(trials),
    )


def _at_a_glance(trials: Sequence[Trial]) -> Study:
    """Return a short table of each tangent with some of the steps: the error, or the reason of the end."""
    times = [times for times in GLANCE if any(trial.times == times for trial in trials)]
    rows = []
    for one in StepTangent:
        own = {trial.times: trial for trial in trials if trial.tangent == one.value}
        iterations = ", ".join(f"{own[t].iterations:.0f}" for t in times if own[t].run.success)
        rows.append((one.value, *(_in_a_word(own[t]) for t in times), iterations))
    return Study(
        "Large steps, at a glance",
        "",
        ("tangent", *(f"{t} critical steps" for t in times), "CG iterations per step"),
        tuple(rows),
        notes=("error of the tip, or the last state if no step ends by then",),
    )


def _in_a_word(trial: Trial) -> str:
    if not trial.bounded:
        return trial.run.status.value
    if not np.isnan(trial.error):
        return f"{trial.error:.0%}"
    return "at rest in equilibrium" if trial.distance <= SETTLED else f"{trial.distance:.0%} from equilibrium"


def _trial(tangent: str, times: float, critical: float, reference: Array, rest: Array) -> Trial:
    """Run a motion from rest with one tangent and one time step."""
    system, dt = cantilever(2), times * critical
    until = max(UNTIL, LEAST * dt)
    with expected():
        run = simulate(
            system, LinearBackwardEuler(dt=dt, tangent=tangent), until=until, probes=TIP, quiet=True, raise_on_failure=False
        )
    t, tip = run.ledger["time"], np.stack([run.ledger[f"tip {axis}"] for axis in "xyz"], axis=1)
    there = [np.interp(UNTIL, t, component) for component in tip.T]
    error = np.linalg.norm(there - reference) / np.linalg.norm(reference) if dt <= UNTIL and t[-1] >= UNTIL else np.nan
    return Trial(times, tangent, run, float(error), float(np.linalg.norm(run.u - rest) / np.linalg.norm(rest)))


def _row(trial: Trial) -> tuple[str, ...]:
    run, steps = trial.run, trial.run.ledger.steps - 1
    ended = "bounded" if trial.bounded else "out of bounds" if run.success else run.status.value
    error = "" if np.isnan(trial.error) else f"{trial.error:.1e}"
    lost = "" if np.isnan(trial.lost) else f"{trial.lost:+.1%}"
    numbers = f"{trial.iterations:.1f}" if run.success else "", error, f"{trial.distance:.1e}", lost
    return trial.tangent, f"{trial.times:g}", f"{1e3 * run.dt:.3g}", str(steps), *numbers, ended


def _failures(trial: Trial) -> Iterator[str]:
    what = f"{trial.tangent}, {trial.times:g} times the critical step"
    if trial.tangent not in ROBUST:
        return
    if not trial.bounded:
        yield f"{what}: {trial.run.message}"
    if trial.times > LARGE and not trial.distance <= SETTLED:
        yield f"{what}: {trial.distance:.1e} from equilibrium"
    if trial.times == 1 and not trial.error <= ACCURATE:
        yield f"{what}: error {trial.error:.1e}"
