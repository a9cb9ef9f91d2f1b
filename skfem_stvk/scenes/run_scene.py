"""From a scene to its results: the analysis, the curves of probes and reactions, and the comparison with expectations."""

from __future__ import annotations

import re
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from typing import Any

import numba
import numpy as np

from ..arguments import Array
from ..errors import LoadError, SceneError, StvkError, StvkWarning, SupportError, warn
from ..kernels.threads import threads
from ..mesh.locations import vertices_at
from ..mesh.mesh import parts_line
from ..results.reactions import ReactionPlace, ground_forces_at_rest
from ..solvers.dynamics import Modes, Run, SimulationError, modes, simulate
from ..solvers.dynamics.loop import REPORTED
from ..solvers.newton.outcome import Interrupted, Status, finishing_steps
from ..solvers.statics import SolveError, StaticResult, solve_static
from .build import ENERGIES, Built, expectations
from .complaints import Complaints
from .folder import Folder
from .scene_outcome import ComparedResult, Curve, SceneOutcome, largest_displacement, largest_stress, summary
from .schema import SceneTables
from .schema.analyses import ArcLengthAnalysis, DynamicAnalysis, ModesAnalysis, StaticAnalysis, stop_of

#: Default tolerance of the residual of a static state, as a fraction of loads and reactions.
RTOL = 1e-8


def solve(built: Built, folder: Folder | None = None, *, quiet: bool = False) -> SceneOutcome:
    """Solve a scene; states and checkpoints are written into the folder, if one is passed.

    Ctrl-C ends the analysis after its current step, a second one at once.

    Raises
    ------
    StvkError
        if the analysis refuses its input: a SceneError if a key is the cause. The outcome says whether it converged.

    Warns
    -----
    StvkWarning
        for a motion that diverged on the way, or whose steps gained energy.
    """
    sections, begin = built.sections, time.perf_counter()
    steps = nullcontext() if isinstance(sections.analysis, ModesAnalysis) else finishing_steps()
    with on_threads(sections.threads), _recorded_warnings() as warned, steps:
        with _with_key(built):
            result = _run_analysis(built, folder, quiet)
        if isinstance(result, Run) and result.success and (result.blow_ups or result.gained > REPORTED):
            warn(_energy_message(result))
    curves = {} if isinstance(result, Modes) else _curves(built, result)
    last = {name: curve.values[-1] for name, curve in curves.items()}
    if not isinstance(result, Modes):
        last |= {contact.name: contact.resultant for contact in result.contacts}
    stress = None if isinstance(result, Modes) else largest_stress(result)
    values = _values(result) | ({} if stress is None else {"stress.largest": stress.value})
    values |= {
        f"{name}.{axis}": float(value) for name, components in last.items() for axis, value in zip("xyz", components, strict=False)
    }
    status, message = ("finished", repr(result)) if isinstance(result, Modes) else (result.status.value, result.message)
    unstable = isinstance(sections.analysis, ArcLengthAnalysis) and status == Status.UNSTABLE.value
    success = isinstance(result, Modes) or result.success or unstable  # a path may end in unstable states
    judged = _judged(sections, values) if success else ()
    return SceneOutcome(
        built=built,
        result=result,
        success=success,
        status=status,
        message=message,
        curves=curves,
        values=values,
        judged=judged,
        summary=tuple(summary(built, result, curves, values, stress)),
        seconds=time.perf_counter() - begin,
        folder=None if folder is None else folder.path,
        warnings=tuple(warned),
        ranks=parts_line(built.mesh).lstrip(),
    )


def _run_analysis(built: Built, folder: Folder | None, quiet: bool) -> StaticResult | Run | Modes:
    """Return the result of the analysis, or its states so far if it was interrupted or failed."""
    analysis, solver, initial = built.sections.analysis, built.sections.solver, built.sections.initial
    files: dict[str, Any] = {} if folder is None else folder.output_arguments(built.sections)
    basis, system = built.sections.reduced, built.system
    with _with_key(built, "reduced"):
        body = system if basis is None else basis.of_body(system, quiet)
    if basis is not None and not isinstance(analysis, DynamicAnalysis):
        files = {name: value for name, value in files.items() if name not in ("checkpoint", "resume")}  # it starts again
    try:
        if isinstance(analysis, DynamicAnalysis):
            return simulate(
                body,
                built.integrator,
                until=analysis.until,
                u0=built.u0,
                v0=built.v0,
                t0=initial.t0,
                mass=analysis.mass,
                damping=analysis.damping.of_library(),
                probes=built.probes,
                reactions=built.reactions,
                remove=None if analysis.remove is None else analysis.remove.rule(),
                every=built.sections.output.every,
                quiet=quiet,
                raise_on_failure=False,
                **files,
            )
        if isinstance(analysis, ModesAnalysis):
            return modes(system, analysis.n, u=built.u0, t=analysis.load, mass=analysis.mass, solver=solver.name)
        return solve_static(
            body,
            analysis.steps,
            method="arc-length" if isinstance(analysis, ArcLengthAnalysis) else "load-steps",
            stop=_stop(built, analysis),
            solver=solver.name,
            rtol=RTOL if solver.rtol is None else solver.rtol,
            u0=built.u0,
            t0=initial.t0,
            stability=analysis.stability,
            quiet=quiet,
            raise_on_failure=False,
            **files,
        )
    except Interrupted as interrupted:
        found: StaticResult | Run = interrupted.result
        return found
    except (SolveError, SimulationError) as error:
        if not isinstance(error.__cause__, OSError | StvkError):  # usually a full disk
            raise
        return error.result if isinstance(error, SolveError) else error.run


@contextmanager
def _with_key(built: Built, *loc: str) -> Iterator[None]:
    """Complain about a key of the scene where supports, loads or the table at `loc` are refused."""
    try:
        yield
    except SceneError:
        raise
    except StvkError as error:
        found = re.match(r"(size|modes) = ", str(error))
        if isinstance(error, SupportError):
            moved = built.sections.prescribed and not str(error).startswith("Not held")
            loc = ("prescribed",) if moved else ("fixed",)
        elif isinstance(error, LoadError):
            loc = ("terms",)
        elif loc and found:
            loc = (*loc, found[1])
        if not loc:
            raise
        complaints = Complaints(built.source)
        complaints.add(loc, str(error))
        complaints.refuse()


def _energy_message(run: Run) -> str:
    """Return the message on the energy that a completed motion gained."""
    times = "once" if run.blow_ups == 1 else f"{run.blow_ups} times"
    up = f"The motion blew up {times}, and its steps" if run.blow_ups else "The steps"
    part = f"{'gained' if run.gained > 0 else 'lost'} {abs(run.gained) * 100:.2g} % of the energy"
    return f"{up} {part}. Use a smaller dt or an implicit integrator. [expect] can limit energy_gained and blow_ups."


def _stop(built: Built, analysis: StaticAnalysis | ArcLengthAnalysis) -> Any:
    if not isinstance(analysis, ArcLengthAnalysis):
        return None
    level = analysis.stop.displacement
    return stop_of(analysis.stop, None if level is None else built.names.place(level.at))


def _curves(built: Built, result: StaticResult | Run) -> dict[str, Curve]:
    """Return displacements of the probes and forces at the reactions, over the times or load factors."""
    d = built.mesh.d
    if isinstance(result, Run):
        ledger = result.ledger

        def columns(name: str) -> Array:
            return np.stack([ledger[f"{name} {axis}"] for axis in "xyz"[:d]], axis=1)

        return {name: Curve(ledger["time"], columns(name), "length") for name in built.probes} | {
            name: Curve(ledger["time"], columns(f"reaction {name}"), "force") for name in built.reactions
        }
    states = [(step.t, step.u) for step in result.history] or [(result.t, result.u)]
    t, space = np.array([one for one, _ in states]), built.system.space
    counted = space.counted(np.ones(built.mesh.nv))

    def total(values: Array, weights: Array) -> Array:
        return space.comm.total((weights[:, None] * values).sum(axis=0))

    curves = {}
    for name, where in built.probes.items():
        at = vertices_at(built.mesh, where, name)
        weights = counted[at]
        count = space.comm.total(float(weights.sum()))
        curves[name] = Curve(t, np.array([total(u.reshape(-1, d)[at], weights) / count for _, u in states]), "length")
    if built.reactions:
        forces = [ground_forces_at_rest(built.system, u, one, result.projected) for one, u in states]
        for name, where in built.reactions.items():
            place = ReactionPlace.of(built.system, where, name)
            curves[name] = Curve(t, np.array([total(place.forces(each), counted[place.vertices]) for each in forces]), "force")
    return curves


def _values(result: StaticResult | Run | Modes) -> dict[str, float]:
    """Return the results by dotted name; NaN for an energy that does not exist."""
    if isinstance(result, Modes):
        return {f"frequency.{number}": float(value) for number, value in enumerate(result.frequencies)} | {
            "modes.rigid": float(result.rigid.sum()),
            "modes.unstable": float(result.unstable.sum()),
        }
    common = {"displacement.largest": largest_displacement(result).value}
    smallest = float(result.system.smallest_volume_ratio(result.u))
    if np.isfinite(smallest):  # springs alone have none
        common["volume_ratio.smallest"] = smallest
    if isinstance(result, Run):
        ledger = result.ledger
        energies = {f"energy.{name}": float(ledger[column][-1]) for name, column in ENERGIES.items() if column in ledger}
        nowhere = {"energy_gained": result.gained, "blow_ups": float(result.blow_ups)}
        return {"time": result.t, "steps": float(ledger.steps - 1)} | energies | nowhere | common
    critical = {f"critical.{number}": float(point.t) for number, point in enumerate(result.critical_points)}
    critical["jumps"] = float(len(result.jumps))
    energy = {"energy.strain": float(sum(result.system.elastic_energies(result.u)))}
    return {"load": result.t, "steps": float(len(result.history))} | energy | critical | common


def _judged(sections: SceneTables, values: dict[str, float]) -> tuple[ComparedResult, ...]:
    """Return results with expectations; a result that does not exist is NaN, and not as expected."""
    judged = []
    for loc, one in expectations(sections.expect).items():
        name = ".".join(loc)
        got = values.get(name, float("nan"))
        allowed = one.atol if one.atol is not None else (one.rtol or 0.0) * abs(one.value)
        judged.append(ComparedResult(name, got, one.value, allowed, bool(abs(got - one.value) <= allowed)))
    return tuple(judged)


@contextmanager
def on_threads(count: int | None) -> Iterator[None]:
    """Run kernels on this number of threads, or on as many as before if it is None."""
    if count is None:
        yield
        return
    before = threads()
    numba.set_num_threads(count)
    try:
        yield
    finally:
        numba.set_num_threads(before)


@contextmanager
def _recorded_warnings() -> Iterator[list[str]]:
    """Collect the texts of this package's warnings; all warnings are still shown."""
    warned: list[str] = []
    show: Callable[..., None] = warnings.showwarning

    def note(message: Warning | str, category: type[Warning], *more: Any, **details: Any) -> None:
        if issubclass(category, StvkWarning):
            warned.append(str(message))
        show(message, category, *more, **details)

    with warnings.catch_warnings():
        warnings.showwarning = note
        yield warned
