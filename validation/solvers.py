"""Time and memory of the linear solvers from 5 000 to 500 000 unknowns, and variants of multigrid."""

from __future__ import annotations

import ctypes
import gc
import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from time import perf_counter
from typing import Any
from unittest.mock import patch

import numpy as np
import pyamg
import skfem
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from skfem_stvk import StVK, System
from skfem_stvk.linear import SOLVERS, AmgCg, Kind, LinearSolver, Unknowns, amg, multigrid
from skfem_stvk.linear.pardiso import pardiso_is_installed
from skfem_stvk.system import FreeOperator

#: Elements across a cube and across a beam ten times as long as thick: about 5, 15, 50, 150, 500 thousand unknowns, and a million.
FULL = {"cube": (11, 16, 25, 36, 54), "beam 10:1": (5, 7, 11, 16, 25, 32)}
QUICK = {"cube": (5, 7), "beam 10:1": (2, 3)}
RTOL = 1e-8
LIMIT = 30  # [s]; runs with a longer expected time are skipped


def main(quick: bool = False) -> int:
    """Measure time and memory of the linear solvers on a cube and a slender beam, and variants of multigrid."""
    console = Console(highlight=False, width=132)
    ok = True
    for shape, sizes in (QUICK if quick else FULL).items():
        rows = list(measurements(shape, sizes))
        ok &= all(row.get("residual", 0) <= RTOL for row in rows)
        console.print(table_of(shape, rows))
        console.print()
    console.print(variants(0.3 if quick else 1))
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


def chebyshev(self: multigrid.Level, b: NDArray[Any]) -> NDArray[Any]:
    """Apply a Chebyshev polynomial of degree 2 in `D^-1 A` to the residual b, on the upper three quarters of the spectrum."""
    if not hasattr(self, "rho"):
        self.rho = self._spectral_radius()  # type: ignore[attr-defined]
    top, D = self.rho, self._inverse.reshape(-1, 3, 3)  # type: ignore[attr-defined]
    middle, half = 0.625 * top, 0.375 * top
    apply = lambda r: np.einsum("nij,nj->ni", D, r.reshape(-1, 3)).ravel()  # noqa: E731
    step = apply(b) / middle
    x = step.copy()
    r = b - self.A.product(self.single, x, np.empty_like(x))
    rho = 1 / (2 * middle / half - half / middle)
    x += rho * half / middle * step + 2 * rho / half * apply(r)
    return x.astype(b.dtype)


def chebyshev_forward(self: multigrid.Level, b: NDArray[Any]) -> NDArray[Any]:
    """Smooth with a Chebyshev polynomial instead of a forward sweep."""
    self.x[:] = chebyshev(self, b)
    return np.asarray(b - self.A.product(self.single, self.x, self._residual))


def chebyshev_backward(self: multigrid.Level, b: NDArray[Any]) -> NDArray[Any]:
    """Smooth with a Chebyshev polynomial instead of a backward sweep."""
    self.x += chebyshev(self, b - self.A.product(self.single, self.x, self._residual))
    return self.x


#: Patches of each variant of multigrid.
VARIANTS: dict[str, list[tuple[Any, str, Any]]] = {
    "as it is": [],
    "V-cycle": [(multigrid.Hierarchy, "_twice", multigrid.Hierarchy._cycle)],
    "double precision": [(module, "SINGLE", np.float64) for module in (multigrid, amg)],
    "all couplings strong": [(multigrid, "STRONG", 0.0)],
    "Chebyshev of degree 2": [(multigrid.Level, "forward", chebyshev_forward), (multigrid.Level, "backward", chebyshev_backward)],
    "translations only": [(amg, "_modes", lambda unknowns: unknowns.near_null_space()[:, :3])],
}


def bodies(part: float) -> dict[str, Callable[[], tuple[Any, Unknowns]]]:
    """Return bodies with their unknowns, about 50 000 for `part` = 1 and fewer for smaller values."""

    def halves() -> tuple[Any, Unknowns]:
        mesh = box("cube", round(25 * part))
        return of_mesh(mesh, young=np.where(mesh.p[1][mesh.t].mean(axis=0) > 0.5, 1e9, 1e5))

    def plate() -> tuple[Any, Unknowns]:
        n = round(60 * part)
        return of_mesh(skfem.MeshTet.init_tensor(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1), np.linspace(0, 0.02, 4)))

    return {
        "cube": lambda: problem("cube", round(25 * part)),
        "beam 10:1": lambda: problem("beam 10:1", round(11 * part)),
        "soft and stiff 1:10^4": halves,
        "poisson 0.45": lambda: of_mesh(box("cube", round(25 * part)), poisson=0.45),
        "plate, elements 1:2.5": plate,
    }


def variants(part: float) -> Table:
    """Return a table of iterations, and times of a second factorization and of a solve, of each variant on each body."""
    table = Table(
        title="amg-cg: iterations, seconds of a second factorization and of a solve",
        title_justify="left",
        box=None,
        header_style="bold",
    )
    problems = {name: make() for name, make in bodies(part).items()}
    table.add_column("variant")
    for name, (_, unknowns) in problems.items():
        table.add_column(f"{name}, {unknowns.n}", justify="right")
    for name, patches in VARIANTS.items():
        with ExitStack() as stack:
            for target, attribute, value in patches:
                stack.enter_context(patch.object(target, attribute, value))
            cells = [cell(times_of(AmgCg(), *problem)) for problem in (problems["cube"], *problems.values())][1:]
        table.add_row(name, *cells)
    table.add_row("pyamg's own", *(cell(pyamg_times(*problem)) for problem in problems.values()))
    return table


def cell(row: dict[str, Any]) -> str:
    """Return a cell of the table."""
    return f"{row['iterations']} {row['again']:6.2f} {row['solve']:6.2f}"


def pyamg_times(K: Any, unknowns: Unknowns) -> dict[str, Any]:
    """Return iterations and times of pyamg with the same near-null space, Gauss-Seidel and its own conjugate gradients.

    Each time includes the whole setup.
    """
    begin = perf_counter()
    sweeps = {"presmoother": ("gauss_seidel", {"sweep": "forward"}), "postsmoother": ("gauss_seidel", {"sweep": "backward"})}
    assert unknowns.near_null_space is not None
    solver = pyamg.smoothed_aggregation_solver(K.tobsr((3, 3)), B=unknowns.near_null_space(), max_coarse=300, **sweeps)
    middle, residuals = perf_counter(), []  # type: tuple[float, list[float]]
    b = np.where(unknowns.component == 2, -1.0, 0.0)
    solver.solve(b, tol=RTOL, accel="cg", maxiter=1000, residuals=residuals)
    return {"iterations": len(residuals) - 1, "again": middle - begin, "solve": perf_counter() - middle}


if __name__ == "__main__":
    print(json.dumps(measured(sys.argv[1], int(sys.argv[2]), sys.argv[3])))
