"""Linear solvers by element: from how many unknowns on which is the fastest, and what the second level of multigrid should be."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import skfem

from skfem_stvk import StVK, System
from skfem_stvk.dynamics import BackwardEuler, simulate
from skfem_stvk.linear import AmgCg, Kind, LinearSolver, Pardiso, SuperLU, Unknowns
from skfem_stvk.linear.pardiso import pardiso_is_installed

from ..solvers import RTOL, rigid_motions
from ..statics.study import Study

#: Cells across a cube and across a beam five times as long, by element.
SIZES: dict[str, dict[str, tuple[int, ...]]] = {
    "tetrahedra": {"cube": (8, 11, 16, 25), "beam 5:1": (4, 6, 9, 15)},
    "quadratic tetrahedra": {"cube": (3, 4, 5, 8, 12), "beam 5:1": (2, 3, 4, 7)},
    "hexahedra": {"cube": (8, 11, 16, 25), "beam 5:1": (4, 6, 9, 15)},
}
QUICK: dict[str, dict[str, tuple[int, ...]]] = {name: {"cube": (3,)} for name in SIZES}
#: Direct solvers are not measured beyond.
MOST_SUPERLU, MOST_PARDISO = 8_000, 30_000
STEPS, CELLS, QUICK_STEPS, QUICK_CELLS = 5, (2, 4, 8), 2, (2,)


def solvers(quick: bool = False) -> Sequence[Study]:
    """linear solvers by element: CPU times by number of unknowns and entries of K; and in time steps"""
    return _at_rest(quick), _in_motion(quick)


def _at_rest(quick: bool) -> Study:
    rows, failures = [], []
    for element, shapes in (QUICK if quick else SIZES).items():
        for shape, sizes in shapes.items():
            for n in sizes:
                K, unknowns = problem(element, shape, n)
                for name, solver, of in _solvers(unknowns):
                    first, again, solve, iterations, residual = cpu_times(solver, K, of)
                    cells = f"{first:.3f}", f"{again:.3f}", f"{solve:.3f}", f"{again + solve:.3f}", f"{iterations or ''}"
                    rows.append((element, shape, str(unknowns.n), str(K.nnz), name, *cells))
                    if not residual <= RTOL:
                        failures.append(f"{element}, {shape} {n}, {name}: residual {residual:.1e}")
    return Study(
        "Linear solvers by element",
        f"all solve to {RTOL:g}",
        ("element", "body", "unknowns", "nnz", "solver", "first", "again", "solve", "again + solve", "iterations"),
        tuple(rows),
        tuple(failures),
        (
            "CPU seconds of all threads together; first and again: to factorise for the first time and in the next Newton steps; "
            "aggregates: multigrid that aggregates all nodes instead of going by linear elements on the corners",
        ),
    )


def _solvers(unknowns: Unknowns) -> Iterator[tuple[str, LinearSolver, Unknowns]]:
    if unknowns.n <= MOST_SUPERLU:
        yield "superlu", SuperLU(), unknowns
    if unknowns.n <= MOST_PARDISO and pardiso_is_installed():
        yield "pardiso", Pardiso(), unknowns
    yield "amg-cg", AmgCg(), unknowns
    if unknowns.ends is not None:
        yield "amg-cg, aggregates", AmgCg(), replace(unknowns, ends=None)


def cpu_times(solver: LinearSolver, K: Any, unknowns: Unknowns) -> tuple[float, float, float, int, float]:
    """CPU seconds of the first factorisation, the second, and a solve; iterations and the residual."""
    b = np.where(unknowns.component == 2, -1.0, 0.0)
    analysis, clock = solver.analyse(unknowns), [time.process_time()]
    analysis.factorise(K, Kind.SYMMETRIC)
    clock.append(time.process_time())
    factors = analysis.factorise(K, Kind.SYMMETRIC)
    clock.append(time.process_time())
    found = factors.solve(b, RTOL)
    clock.append(time.process_time())
    first, again, solve = np.diff(clock)
    return first, again, solve, found.iterations, found.residual


def body_of(element: str, shape: str, n: int, density: float | None = None) -> System:
    """A cube or a beam along x of cubic cells, at rest, held at x = 0."""
    long, across = 1 if shape == "cube" else 5, np.linspace(0, 1, n + 1)
    kind = skfem.MeshHex if element == "hexahedra" else skfem.MeshTet
    mesh = kind.init_tensor(np.linspace(0, long, long * n + 1), across, across)
    degree = 2 if element.startswith("quadratic") else None
    return System(mesh, StVK(young=1e5, poisson=0.3, density=density), {lambda x: x[0] == 0: "xyz"}, degree=degree)


def problem(element: str, shape: str, n: int) -> tuple[Any, Unknowns]:
    """K at rest and its unknowns."""
    body = body_of(element, shape, n)
    held = body.free_dofs(body.supports.held)
    K, modes = held.matrix(body.tangent(np.zeros(body.ndofs))), rigid_motions(body.mesh.p)[held.free]
    return K, Unknowns(*np.divmod(held.free, 3), K.indptr, K.indices, lambda: modes, body.mesh.ends())


def _in_motion(quick: bool) -> Study:
    rows, failures = [], []
    for element in SIZES:
        for n in QUICK_CELLS if quick else CELLS:
            cells = n if element.startswith("quadratic") else 2 * n
            ends = {}
            for solver in ("superlu", "pardiso", "amg-cg", "ssor-cg", "block-jacobi-cg"):
                if solver == "pardiso" and not pardiso_is_installed():
                    continue
                body = body_of(element, "cube", cells, density=1e3)
                if solver == "superlu" and body.ndofs > MOST_SUPERLU:
                    continue
                v0 = np.tile([0.0, 0.0, -1.0], body.mesh.nv)
                v0[body.supports.held] = 0
                steps = QUICK_STEPS if quick else STEPS
                begin = time.process_time()
                run = simulate(body, BackwardEuler(dt=1 / 60, solver=solver), until=steps / 60, v0=v0, quiet=True)
                ends[solver] = run.u
                seconds = time.process_time() - begin
                row = element, str(body.ndofs), solver, f"{1e3 * seconds / steps:.1f}", f"{run.iterations / steps:.1f}"
                rows.append(row)
            first = ends["amg-cg"]
            for solver, u in ends.items():
                off = np.abs(u - first).max() / np.abs(first).max()
                if not off <= 1e-6:
                    failures.append(f"{element}, {cells} cells, {solver}: another motion, by {off:.1e}")
    return Study(
        "Linear solvers in time steps by element",
        "all lead to the same motion (to 1e-6)",
        ("element", "unknowns", "solver", "CPU ms a step", "Newton iterations"),
        tuple(rows),
        tuple(failures),
        ("a cube of soft tissue (1e5 Pa, 1 m) held at one side, backward Euler in steps of 1/60 s, all work included",),
    )
