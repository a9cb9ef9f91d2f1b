"""Cantilever in large bending: time by part, against scripts that competent users of scikit-fem and FElupe write."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np

from skfem_stvk.linear import AmgCg, Pardiso
from skfem_stvk.linear.pardiso import pardiso_is_installed
from skfem_stvk.referee.peers import PEERS

from . import with_edges, with_felupe, with_scikit_fem
from .cantilever import Array, Run, cantilever
from .linear_solvers import forget, pardiso, superlu
from .study import Study

#: Cells across: about 5, 50 and 230 thousand unknowns.
SIZES, QUICK_SIZES = (6, 14, 24), (4,)
#: If a program would take longer than this [s], two iterations are run and the total is estimated from their times.
PATIENCE = 300.0
#: SuperLU is left out above this number of unknowns because of its fill.
MOST_FOR_SUPERLU = 100_000
#: The claims are about meshes of at least this number of unknowns; smaller meshes take only seconds.
LEAST = 40_000
PARDISO, FELUPE = Pardiso().name, "FElupe P1"
AGREEMENT, ASSEMBLY, FASTER = 1e-6, 0.05, 10.0
PROGRAMS: dict[str, Callable[..., Run]] = {
    "scikit-fem P1": partial(with_scikit_fem.solve, element="P1"),
    FELUPE: with_felupe.solve,
}
SOLVERS = {"SuperLU": superlu, "PARDISO": pardiso}


class Entry(NamedTuple):
    """Run with a linear solver. If the run would take too long, it is `estimated` from its first two iterations."""

    run: Run
    solver: str
    estimated: bool = False

    @property
    def ours(self) -> bool:
        return self.run.name == "edges P1"


def speed(quick: bool = False) -> Study:
    """Compare the time by part with scripts in scikit-fem and FElupe, in one run."""
    absent = missing()
    with_edges.warm_up("auto", *({PARDISO} - set(absent)))
    meshes = [list(entries_on(n)) for n in (QUICK_SIZES if quick else SIZES)]
    return Study(
        "Speed, cantilever in large bending",
        f"all programs agree; from {LEAST // 1000} k unknowns on, both others take {FASTER:g} x as long with their default "
        "solver, and longer with PARDISO on both sides",
        ("program", "solver", "unknowns", "iterations", "assemble", "factor", "solve", "other", "total [s]", "x auto", "tip [m]"),
        tuple(_row(entry, entries[0]) for entries in meshes for entry in entries),
        tuple(failure for entries in meshes for failure in _failures(entries)),
        (
            f"share of assembly (target: {ASSEMBLY:.0%}): {', '.join(share for entries in meshes for share in _shares(entries))}",
            "same mesh, load steps and tolerance (residual 1e-8 of loads and reactions); 'other' has all of FElupe's own time",
            f"~: the run would take more than {PATIENCE:g} s; estimated from two timed iterations and our number of iterations; "
            f"SuperLU is left out above {MOST_FOR_SUPERLU} unknowns",
            *(f"not measured: {name}; {line}" for name, line in absent.items()),
        ),
    )


def missing() -> dict[str, str]:
    """Return the programs and solvers that are not installed, with the line that installs each."""
    lines = {} if pardiso_is_installed() else {PARDISO: "pip install 'skfem-stvk[pardiso]'"}
    felupe = PEERS["FElupe"]
    return lines if felupe.version() else lines | {FELUPE: felupe.install}


def entries_on(n: int) -> Iterator[Entry]:
    """Yield the runs of all programs on the mesh with `n` cells across; the first is ours with the solver "auto"."""
    mesh, absent = cantilever(n), missing()
    run, result = with_edges.solve(mesh)
    yield Entry(run, f"auto: {result.solver}")
    for solver in [name for name in (PARDISO, AmgCg().name) if name not in (result.solver, *absent)]:
        yield Entry(with_edges.solve(mesh, solver)[0], solver)
    for program in [program for name, program in PROGRAMS.items() if name not in absent]:
        for name, linear in SOLVERS.items():
            if name.lower() not in absent and (name != "SuperLU" or run.ndofs <= MOST_FOR_SUPERLU):
                yield _run_or_estimate(partial(program, mesh, linear=linear, factors=result.history.t), name, run.iterations)


def _run_or_estimate(solve: Callable[..., Run], solver: str, iterations: int) -> Entry:
    """Return the complete run, or an estimate if it would take longer than `PATIENCE`.

    The estimate is the first iteration plus the time of the second for each further iteration. It assumes our number of iterations.
    """
    forget()
    one = solve(most=1)
    forget()
    if iterations * one.total <= PATIENCE:
        return Entry(solve(), solver)
    two = solve(most=2)
    seconds = {part: time + (iterations - 1) * max(two.seconds[part] - time, 0.0) for part, time in one.seconds.items()}
    return Entry(one._replace(seconds=seconds, iterations=iterations), solver, True)


def _row(entry: Entry, first: Entry) -> tuple[str, ...]:
    run, about = entry.run, "~" if entry.estimated else ""
    parts = [f"{run.seconds[part]:.2f}" if part in run.seconds else "" for part in ("assemble", "factor", "solve", "other")]
    counts, ratio = (str(run.ndofs), f"{about}{run.iterations}"), run.total / first.run.total
    return run.name, entry.solver, *counts, *parts, f"{about}{run.total:.2f}", f"{ratio:.2f}", "" if about else f"{run.tip[2]:.6f}"


def _shares(entries: list[Entry]) -> Iterator[str]:
    """Yield the share of assembly in the time of each of our runs."""
    for entry in entries:
        if entry.ours:
            share = entry.run.seconds["assemble"] / entry.run.total
            yield f"{share:.1%} ({entry.solver.removeprefix('auto: ')}, {entry.run.ndofs})"


def _failures(entries: list[Entry]) -> Iterator[str]:
    first = entries[0]
    large = first.run.ndofs >= LEAST
    ours = {entry.solver.removeprefix("auto: "): entry for entry in entries if entry.ours}
    for entry in entries:
        what = f"{entry.run.ndofs} unknowns, {entry.run.name} with {entry.solver}"
        if not entry.estimated and not _agree(entry.run.tip, first.run.tip):
            yield f"{what}: tip = {entry.run.tip}; expected {first.run.tip}"
        if large and not entry.ours:
            fast, factor = (first, FASTER) if entry.solver == "SuperLU" else (ours[PARDISO], 1.0)
            if not entry.run.total > factor * fast.run.total:
                yield f"{what}: only {entry.run.total / fast.run.total:.2f} x the time of ours with {fast.solver}"


def _agree(a: Array, b: Array) -> bool:
    return bool(np.linalg.norm(a - b) <= AGREEMENT * np.linalg.norm(b))
