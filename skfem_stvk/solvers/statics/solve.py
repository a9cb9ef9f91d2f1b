"""Quasi-static solves."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from rich.progress import BarColumn, TimeElapsedColumn

from ...arguments import Array, choice, flag, number, shown, whole
from ...errors import LoadError, StvkError, warn
from ...linear import LinearSolver
from ...linear.choose import header_text, is_auto
from ...mesh.displacements import by_vertex
from ...mesh.mesh import parts_line
from ...results.monitors import Monitors
from ...results.penetration import short_on_path
from ...system import System
from ...system.coordinates import Coordinates, ReducedLike, checked_system
from ...system.free_tangent import solver_for
from ...system.signature import AUTO, Fingerprint, sums_of
from ...system.system import for_analysis
from ...terminal import Progress
from ...units import remarks
from ..newton.newton import Iterations
from ..newton.outcome import Interrupted, Status, raise_if_divided, stop_if_requested
from ..newton.stability import Verdict, stability_of
from ..newton.stopwatch import Stopwatch
from ..runs.outputs import OutputFiles, StateSeries
from .arc_length import ArcLength
from .continuation import Continuation, ContinuationOptions
from .equilibrium import Equilibrium
from .history import Attempt, History, Step
from .load_steps import LoadSteps
from .message import Ending, branch_end, reason
from .path_checkpoint import PathCheckpoint
from .result import SolveError, StaticResult
from .stop import Stop, StopCriterion

METHODS = (LoadSteps.name, ArcLength.name)
#: Load factors at which loads and prescribed displacements are evaluated to identify a problem.
MOMENTS = 0.5, 1.0


def solve_static(
    system: System | ReducedLike,
    steps: int = 10,
    *,
    method: str = LoadSteps.name,
    stop: Stop | None = None,
    solver: str | LinearSolver = "auto",
    rtol: float = 1e-8,
    u0: ArrayLike | None = None,
    t0: float = 0.0,
    stability: bool = False,
    save: str | os.PathLike[str] | None = None,
    fields: Sequence[str] | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    resume: bool = False,
    overwrite: bool = False,
    quiet: bool = False,
    raise_on_failure: bool = True,
) -> StaticResult:
    """Find the equilibrium `F(u) = f_ext(u, t)` on a path from t = 0, along which the loads grow.

    Prescribed displacements grow with the loads. The method is Newton's method. It uses the exact tangent where this gives a
    direction of descent, and the tangent without negative tensions elsewhere. The line search is exact where W is a quartic along
    lines. Steps grow after success and are cut back after failure. A step in which elements would invert is cut back, too.

    Parameters
    ----------
    system
        Body with `fixed` and `prescribed` supports that leave no rigid motion; or a `ReducedSystem` of such a body. A reduced
        system has few coordinates, and takes no `solver` and no `checkpoint`.
    steps
        Number of load steps: the first is 1/steps of the load; later steps adapt.
    method
        Method that follows the path: "load-steps" to t = 1; or "arc-length", up to `stop`. Arc length follows the path through
        limit points, where the load reverses and the body would snap, and through bifurcations. Unstable states on this path are
        expected results and raise no error.
    stop
        End of an arc-length path, by default `Stop(load=1.0)`.
    solver
        Linear solver: "auto", "superlu", "pardiso", "amg-cg", "block-jacobi-cg", "ssor-cg", or an object of `skfem_stvk.linear`;
        see "how to choose a solver". Arc length needs a direct solver.
    rtol
        Relative tolerance: 2-norm of the residual over the sum of the 2-norms of loads and reactions.
    u0, t0
        Initial displacements (ndofs,) [m] and their load factor; by default zero displacements at 0.
    stability
        Find the lowest eigenvalue of K at each state where the solver does not count negative eigenvalues. Direct solvers always
        count them.
    save
        Path of a .pvd file that is written as the states are found, with one .vtu file each. On several ranks, each state has a
        .pvtu file, and a .vtu file of each rank.
    fields
        Fields in these files in addition to displacements, see `skfem_stvk.results.names()`; by default stresses and strains.
    checkpoint
        Path of a folder to which each state is written as it is found. On several ranks, each rank writes files of its own.
    resume
        Continue from the states in `checkpoint`, if any; `stop` may differ, and the number of ranks. Otherwise the states are
        replaced.
    overwrite
        Allow `save` and `checkpoint` to replace files of another problem, with another mesh, other terms, supports or options.
    quiet
        Print nothing.
    raise_on_failure
        Raise an error if the result is no success; otherwise check `result.status`. An interruption of the path, such as Ctrl-C or
        a full disk, is raised in any case.

    Returns
    -------
    StaticResult
        The last state, the path to it, and its `status`.

    Raises
    ------
    LoadError, SupportError, ContactError
        if nothing acts on the body, or its supports leave rigid motions or mechanisms. The message counts and names them. If
        bodies intersect at the start, or are on the wrong side of a shape.
    SolveError
        if no stable state at the end was found, or something failed on the way, such as a load's function or the disk. The error
        contains the reason, advice and the result so far.
    StvkError
        if another parameter is invalid; if `save` or `checkpoint` belong to another problem, or another run is writing them.

    Warns
    -----
    StvkWarning
        if the model is not reliable in some elements: they lock, or are compressed beyond the point where the material softens; or
        in a contact; see `step.findings`.

    Examples
    --------
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
    options = StaticOptions(
        steps=steps,
        method=method,
        stop=stop,
        solver=solver,
        rtol=rtol,
        t0=t0,
        stability=stability,
        output_files=OutputFiles.checked(save=save, fields=fields, checkpoint=checkpoint, resume=resume, overwrite=overwrite),
        quiet=quiet,
        raise_on_failure=raise_on_failure,
    )
    body = system.in_coordinates if isinstance(system, ReducedLike) else for_analysis(checked_system(system), False)
    return _Solve(body, u0, options).result()


@dataclass(frozen=True, kw_only=True)
class StaticOptions:
    """Keyword arguments of `solve_static`, see there; invalid ones are refused."""

    steps: int
    method: str
    stop: Stop | None
    solver: str | LinearSolver
    rtol: float
    t0: float
    stability: bool
    output_files: OutputFiles
    quiet: bool
    raise_on_failure: bool

    def __post_init__(self) -> None:
        choice("method", self.method, METHODS)
        if self.stop is not None and not (self.arc_length and isinstance(self.stop, Stop)):
            raise StvkError(
                f"stop = {shown(self.stop)} with method {self.method!r}; expected a Stop(...), with method='arc-length'. Load "
                "steps end at t = 1."
            )
        number("rtol", self.rtol, "a number between 0 and 1, such as 1e-8", 0.0, 1.0)
        whole("steps", self.steps, "a whole number of at least 1: the first step is 1/steps of the load", 1)
        begin = number("t0", self.t0, "the load factor of u0, a number")
        if not self.arc_length and not begin < 1:
            raise StvkError(f"t0 = {shown(self.t0)}; expected less than 1, where load steps end.")
        for name in ("stability", "quiet", "raise_on_failure"):
            flag(name, getattr(self, name))

    @property
    def arc_length(self) -> bool:
        """Whether the method is arc length."""
        return self.method == ArcLength.name

    def solver_for(self, body: System | Coordinates) -> LinearSolver | None:
        """Return the linear solver for a body, None for a reduced system; refuse options that a reduced system does not support."""
        if isinstance(body, System):
            self._refuse_on_parts(body)
            return solver_for(body, self.solver, self.arc_length)
        if not is_auto(self.solver):
            raise StvkError(
                f"solver = {shown(self.solver)}; expected 'auto' for a reduced system, whose matrices are small and dense."
            )
        if self.output_files.checkpoint is not None:
            raise StvkError(
                f"checkpoint = {shown(str(self.output_files.checkpoint))}; expected None for a reduced system, whose solves take "
                "less time than writing a file. Leave checkpoint and resume out; save=... writes the states."
            )
        return None

    def _refuse_on_parts(self, system: System) -> None:
        """Refuse options that a body which is divided into parts does not support."""
        if self.arc_length:
            factors = "the path is followed with factors of the whole K, which no part has."
            system.space.comm.refuse_divided("method = 'arc-length'", "'load-steps'", factors)
        if self.stability:
            eigenvalues = "eigenvalues of K are not computed, because no part has the whole K. Each result has a test of its state."
            system.space.comm.refuse_divided("stability = True", "False", eigenvalues)

    def signature(self, solver: str) -> dict[str, Any]:
        """Return the options that identify a problem in a checkpoint. `solver` is the name of the linear solver."""
        return {
            "method": self.method,
            "steps": int(self.steps),
            "rtol": float(self.rtol),
            "solver": solver,
            "t0": float(self.t0),
        }


def _start(system: System, u0: ArrayLike | None, t0: float) -> Array:
    """Return the initial displacements.

    Refuse a system on which nothing acts, or that can move without strain.
    """
    if system.dtype != np.float64:
        raise StvkError(
            f"dtype = {system.dtype} of the system, whose residuals stop at 1e-6; expected float64: System(..., dtype=np.float64)."
        )
    acted_on = system.loads or system.contacts or system.space.comm.any(system.supports.prescribed.size > 0)
    if u0 is None and not acted_on:
        raise LoadError(
            "Nothing acts on the body: no load, nothing prescribed. Add Gravity(...), Traction(...) or prescribed={...}."
        )
    start = np.zeros(system.ndofs) if u0 is None else np.array(by_vertex(system.mesh, u0, "u0"), dtype=np.float64).ravel()
    system.elastic_energies(start, t0)  # raises an error on overflow
    with system.units.of_errors():
        for contact in system.contacts_at(t0):
            contact.refuse_start(start.reshape(-1, system.mesh.d))
    system.check_held(start, t0)
    return start


class _Solve:
    """One solve: continuation along the path, output on the way, and evaluation of the result."""

    def __init__(self, body: System | Coordinates, u0: ArrayLike | None, options: StaticOptions) -> None:
        self._system = system = body.system if isinstance(body, Coordinates) else body
        self._options, self._watch, self._history, self._t0 = options, Stopwatch(), History(), float(options.t0)
        solver = options.solver_for(body)
        self._start = _start(system, u0, self._t0)
        self._problem = Equilibrium(body, solver, self._watch)
        self._requested_solver = self._problem.tangent.solver.name
        self._verdict, self._branch = Verdict(True, None), ""
        self._cause: BaseException | None = None

    def result(self) -> StaticResult:
        """Return the result, or raise the error that replaces it."""
        options, history, problem, space = self._options, self._history, self._problem, self._system.space
        with ExitStack() as stack:
            self._open_files(stack)
            self._progress = stack.enter_context(Progress("statics", options.quiet, (BarColumn(), TimeElapsedColumn())))
            self._progress.show(total=1.0)
            solver = header_text(problem.tangent.solver, problem.space.comm.divided)
            free = f"{problem.body!r}, {problem.space.count} of them free"
            self._progress.print(f"{free}; {solver}{parts_line(self._system.mesh)}{remarks(self._system)}")
            continuation = self._continuation()
            try:
                self._follow(continuation)
                self._judge(continuation)
            except (KeyboardInterrupt, Exception) as error:  # for example a full disk, a load's function: keep the states so far
                raise_if_divided(space.comm, error)
                self._cause = error
        result = self._evaluated(continuation)
        for text in _new_findings(history):
            warn(text)
        space.comm.end_step(False)  # issues the last warnings
        if isinstance(self._cause, KeyboardInterrupt):
            raise Interrupted(result)
        expected = result.success or (options.arc_length and result.status is Status.UNSTABLE)
        if self._cause is not None or (options.raise_on_failure and not expected):
            raise SolveError(result) from self._cause
        return result

    def _open_files(self, stack: ExitStack) -> None:
        """Open the requested series and checkpoint, locked against other writers until the end of `stack`."""
        files, system, body = self._options.output_files, self._system, self._problem.body
        start = {"u0": sums_of(self._start, system.space)}
        if isinstance(body, Coordinates):
            start["the basis"] = body.signature
        solver = AUTO if self._problem.space.comm.divided and is_auto(self._options.solver) else self._requested_solver
        problem = Fingerprint("path of equilibria", system, self._options.signature(solver), MOMENTS, start)
        self._checkpoint = self._series = None
        if files.checkpoint is not None:
            self._checkpoint = stack.enter_context(PathCheckpoint(files.checkpoint, system, problem, files))
        if files.save is not None:
            self._series = stack.enter_context(StateSeries(files.save, system, problem, files))

    def _continuation(self) -> Continuation:
        """Return the continuation from the start, or from the last state of the checkpoint."""
        options, problem, body, monitors = self._options, self._problem, self._problem.body, Monitors(self._system)
        for finding in monitors.before():
            warn(finding.text)
        self._initial = start = body.state(self._start, self._t0) if isinstance(body, Coordinates) else self._start
        path_options = ContinuationOptions(
            1 / int(options.steps), float(options.rtol), monitors, options.stability, self._show_iteration
        )
        continuation: Continuation
        if options.arc_length:
            stop = StopCriterion(options.stop or Stop(load=1.0), self._system, problem.states)
            continuation = ArcLength(problem, start, self._t0, path_options, stop)
        else:
            continuation = LoadSteps(problem, start, self._t0, path_options)
        if self._checkpoint is not None and self._checkpoint.steps:
            continuation.resume(self._checkpoint.steps, self._checkpoint.saved)
        return continuation

    def _show_iteration(self, t: float, record: Iterations) -> None:
        self._progress.show(description=f"t {t:.4g}, iteration {len(record)}, residual {record.residuals[-1]:.1e}")

    def _follow(self, continuation: Continuation) -> None:
        """Record the states of the checkpoint and the states that follow."""
        checkpoint = self._checkpoint
        if checkpoint is not None and checkpoint.steps:
            self._progress.print(f"read from {checkpoint.folder}: {len(checkpoint.steps)} states")
            for step, history in zip(checkpoint.steps, checkpoint.histories, strict=True):
                self._problem.begin_step(history)
                self._record(step)
        for outcome in continuation.states(resumed=bool(self._history)):
            self._record(outcome)
            if isinstance(outcome, Step) and checkpoint is not None:
                checkpoint.add(outcome, continuation.saved())
                continuation.problem.forget()
            if not continuation.next.reached:
                stop_if_requested(self._system.space.comm)

    def _record(self, outcome: Step | Attempt) -> None:
        """Record a state or a failed step in the history, print it, and write a state to the series."""
        self._history.record(outcome)
        if isinstance(outcome, Attempt):
            self._progress.print(str(outcome))
            return
        self._progress.print(outcome.line(self._system.space.comm))
        self._progress.show(completed=min(max(outcome.t, 0.0), 1.0))
        for point in outcome.critical:
            self._progress.print(str(point))
        if self._series is not None:
            t = len(self._history) if self._options.arc_length else outcome.t
            self._series.add_state(t, self._system, outcome.u, self._problem.moment(outcome.t))

    def _judge(self, continuation: Continuation) -> None:
        """Check the stability of the last state; if the path stopped early, check whether its branch ends there."""
        history, problem = self._history, self._problem
        if not continuation.next.reached:
            if history and not history[-1].negative and not problem.space.comm.divided:
                self._branch = branch_end(problem, self._initial, self._t0, continuation.u, continuation.t)
            return
        last = history[-1]
        if self._options.arc_length and last.negative is not None and problem.symmetric:
            self._verdict = Verdict(not last.negative, last.negative)
        elif last.lowest is not None and last.lowest < 0:
            self._verdict = Verdict(False, None)
        else:
            self._verdict = stability_of(problem, continuation.u, last.t)

    def _evaluated(self, continuation: Continuation) -> StaticResult:
        problem, history = self._problem, self._history
        t, u, inverted = continuation.t, problem.states.expand(continuation.u), problem.inside_out(continuation.u)
        if self._cause is not None:
            status = Status.INTERRUPTED
        elif not continuation.next.reached:
            status = Status.STOPPED
        else:
            found = history[-1].end.status if self._verdict.stable else Status.UNSTABLE
            status = Status.INVERTED if len(inverted) else found
            history[-1] = replace(history[-1], status=status)
        if self._system.contacts and history:
            findings = (*history[-1].findings, *short_on_path(self._system, history.t, history.u))
            history[-1] = replace(history[-1], findings=findings)
        message = reason(
            Ending(
                system=self._system,
                status=status,
                method=continuation.name,
                history=history,
                t0=self._t0,
                t=t,
                verdict=self._verdict,
                inverted=problem.named(inverted),
                branch=self._branch,
                started=self._system.space.comm.any(bool(self._start.any())),
                cause=self._cause,
            )
        )
        solver, parts, projected = problem.tangent.solver.name, self._watch.parts(), problem.body is not self._system
        if solver != self._requested_solver:
            message += f" '{self._requested_solver}' stopped at its round-off in this body, so '{solver}' took over."
        return StaticResult(self._system, u, t, status, message, history, solver, parts, projected, problem.step)


def _new_findings(history: History) -> Iterator[str]:
    """Yield the findings of the monitors, each at its first state on the path.

    Inverted elements are omitted, because the status of the states reports them.
    """
    known = {"inside out"}
    for step in history:
        for finding in step.findings:
            if finding.name not in known:
                known.add(finding.name)
                yield f"From t = {step.t:.4g} on: {finding.text}"
