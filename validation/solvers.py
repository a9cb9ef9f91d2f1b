"""Time and memory of the linear solvers from 5 000 to 500 000 unknowns."""

from __future__ import annotations

import ctypes
import gc
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import skfem
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from skfem_stvk import StVK, System
from skfem_stvk.linear import SOLVERS, Kind, LinearSolver, Unknowns
from skfem_stvk.linear.pardiso import pardiso_is_installed
from skfem_stvk.system import FreeOperator

#: Elements across a cube and across a beam ten times as long as thick: about 5, 15, 50, 150, 500 thousand unknowns, and a million.
FULL = {"cube": (11, 16, 25, 36, 54), "beam 10:1": (5, 7, 11, 16, 25, 32)}
QUICK = {"cube": (5, 7), "beam 10:1": (2, 3)}
RTOL = 1e-8
LIMIT = 30  # [s]; runs with a longer expected time are skipped


def main(quick: bool = False) -> int:
    """Measure time and memory of the linear solvers on a cube and a slender beam."""
    console = Console(highlight=False, width=132)
    ok = True
    for shape, sizes in (QUICK if quick else FULL).items():
        rows = list(measurements(shape, sizes))
        ok &= all(row.get("residual", 0) <= RTOL for row in rows)
        console.print(table_of(shape, rows))
        console.print()
    return 0 if ok else 1


def measurements(shape: str, sizes: tuple[int, ...]) -> Iterator[dict[str, Any]]:
    """Yield the results of each solver at each size, each in its own process, so that peak memory is separate."""
    for solver in SOLVERS:
        if solver.name == "pardiso" and not pardiso_is_installed():
            continue
        before: tuple[int, float] | None = None
        for size in sizes:
            n = unknowns_of(shape, size)
            expected = 0.0 if before is None else before[1] * (n / before[0]) ** (1.4 if solver.iterative else 2)
            if expected > LIMIT:
                yield {"solver": solver.name, "n": n, "skipped": expected}
                continue
            run = subprocess.run(
                [sys.executable, "-m", "validation.solvers", shape, str(size), solver.name], capture_output=True, text=True
            )
            if run.returncode:
                raise RuntimeError(f"{solver.name}, {shape} {size}: {run.stderr[-2000:]}")
            row = json.loads(run.stdout.splitlines()[-1])
            before = n, row["first"] + row["solve"]
            yield row


def measured(shape: str, size: int, name: str) -> dict[str, Any]:
    """Return seconds and bytes of the parts of a solve, including a second factorization with the retained data."""
    [solver] = [solver for solver in SOLVERS if solver.name == name]
    times_of(solver, *problem(shape, 6, solver.matrix_free))  # compiles kernels and loads libraries
    K, unknowns = problem(shape, size, solver.matrix_free)
    start = reset_peak()
    row = times_of(solver, K, unknowns)
    return {"solver": name, "n": unknowns.n, "peak": peak() - start, **row}


def times_of(solver: LinearSolver, K: Any, unknowns: Unknowns) -> dict[str, Any]:
    """Return times for gravity across the body, solved with factors from the second factorization."""
    b = np.where(unknowns.component == 2, -1.0, 0.0)
    clock = [perf_counter()]
    analysis = solver.analyse(unknowns)
    clock.append(perf_counter())
    analysis.factorise(K, Kind.SYMMETRIC)
    clock.append(perf_counter())
    factors = analysis.factorise(K, Kind.SYMMETRIC)
    clock.append(perf_counter())
    solution = factors.solve(b, RTOL)
    clock.append(perf_counter())
    analyse, first, again, solve = np.diff(clock)
    return {
        "analyse": analyse,
        "first": first,
        "again": again,
        "solve": solve,
        "iterations": solution.iterations,
        "residual": solution.residual,
    }


def box(shape: str, size: int) -> skfem.MeshTet:
    """Return a cube, or a beam ten times as long, with cubic cells."""
    long = 1 if shape == "cube" else 10
    across = np.linspace(0, 1, size + 1)
    return skfem.MeshTet.init_tensor(np.linspace(0, long, long * size + 1), across, across)


def unknowns_of(shape: str, size: int) -> int:
    """Return the number of unknowns: three for each vertex that is not on the clamped face."""
    return 3 * (size if shape == "cube" else 10 * size) * (size + 1) ** 2


def problem(shape: str, size: int, matrix_free: bool = False) -> tuple[Any, Unknowns]:
    """Return K at rest of a body clamped at x = 0, as a matrix or as an operator, and its unknowns."""
    return of_mesh(box(shape, size), matrix_free)


def of_mesh(mesh: Any, matrix_free: bool = False, young: Any = 1e5, poisson: float = 0.3) -> tuple[Any, Unknowns]:
    """Return K at rest of a mesh clamped at x = 0, as a matrix or as an operator, and its unknowns."""
    body = System(mesh, StVK(young=young, poisson=poisson))
    wall = np.flatnonzero(body.mesh.p[0] == 0)
    held = body.free_dofs((3 * wall[:, None] + np.arange(3)).ravel())
    modes = rigid_motions(body.mesh.p)[held.free]
    vertex, component = np.divmod(held.free, 3)
    if matrix_free:
        return FreeOperator(body.linear_operator(np.zeros(body.ndofs)), held), Unknowns(vertex, component)
    K = held.matrix(body.tangent(np.zeros(body.ndofs)))
    return K, Unknowns(vertex, component, K.indptr, K.indices, lambda: modes)


def rigid_motions(p: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return translations, and rotations about the middle, (3 nv, 6)."""
    x = (p - p.mean(axis=1, keepdims=True)).T / np.ptp(p)
    rotations = [np.cross(axis, x) for axis in np.eye(3)]
    return np.stack([*(np.tile(axis, (len(x), 1)) for axis in np.eye(3)), *rotations], axis=2).reshape(-1, 6)


def reset_peak() -> int:
    """Reset the peak of this process and return its memory [bytes].

    On systems other than Linux, the peak is that of the whole process.
    """
    gc.collect()
    try:
        ctypes.CDLL(None).malloc_trim(0)  # releases memory that the assembly has freed
        Path("/proc/self/clear_refs").write_text("5")
    except (OSError, AttributeError):
        return 0
    return _status("VmRSS")


def peak() -> int:
    """Return the peak memory [bytes]."""
    try:
        return _status("VmHWM")
    except OSError:
        import resource

        return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def _status(name: str) -> int:
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * int(next(line.split()[1] for line in lines if line.startswith(name)))


def table_of(shape: str, rows: list[dict[str, Any]]) -> Table:
    """Return a table with one line per solver and size."""
    table = Table(title=f"{shape}, load across, to {RTOL:.0e}; seconds", title_justify="left", box=None, header_style="bold")
    for heading in ("solver", "unknowns", "analyse", "factorise", "again", "solve", "again + solve", "iterations", "memory"):
        table.add_column(heading, justify="left" if heading == "solver" else "right")
    for row in rows:
        if "skipped" in row:
            table.add_row(row["solver"], f"{row['n']}", f"not run: some {row['skipped']:.0f} s")
            continue
        seconds = [
            f"{value:.3f}" for value in (row["analyse"], row["first"], row["again"], row["solve"], row["again"] + row["solve"])
        ]
        table.add_row(row["solver"], f"{row['n']}", *seconds, f"{row['iterations'] or ''}", f"{row['peak'] / 1e6:.0f} MB")
    return table


if __name__ == "__main__":
    print(json.dumps(measured(sys.argv[1], int(sys.argv[2]), sys.argv[3])))
