"""Quasi-static solves."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import LoadError, StvkError
from ..linear import LinearSolver
from ..results import Fields, Series
from ..system import System
from ..terms import Load
from .equilibrium import Equilibrium
from .history import History, Step
from .message import reason
from .report import Report
from .result import Interrupted, SolveError, StaticResult
from .stability import stability
from .status import Status
from .stepping import follow
from .stopwatch import Stopwatch

Array = NDArray[Any]


def solve_static(
    system: System,
    steps: int = 10,
    *,
    solver: str | LinearSolver = "auto",
    rtol: float = 1e-8,
    u0: ArrayLike | None = None,
    save: str | Path | None = None,
    quiet: bool = False,
    raise_on_failure: bool = True,
) -> StaticResult:
    """Equilibrium `F(u) = f_ext(u, t)` on the path from t = 0 to t = 1, along which loads and prescribed displacements grow.

    Newton's method with the exact tangent where its step is one of descent and the tangent without negative tensions where it is not, the
    line search exact where loads have a potential (along any line the energy is a quartic); steps grow and are cut back as they
    succeed and fail. A step in which elements would turn inside out is cut back too.

    Parameters
    ----------
    system : with `fixed` and `prescribed` supports that leave no rigid motion.
    steps : the first step is 1/steps.
    solver : "auto", "superlu", "pardiso", "amg-cg", "block-jacobi-cg", or an object of `skfem_stvk.linear`; see "how to choose a solver".
    rtol : the residual's 2-norm is small enough below `rtol` times that of the loads plus that of the reactions.
    u0 : (ndofs,) displacements to start from [m], by default none.
    save : a .pvd file that is written as the states are found, with one .vtu each.
    quiet : print nothing.
    raise_on_failure : raise where the result is no success; otherwise look at `result.status`. What interrupts the path, such as Ctrl-C or
        a full disk, is raised in any case.

    Raises
    ------
    LoadError, SupportError
        if nothing acts on the body, or its supports leave rigid motions, which are counted and named.
    SolveError
        if no stable state under the full load was found, or something failed on the way, such as a load's function or the disk; it says why
        and what to try, and carries the result so far.
    StvkError
        for other parameters that are not as they should be.

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
    start = _checked(system, steps, rtol, u0)
    system.check_held()
    write = _writer(system, save)
    watch, history = Stopwatch(), History()
    problem = Equilibrium(system, solver, watch)
    cause: BaseException | None = None
    verdict: tuple[bool, int | None] = True, None
    with Report(f"{system!r}, {len(problem.free.free)} of them free; solver '{problem.solver.name}'", quiet) as report:
        try:
            for outcome in follow(problem, start, int(steps), float(rtol), report.iterating):
                history.append(outcome)
                if isinstance(outcome, Step):
                    write(outcome)
                report.line(outcome)
            if len(history) and history[-1].t == 1:
                verdict = stability(problem, history[-1].u, 1.0)
        except (KeyboardInterrupt, Exception) as error:  # a full disk, a load's function that fails: the states so far are kept
            cause = error
    result = _result(problem, start, history, watch, verdict, cause)
    if isinstance(cause, KeyboardInterrupt):
        raise Interrupted(result)
    if cause is not None or (raise_on_failure and not result.success):
        raise SolveError(result) from cause
    return result


def _writer(system: System, save: str | Path | None) -> Callable[[Step], object]:
    """What writes a state to the series of files `save`, if there is to be one."""
    if save is None:
        return lambda step: None
    if not isinstance(save, str | Path):
        raise StvkError(f"save = {save!r}; expected the path of a .pvd file.")
    series, fields = Series(save), Fields(system.mesh, system.elastic_terms)
    return lambda step: series.add(fields.at(step.u), step.t)


def _checked(system: System, steps: int, rtol: float, u0: ArrayLike | None) -> Array:
    """The displacements to start from; refuses parameters that make no sense."""
    if not isinstance(system, System):
        raise StvkError(f"A {type(system).__name__} came; expected a System: System(mesh, terms, fixed=..., prescribed=...).")
    if system.dtype != np.float64:
        raise StvkError(
            f"The system is in {system.dtype}, whose residuals stop at 1e-6; expected float64: System(..., dtype=np.float64)."
        )
    if isinstance(rtol, bool) or not isinstance(rtol, float | int | np.floating) or not 0 < rtol < 1:
        raise StvkError(f"rtol = {rtol!r}; expected a number between 0 and 1, such as 1e-8.")
    if not isinstance(steps, int | np.integer) or isinstance(steps, bool) or steps < 1:
        raise StvkError(f"steps = {steps!r}; expected a whole number of at least 1: the first step is 1/steps of the load.")
    if u0 is None and not system.supports.prescribed.size and not any(isinstance(term, Load) for term in system.terms):
        raise LoadError(
            "Nothing acts on the body: no load, nothing prescribed. Add Gravity(...), Traction(...) or prescribed={...}."
        )
    start = np.zeros(system.ndofs) if u0 is None else u0
    system.energy(start)  # refuses another type or length, and NaN
    return np.array(start, dtype=np.float64)


def _result(
    problem: Equilibrium,
    start: Array,
    history: History,
    watch: Stopwatch,
    verdict: tuple[bool, int | None],
    cause: BaseException | None,
) -> StaticResult:
    t, u = (history[-1].t, history[-1].u) if len(history) else (0.0, start)
    stable, negative = verdict
    inverted = problem.inside_out(u)
    if cause is not None:
        status = Status.INTERRUPTED
    elif t < 1:
        status = Status.STOPPED
    else:
        status = Status.INVERTED if len(inverted) else history[-1].end.status if stable else Status.UNSTABLE
        history.judge_last(status)
    named = problem.named(inverted) if len(inverted) else ""
    message = reason(status, history, t, negative, named, cause)
    return StaticResult(problem.system, u, t, status, message, history, problem.solver.name, watch.parts())
