"""Quasi-static solves."""

from __future__ import annotations

import os
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from ..arguments import Array, choice, flag, number, shown, whole
from ..errors import LoadError, StvkError, warn
from ..linear import LinearSolver, choose
from ..mesh.displacements import by_vertex
from ..nonlinear.outcome import Interrupted, Status
from ..nonlinear.stability import Verdict, judged
from ..nonlinear.stopwatch import Stopwatch
from ..results.monitors import Monitors
from ..results.outlets import Outlets
from ..system import System
from ..system.free_tangent import kind_of, with_loads
from ..system.system import checked_system
from .arc_length import ArcLength
from .branch_end import branch_end
from .equilibrium import Equilibrium
from .history import History, Step, found_status
from .load_steps import LoadSteps
from .message import reason
from .outputs import PathProgress, opened
from .result import SolveError, StaticResult
from .stop import Goal, Stop
from .walk import Walk

METHODS = (LoadSteps.name, ArcLength.name)


def solve_static(
    system: System,
    steps: int = 10,
    *,
    method: str = LoadSteps.name,
    stop: Stop | None = None,
    solver: str | LinearSolver = "auto",
    rtol: float = 1e-8,
    u0: ArrayLike | None = None,
    t0: float = 0.0,
    stability: bool = False,
    ellipticity: bool = False,
    save: str | os.PathLike[str] | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    resume: bool = False,
    overwrite: bool = False,
    quiet: bool = False,
    raise_on_failure: bool = True,
) -> StaticResult:
    """Equilibrium `F(u) = f_ext(u, t)` on the path from t = 0, along which loads and prescribed displacements grow.

    Newton's method with the exact tangent where its step is one of descent and the tangent without negative tensions where it is not, the
    line search exact where W is a quartic along lines; steps grow and are cut back as they succeed and fail. A step in which elements would
    turn inside out is cut back too.

    Parameters
    ----------
    system : with `fixed` and `prescribed` supports that leave no rigid motion.
    steps : the first step is 1/steps of the load.
    method : "load-steps" to t = 1; or "arc-length", which follows the path by its length through limit points, where the load turns back and
        the body would snap, and through bifurcations, as far as `stop` says. Unstable states on it are what is asked for: they do not raise.
    stop : of arc length, by default `Stop(load=1.0)`.
    solver : "auto", "superlu", "pardiso", "amg-cg", "block-jacobi-cg", "ssor-cg", or an object of `skfem_stvk.linear`; see "how to choose a solver".
        Arc length takes direct ones.
    rtol : the residual's 2-norm is small enough below `rtol` times that of the loads plus that of the reactions.
    u0, t0 : (ndofs,) displacements to start from [m] and their load factor, by default none at 0.
    stability : find the lowest eigenvalue of K at each state where the solver does not count negative ones, as direct ones do anyway.
    ellipticity : look at each state for elements that have lost strong ellipticity.
    save : a .pvd file that is written as the states are found, with one .vtu each.
    checkpoint : a folder that keeps each state as it is found.
    resume : go on with the states that `checkpoint` holds, if any; another `stop` may be given. Otherwise they are replaced.
    overwrite : let `save` and `checkpoint` replace what belongs to another problem, with another mesh, other terms, supports or options.
    quiet : print nothing.
    raise_on_failure : raise where the result is no success; otherwise look at `result.status`. What interrupts the path, such as Ctrl-C or
        a full disk, is raised in any case.

    Raises
    ------
    LoadError, SupportError
        if nothing acts on the body, or its supports leave rigid motions or mechanisms, which are counted and named.
    SolveError
        if no stable state at the end was found, or something failed on the way, such as a load's function or the disk; it says why
        and what to try, and carries the result so far.
    StvkError
        for other parameters that are not as they should be; where `save` or `checkpoint` belong to another problem, or are being written by
        another run.

    Warns
    -----
    StvkWarning
        where the model is not to be trusted: elements that lock, or are pressed beyond where the material softens; see `step.findings`.

    >>> import skfem
    >>> from skfem_stvk import StVK, System, Traction, solve_static
    >>> beam = skfem.MeshTet.init_tensor(np.linspace(0, 4, 17), np.linspace(0, 1, 5), np.linspace(0, 1, 5))
    >>> system = System(
    ...     beam,
    ...     [StVK(young=1e5, poisson=0.3), Traction(lambda x: x[0] == 4, (0, 0, -500.0))],
    ...     fixed={lambda x: x[0] == 0: "xyz"},
    ... )
    >>> result = solve_static(system, steps=4, quiet=True)
    >>> result.status.value, round(float(result.reaction().resultant[2]))
    ('converged', 500)
    """
    quiet, raise_on_failure = flag("quiet", quiet), flag("raise_on_failure", raise_on_failure)
    start = _checked(system, steps, method, stop, rtol, u0, t0, stability, ellipticity)
    outlets = Outlets.checked(save, checkpoint, resume, overwrite)
    system.check_held()
    arc_length = method == ArcLength.name
    chosen = choose(solver, system.ndofs - len(system.supports.held), kind_of(system), indefinite=arc_length)
    solver = with_loads(chosen, system)
    monitors, watch, history = Monitors(system, ellipticity), Stopwatch(), History()
    options = {"method": method, "steps": int(steps), "rtol": float(rtol), "solver": solver.name, "t0": float(t0)}
    cause: BaseException | None = None
    verdict = Verdict(True, None)
    branch = ""
    free = system.ndofs - len(system.supports.held)
    header = f"{system!r}, {free} of them free; solver '{solver.name}'"
    with opened(outlets, system, options, start) as (write, kept), PathProgress(header, quiet) as report:
        for finding in monitors.before():
            warn(finding.text)
        problem = Equilibrium(system, solver, watch)
        common = problem, start, float(t0), float(rtol), monitors, stability, report.iterating
        first = 1 / int(steps)
        walk = ArcLength(first, Goal(stop or Stop(load=1.0), system), *common) if arc_length else LoadSteps(first, *common)
        found = [] if kept is None else kept.steps
        if kept is not None and found:
            walk.resume(found, kept.saved)
        try:
            if kept is not None and found:
                report.resumed(kept.folder, len(found))
            for step in found:
                history.append(step)
                report.line(step)
                write(step.t if not arc_length else len(history), step)
            for outcome in walk.states(resumed=bool(found)):
                history.append(outcome)
                report.line(outcome)
                if isinstance(outcome, Step):
                    write(outcome.t if not arc_length else len(history), outcome)
                    if kept is not None:
                        kept.add(outcome, walk.saved())
            if walk.reached:
                verdict = _verdict(problem, walk, history[-1])
            elif len(history) and not history[-1].negative:
                branch = branch_end(problem, start, float(t0), walk.u, walk.t)
        except (KeyboardInterrupt, Exception) as error:  # a full disk, a load's function that fails: the states so far are kept
            cause = error
    result = _result(problem, walk, start, history, watch, verdict, branch, solver.name, cause)
    for text in _new_findings(history):
        warn(text)
    if isinstance(cause, KeyboardInterrupt):
        raise Interrupted(result)
    expected = result.success or (arc_length and result.status is Status.UNSTABLE)
    if cause is not None or (raise_on_failure and not expected):
        raise SolveError(result) from cause
    return result


def _new_findings(history: History) -> Iterator[str]:
    """What the monitors found on the path, where they first did; of elements inside out the states say it themselves."""
    known = {"inside out"}
    for step in history:
        for finding in step.findings:
            if finding.name not in known:
                known.add(finding.name)
                yield f"From t = {step.t:.4g} on: {finding.text}"


def _checked(
    system: System,
    steps: int,
    method: str,
    stop: Stop | None,
    rtol: float,
    u0: ArrayLike | None,
    t0: float,
    stability: bool,
    ellipticity: bool,
) -> Array:
    """The displacements to start from; refuses parameters that make no sense."""
    if checked_system(system).dtype != np.float64:
        raise StvkError(
            f"The system is in {system.dtype}, whose residuals stop at 1e-6; expected float64: System(..., dtype=np.float64)."
        )
    choice("method", method, METHODS)
    if stop is not None and (method != ArcLength.name or not isinstance(stop, Stop)):
        raise StvkError(
            f"stop = {shown(stop)} with method {method!r}; expected a Stop(...), with method='arc-length'. Load steps end at t = 1."
        )
    number("rtol", rtol, "a number between 0 and 1, such as 1e-8", 0.0, 1.0)
    whole("steps", steps, "a whole number of at least 1: the first step is 1/steps of the load", 1)
    begin = number("t0", t0, "the load factor of u0, a number")
    if method == LoadSteps.name and not begin < 1:
        raise StvkError(f"t0 = {shown(t0)}; expected less than 1, where load steps end.")
    for name, value in (("stability", stability), ("ellipticity", ellipticity)):
        flag(name, value)
    if u0 is None and not system.supports.prescribed.size and not system.loads:
        raise LoadError(
            "Nothing acts on the body: no load, nothing prescribed. Add Gravity(...), Traction(...) or prescribed={...}."
        )
    start = np.zeros(system.ndofs) if u0 is None else np.array(by_vertex(system.mesh, u0, "u0"), dtype=np.float64).ravel()
    system.energy(start)  # refuses what overflows
    return start


def _verdict(problem: Equilibrium, walk: Walk, last: Step) -> Verdict:
    """What is known of the stability of the last state."""
    if walk.name == ArcLength.name and last.negative is not None and problem.symmetric:
        return Verdict(not last.negative, last.negative)
    if last.lowest is not None and last.lowest < 0:
        return Verdict(False, None)
    return judged(problem, last.u, last.t)


def _result(
    problem: Equilibrium,
    walk: Walk,
    start: Array,
    history: History,
    watch: Stopwatch,
    verdict: Verdict,
    branch: str,
    asked: str,
    cause: BaseException | None,
) -> StaticResult:
    t, u = walk.t, walk.u
    inverted = problem.inside_out(u)
    if cause is not None:
        status = Status.INTERRUPTED
    elif not walk.reached:
        status = Status.STOPPED
    else:
        status = Status.INVERTED if len(inverted) else found_status(history[-1].end) if verdict.stable else Status.UNSTABLE
        history.judge_last(status)
    named = problem.named(inverted) if len(inverted) else ""
    message = reason(status, walk.name, problem.system, history, t, verdict, named, branch, bool(start.any()), cause)
    if problem.solver.name != asked:
        message += f" '{asked}' met its round-off in this body, and '{problem.solver.name}' took over."
    return StaticResult(problem.system, u, t, status, message, history, problem.solver.name, watch.parts())
