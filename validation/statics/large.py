"""The cantilever with a million unknowns by conjugate gradients with algebraic multigrid: time, memory and growth of both."""

from __future__ import annotations

import resource
from typing import NamedTuple

from skfem_stvk.linear import AmgCg

from . import with_edges
from .cantilever import Run, cantilever
from .orders import fitted_order
from .study import Study

#: Cells across: 48 000, 227 000 and 1 013 000 unknowns.
SIZES, QUICK_SIZES = (14, 24, 40), (4, 6)
MOST_GIGABYTES, MOST_SECONDS, MOST_GROWTH = 24.0, 1200.0, 1.2


class Large(NamedTuple):
    """Run, iterations of the linear solver, and peak memory of the process so far [GB]."""

    run: Run
    linear: int
    gigabytes: float


def large(quick: bool = False) -> Study:
    """Solve for a million unknowns by AMG-CG within 24 GB and 20 minutes, and fit the growth of the time."""
    with_edges.warm_up(AmgCg().name)
    runs = [_run(n) for n in (QUICK_SIZES if quick else SIZES)]
    growth = fitted_order([one.run.ndofs for one in runs], [one.run.total for one in runs])
    failures = [] if growth <= MOST_GROWTH or quick else [f"the time grows with the power {growth:.2f} of the unknowns"]
    last = runs[-1]
    if not (last.gigabytes <= MOST_GIGABYTES and last.run.total <= MOST_SECONDS):
        failures.append(f"{last.run.ndofs} unknowns take {last.gigabytes:.1f} GB and {last.run.total:.0f} s")
    return Study(
        "A million unknowns by AMG-CG",
        f"within {MOST_GIGABYTES:g} GB and {MOST_SECONDS / 60:g} minutes"
        + ("" if quick else f"; the time grows with at most the power {MOST_GROWTH:g} of the unknowns"),
        ("unknowns", "Newton", "CG", "assemble", "factor", "solve", "other", "total [s]", "peak [GB]"),
        tuple(map(_row, runs)),
        tuple(failures),
        (f"growth: power {growth:.2f}", "the peak memory is of the whole process, including earlier runs in it"),
    )


def _run(n: int) -> Large:
    run, result = with_edges.solve(cantilever(n), AmgCg().name)
    linear = sum(sum(step.iterations.linear) for step in (*result.history, *result.history.attempts))
    return Large(run, linear, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2)


def _row(one: Large) -> tuple[str, ...]:
    run = one.run
    parts = (f"{run.seconds[part]:.1f}" for part in ("assemble", "factor", "solve", "other"))
    return str(run.ndofs), str(run.iterations), str(one.linear), *parts, f"{run.total:.1f}", f"{one.gigabytes:.2f}"
