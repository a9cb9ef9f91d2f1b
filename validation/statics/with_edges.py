"""Cantilever with this package."""

from __future__ import annotations

import skfem

from skfem_stvk import StVK, System, Traction, solve_static
from skfem_stvk.solvers.statics import StaticResult

from .cantilever import POISSON, RTOL, TRACTION, YOUNG, Run, end_centre, timed


def solve(mesh: skfem.MeshTet, solver: str = "auto") -> tuple[Run, StaticResult]:
    """Solve with automatic load steps; return the run and the result."""
    seconds: dict[str, float] = {}
    with timed(seconds, "other"):
        system = System(mesh, [StVK(young=YOUNG, poisson=POISSON), Traction("tip", TRACTION)], fixed={"wall": "xyz"})
        result = solve_static(system, steps=10, rtol=RTOL, solver=solver, quiet=True)
    seconds["other"] -= sum(time for part, time in result.seconds.items() if part != "other")
    seconds = {part: result.seconds[part] for part in ("assemble", "factor", "solve")} | seconds
    tip = result.u.reshape(-1, 3)[end_centre(mesh)]
    return Run("edges P1", system.ndofs, tip, result.history.iterations, seconds), result


def warm_up(*solvers: str) -> None:
    """Compile the kernels and load the libraries, so that neither is timed."""
    from .cantilever import cantilever

    for solver in solvers:
        solve(cantilever(2), solver)
