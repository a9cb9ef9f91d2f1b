"""Error against wall time of all integrators, and of all tangents of the implicit ones, on two scenes.

A stiff, slender beam swings in space, by about a third of its length. A soft block, bent as in its first mode, spins in free
flight. The reference of both is velocity Verlet, extrapolated from an eighth and a sixteenth of the critical step. Errors are those
of the displacements at the end.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter

from skfem_stvk import Gravity, System, solve_static
from skfem_stvk.about import write_machine
from skfem_stvk.arguments import Array
from skfem_stvk.solvers.dynamics import (
    BackwardEuler,
    EnergyMomentum,
    ForwardEuler,
    GeneralizedAlpha,
    Integrator,
    LinearBackwardEuler,
    Newmark,
    VelocityVerlet,
    simulate,
)
from skfem_stvk.solvers.dynamics.critical_step import critical_step
from skfem_stvk.solvers.dynamics.modes import modes
from skfem_stvk.solvers.dynamics.step_matrix import StepTangent

from ..slopes import draw_slope
from ..study import Study
from .flight import SPIN
from .scenes import COLOURS, MARKERS, block, cantilever, expected

EXPLICIT = (ForwardEuler, VelocityVerlet)
IMPLICIT = (LinearBackwardEuler, BackwardEuler, Newmark, GeneralizedAlpha, EnergyMomentum)
#: Markers of tangents other than the exact one.
MARKS = {"clamped": "<", "gauss-newton": ">", "diagonal": "+", "rest": "x"}
#: Exponents of the error against time, of first and of second order, next to the curves of two integrators.
SLOPES = {"BackwardEuler": -1, "EnergyMomentum": -2}
SLOPES_BELOW = 2.0
#: Steps of explicit integrators in critical steps.
PARTS = (0.9, 0.45, 0.225)
#: Steps of implicit integrators [s].
BEAM_STEPS: tuple[float, ...] = 0.01, 0.005, 0.0025, 0.00125, 0.000625
BLOCK_STEPS: tuple[float, ...] = 0.02, 0.01, 0.005, 0.0025, 0.00125
#: Integrators that are also run with the other tangents.
OF_ALL_TANGENTS = (LinearBackwardEuler, EnergyMomentum)
#: Number of smallest steps with which the other tangents are run.
OTHERS = 2
GOALS = (0.1, 0.01)
#: Amplitude of the block's first mode that is not rigid [m].
AMPLITUDE = 0.01
#: Largest error of integrators of second order with the exact tangent at the smallest step.
CLOSE = 0.02


class Scene(NamedTuple):
    """Body with initial displacements [m] and velocities [m/s] (ndofs,), duration [s], and steps of implicit integrators [s]."""

    name: str
    system: System
    u0: Array
    v0: Array
    until: float
    steps: tuple[float, ...]


class Point(NamedTuple):
    """Run of an integrator; the error is NaN if the run did not reach the end."""

    integrator: Integrator
    error: float
    seconds: float


def work_precision(quick: bool = False, folder: Path | None = None) -> Sequence[Study]:
    """Measure error against wall time for all integrators and tangents on two scenes."""
    scenes = _scenes(quick)
    found = {scene.name: _points(scene, quick) for scene in scenes}
    pictures = () if folder is None else (_picture(found, folder),)
    each = [_study(scene, found[scene.name], pictures if scene is scenes[-1] else ()) for scene in scenes]
    return [*each, _seconds_for_errors(found)]


def _scenes(quick: bool) -> list[Scene]:
    beam, soft = cantilever(1 if quick else 2, length=1.0, thick=0.1, young=1e8), block(2 if quick else 4, (0.4, 0.1, 0.15))
    swing = beam.mesh.p[0][:, None] ** 2 * np.array([0.0, 10.0, -5.0])
    bent = modes(soft, 7).shapes[6]
    pulled = System(beam.mesh, [beam.terms[0], Gravity((0.0, 0.0, -50.0))], fixed={lambda x: x[0] == 0: "xyz"})
    beam_until, block_until, chosen = (0.05, 0.05, slice(-2, None)) if quick else (0.1, 0.3, slice(None))
    return [
        Scene("stiff beam", beam, solve_static(pulled, quiet=True).u, swing.ravel(), beam_until, BEAM_STEPS[chosen]),
        Scene(
            "soft block",
            soft,
            AMPLITUDE / np.abs(bent).max() * bent,
            np.cross(SPIN, soft.mesh.p.T).ravel(),
            block_until,
            BLOCK_STEPS[chosen],
        ),
    ]


def _points(scene: Scene, quick: bool) -> dict[tuple[str, str], list[Point]]:
    """Return points by integrator and tangent; the tangent is empty for explicit integrators."""
    critical = critical_step(scene.system).step
    reference = _reference(scene, critical)
    found = {(one.__name__, ""): [_point(scene, one(dt=part * critical), reference) for part in PARTS] for one in EXPLICIT}
    for one in IMPLICIT:
        for tangent in _tangents(one, quick):
            steps = scene.steps if tangent == StepTangent.EXACT.value else scene.steps[-OTHERS:]
            found[one.__name__, tangent] = [_point(scene, one(dt=dt, **_options(one, tangent)), reference) for dt in steps]
    return found


def _reference(scene: Scene, critical: float) -> Array:
    """Return the reference displacements (ndofs,) at the end."""
    coarse, fine = (scene.until / (n * np.ceil(scene.until / critical)) for n in (8, 16))
    u, v = (
        simulate(scene.system, VelocityVerlet(dt=dt), until=scene.until, u0=scene.u0, v0=scene.v0, quiet=True).u
        for dt in (coarse, fine)
    )
    return (4 * v - u) / 3


def _tangents(kind: type[Any], quick: bool) -> list[str]:
    """Return all tangents for eq. 9 and energy-momentum, and only the exact tangent for the others."""
    several = kind in OF_ALL_TANGENTS and not quick
    return [one.value for one in StepTangent] if several else [StepTangent.EXACT.value]


def _options(kind: type[Any], tangent: str) -> dict[str, Any]:
    """Return options with a tolerance that is tight enough here; eq. 9 uses its own tolerance."""
    return {"tangent": tangent} | ({} if kind is LinearBackwardEuler else {"rtol": 1e-6})


def _point(scene: Scene, integrator: Integrator, reference: Array) -> Point:
    begin = perf_counter()
    with expected():
        run = simulate(scene.system, integrator, until=scene.until, u0=scene.u0, v0=scene.v0, quiet=True, raise_on_failure=False)
    seconds = perf_counter() - begin
    return Point(integrator, _error(run.u, reference) if run.success else float("nan"), seconds)


def _error(u: Array, reference: Array) -> float:
    return float(np.linalg.norm(u - reference) / np.linalg.norm(reference))


def seconds_to_reach(goal: float, points: Sequence[Point]) -> float:
    """Return the time for an error of `goal` by linear interpolation on logarithmic scales; NaN outside the measured errors."""
    good = sorted((point.error, point.seconds) for point in points if point.error < np.inf)
    if not good or not good[0][0] <= goal <= good[-1][0]:
        return float("nan")
    errors, seconds = np.log(np.array(good)).T
    return float(np.exp(np.interp(np.log(goal), errors, seconds)))


def _seconds_for_errors(found: dict[str, dict[tuple[str, str], list[Point]]]) -> Study:
    """Tabulate the times of explicit integrators, and of implicit ones with the exact tangent, for given errors."""
    heads = [f"{scene}: {goal:.0%}" for scene in found for goal in GOALS]
    rows = [
        (one.__name__, *(_in_time(goal, points[one.__name__, tangent]) for points in found.values() for goal in GOALS))
        for one, tangent in (*((one, "") for one in EXPLICIT), *((one, StepTangent.EXACT.value) for one in IMPLICIT))
    ]
    note = (
        "seconds, interpolated between runs; time and error of the cheapest run, if all runs are better; the best "
        "error, if no run is as good"
    )
    return Study("Seconds for an error", "", ("integrator", *heads), tuple(rows), notes=(note,))


def _in_time(goal: float, points: Sequence[Point]) -> str:
    """Return the time for an error, or a text if the error is outside the measured range."""
    seconds = seconds_to_reach(goal, points)
    if np.isfinite(seconds):
        return f"{seconds:.2g}"
    good = [point for point in points if np.isfinite(point.error)]
    if not good:
        return "fails"
    cheapest, best = min(good, key=lambda point: point.seconds), min(point.error for point in good)
    return f"{cheapest.seconds:.2g}, error {cheapest.error:.1g}" if best <= goal else f"best error {best:.1g}"


def _study(scene: Scene, found: dict[tuple[str, str], list[Point]], pictures: tuple[Path, ...]) -> Study:
    rows = [_row(*name, points) for name, points in found.items()]
    failures = [
        f"{name}: {points[-1].error:.1e} from the reference"
        for (name, tangent), points in found.items()
        if tangent in ("", StepTangent.EXACT.value) and points[-1].integrator.order == 2 and not points[-1].error <= CLOSE
    ]
    return Study(
        f"Work and precision: {scene.name}",
        f"second-order integrators come within {CLOSE:.0%} of the reference",
        ("integrator", "tangent", "dt in ms", "error", "seconds", *(f"s for {goal:.0%}" for goal in GOALS)),
        tuple(rows),
        tuple(failures),
        (
            f"{scene.system!r}, {scene.until:g} s; from the largest step to the smallest; implicit integrators with rtol = 1e-6, "
            "eq. 9 with CG and rtol = 1e-4",
        ),
        pictures,
    )


def _row(name: str, tangent: str, points: Sequence[Point]) -> tuple[str, ...]:
    ends = points[0], points[-1]
    steps = " ... ".join(f"{1e3 * float(point.integrator.dt or 0):.3g}" for point in ends)
    errors = " ... ".join("fails" if np.isnan(point.error) else f"{point.error:.0e}" for point in ends)
    seconds = " ... ".join(f"{point.seconds:.2g}" for point in ends)
    goals = (seconds_to_reach(goal, points) for goal in GOALS)
    return name, tangent, steps, errors, seconds, *("" if np.isnan(time) else f"{time:.2g}" for time in goals)


def _picture(found: dict[str, dict[tuple[str, str], list[Point]]], folder: Path) -> Path:
    """Plot one panel per scene; tangents other than the exact one are dashed."""
    figure = Figure(figsize=(6.4, 4.4), layout="constrained")
    names = [one.__name__ for one in (*EXPLICIT, *IMPLICIT)]
    for axes, (scene, several) in zip(figure.subplots(1, len(found)), found.items(), strict=True):
        for (name, tangent), points in several.items():
            first = tangent in ("", StepTangent.EXACT.value)
            number, seconds, errors = names.index(name), [p.seconds for p in points], [p.error for p in points]
            style = {"marker": MARKERS[number]} if first else {"lw": 0.9, "ls": "--", "mfc": "none", "marker": MARKS[tangent]}
            axes.loglog(seconds, errors, color=COLOURS[number], label=name if first else None, ms=4.5, **style)
            if first and name in SLOPES:
                draw_slope(axes, seconds, errors, SLOPES[name], below=SLOPES_BELOW)
        axes.set(xlabel="wall time [s]")
        axes.set_title(scene, fontsize=9)
        axes.tick_params(labelsize=9)
        axes.grid(True, alpha=0.3)
        axes.margins(y=0.1)
        axes.xaxis.set_minor_formatter(NullFormatter())
    figure.axes[0].set_ylabel("error of the displacements at the end")
    dashed = [Line2D([], [], color="#666666", ls="--", mfc="none", marker=mark, ms=4.5, label=name) for name, mark in MARKS.items()]
    handles = [*figure.axes[0].get_legend_handles_labels()[0], *dashed]
    figure.legend(handles=handles, loc="outside upper center", ncols=3, fontsize=9, frameon=False)
    write_machine(figure)
    path = folder / "dynamics-work-precision.png"
    figure.savefig(path, dpi=140)
    return path
