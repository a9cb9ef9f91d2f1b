"""A cantilever that bends far: time by part, against the scripts that competent users of scikit-fem and FElupe write."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np

from skfem_stvk.linear import AmgCg, Pardiso
from skfem_stvk.linear.pardiso import pardiso_is_installed
from skfem_stvk.peers import PEERS

from . import with_edges, with_felupe, with_scikit_fem
from .cantilever import Array, Run, cantilever
from .linear_solvers import forget, pardiso, superlu
from .study import Study

#: Cells across: about 5, 50 and 230 thousand unknowns.
SIZES, QUICK_SIZES = (6, 14, 24), (4,)
#: A program that would take longer [s] is run for two iterations, which tell what all would take.
PATIENCE = 300.0
#: SuperLU's fill is left out beyond so many unknowns.
MOST_FOR_SUPERLU = 100_000
#: Claims are about meshes of at least so many unknowns; below, all takes seconds.
LEAST = 40_000
PARDISO, FELUPE = Pardiso().name, "FElupe P1"
AGREEMENT, ASSEMBLY, FASTER = 1e-6, 0.05, 10.0
PROGRAMS: dict[str, Callable[..., Run]] = {
    "scikit-fem P1": partial(with_scikit_fem.solve, element="P1"),
    FELUPE: with_felupe.solve,
}
SOLVERS = {"SuperLU": superlu, "PARDISO": pardiso}


class Entry(NamedTuple):
    """A run with a linear solver; `estimated` from its first two iterations if it would take too long."""

    run: Run
    solver: str
    estimated: bool = False

    @property
    def ours(self) -> bool:
        return self.run.name == "edges P1"


def speed(quick: bool = False) -> Study:
    """time by part of a cantilever that bends far, against scripts in scikit-fem and FElupe, in one run"""
    absent = missing()
    with_edges.warm_up("auto", *({PARDISO} - set(absent)))
    meshes = [list(entries_on(n)) for n in (QUICK_SIZES if quick else SIZES)]
    return Study(
        "Speed, cantilever in large bending",
        f"one answer; from {LEAST // 1000} k unknowns on both others take {FASTER:g} x as long with their default solver, and "
        "longer with PARDISO on both sides",
        ("program", "solver", "unknowns", "iterations", "assemble", "factor", "solve", "other", "total [s]", "x auto", "tip [m]"),
        tuple(_row(entry, entries[0]) for entries in meshes for entry in entries),
        tuple(failure for entries in meshes for failure in _failures(entries)),
        (
            f"assembly, of which {ASSEMBLY:.0%} was the target: "
            f"{', '.join(share for entries in meshes for share in _shares(entries))}",
            "same mesh, load steps and stop (residual 1e-8 of loads and reactions); FElupe's own time is all in 'other'",
            f"~ where all would take more than {PATIENCE:g} s, two iterations were timed and as many counted as ours needs; "
            f"SuperLU is left out beyond {MOST_FOR_SUPERLU} unknowns",
            *(f"not measured: {name}; {line}" for name, line in absent.items()),
        ),
    )


def missing() -> dict[str, str]:
    """Programs and solvers that are not installed, and the line that installs each."""
    lines = {} if pardiso_is_installed() else {PARDISO: "pip install 'skfem-stvk[pardiso]'"}
    felupe = PEERS["FElupe"]
    return lines if felupe.version() else lines | {FELUPE: felupe.install}


def entries_on(n: int) -> Iterator[Entry]:
    """All programs on the mesh with `n` cells across, ours with its own choice of a solver first."""
    mesh, absent = cantilever(n), missing()
    run, result = with_edges.solve(mesh)
    yield Entry(run, f"auto: {result.solver}")
    for solver in [name for name in (PARDISO, AmgCg().name) if name not in (result.solver, *absent)]:
        yield Entry(with_edges.solve(mesh, solver)[0], solver)
    for program in [program for name, program in PROGRAMS.items() if name not in absent]:
        for name, linear in SOLVERS.items():
            if name.lower() not in absent and (name != "SuperLU" or run.ndofs <= MOST_FOR_SUPERLU):
                yield _patiently(partial(program, mesh, linear=linear, factors=result.history.t), name, run.iterations)


def _patiently(solve: Callable[..., Run], solver: str, iterations: int) -> Entry:
    """The run; or, where it would take too long, its beginning and what one more iteration takes, times the iterations of ours."""
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
    """Assembly's share of the time of each of our runs."""
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
            yield f"{what}: tip {entry.run.tip}, not {first.run.tip}"
        if large and not entry.ours:
            fast, factor = (first, FASTER) if entry.solver == "SuperLU" else (ours[PARDISO], 1.0)
            if not entry.run.total > factor * fast.run.total:
                yield f"{what}: only {entry.run.total / fast.run.total:.2f} x the time of ours with {fast.solver}"


def _agree(a: Array, b: Array) -> bool:
    return bool(np.linalg.norm(a - b) <= AGREEMENT * np.linalg.norm(b))
