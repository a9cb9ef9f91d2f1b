"""Linear solvers by element: which solver is the fastest at which size, and variants of multigrid's second level."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import skfem

from skfem_stvk import StVK, System, Traction, solve_static
from skfem_stvk.linear import AmgCg, Kind, LinearSolver, Pardiso, SuperLU, Unknowns
from skfem_stvk.linear.pardiso import pardiso_is_installed
from skfem_stvk.solvers.dynamics import BackwardEuler, simulate

from ..solvers import RTOL, rigid_motions
from ..statics.study import Study

#: Cells across a cube and across a beam five times as long, by element.
SIZES: dict[str, dict[str, tuple[int, ...]]] = {
    "tetrahedra": {"cube": (8, 11, 16, 25), "beam 5:1": (4, 6, 9, 15)},
    "quadratic tetrahedra": {"cube": (3, 4, 5, 8, 12), "beam 5:1": (2, 3, 4, 7)},
    "hexahedra": {"cube": (8, 11, 16, 25), "beam 5:1": (4, 6, 9, 15)},
}
QUICK: dict[str, dict[str, tuple[int, ...]]] = {name: {"cube": (3,)} for name in SIZES}
#: Data of whole solves: lengths over widths of bodies, the traction that bends them by at most a tenth of their length [Pa], and
#: cells across by element.
LENGTHS = {"cube": (1, 1, 1), "beam 5:1": (5, 1, 1), "beam 20:1": (20, 1, 1), "plate": (8, 8, 1)}
PULLS = {"cube": 2e3, "beam 5:1": 100.0, "beam 20:1": 3.0, "plate": 40.0}
WHOLE: dict[str, dict[str, int]] = {
    "tetrahedra": {"cube": 10, "beam 5:1": 5, "beam 20:1": 3, "plate": 2},
    "quadratic tetrahedra": {"cube": 4, "beam 5:1": 2, "beam 20:1": 2, "plate": 1},
    "hexahedra": {"cube": 8, "beam 5:1": 4, "beam 20:1": 3, "plate": 2},
    "triangles": {"cube": 70, "beam 20:1": 20},
    "quadrilaterals": {"cube": 70, "beam 20:1": 20},
    "quadratic triangles": {"cube": 40, "beam 20:1": 10},
}
QUICK_WHOLE: dict[str, dict[str, int]] = {"quadratic tetrahedra": {"beam 5:1": 1}, "quadratic triangles": {"cube": 4}}
#: Largest numbers of unknowns with which direct solvers are measured.
MOST_SUPERLU, MOST_PARDISO = 8_000, 30_000
STEPS, CELLS, QUICK_STEPS, QUICK_CELLS = 5, (2, 4, 8), 2, (2,)


def solvers(quick: bool = False) -> Iterator[Study]:
    """Measure CPU times of linear solvers by element, number of unknowns and entries of K; and in time steps."""
    yield _whole(quick)
    yield _at_rest(quick)
    yield _in_motion(quick)


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
            "CPU seconds of all threads together; first, again: times of the first factorization and in later Newton steps; "
            "aggregates: multigrid aggregates all nodes instead of using linear elements on the corners",
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
    """Return CPU seconds of the first factorization, of the second, and of a solve; iterations and the residual."""
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


def body_of(element: str, shape: str, n: int, density: float | None = None, pull: float | None = None) -> System:
    """Return a body of cubic cells at rest, clamped at x = 0, with an optional transverse traction at the other end [Pa].

    For plane elements, it is the side view of this body.
    """
    plane, boxes = element.endswith(("triangles", "laterals")), element.endswith(("hexahedra", "laterals"))
    kinds = (skfem.MeshTri, skfem.MeshQuad) if plane else (skfem.MeshTet, skfem.MeshHex)
    d, lengths = 2 if plane else 3, LENGTHS[shape]
    mesh = kinds[boxes].init_tensor(*(np.linspace(0, length, length * n + 1) for length in lengths[:d]))
    degree, down = 2 if element.startswith("quadratic") else None, np.eye(d)[-1]
    loads = [] if pull is None else [Traction(lambda x: x[0] == lengths[0], tuple(-pull * down))]
    material = StVK(young=1e5, poisson=0.3, density=density)
    return System(mesh, [material, *loads], {lambda x: x[0] == 0: "xyz"[:d]}, degree=degree)


def _whole(quick: bool) -> Study:
    rows, failures = [], []
    for element, shapes in (QUICK_WHOLE if quick else WHOLE).items():
        for shape, n in shapes.items():
            found = {}
            for solver in (SuperLU(), Pardiso(), AmgCg())[:: 1 if pardiso_is_installed() else 2]:
                times = []
                for _ in range(1 if quick else 2):
                    body = body_of(element, shape, n, pull=PULLS[shape])
                    begin = time.process_time()
                    result = solve_static(body, steps=5, quiet=True, solver=solver)
                    times.append(time.process_time() - begin)
                found[solver.name] = result.u
                held = len(body.supports.held)
                cells = str(body.ndofs - held), f"{body.pattern.nnz / body.ndofs:.0f}", solver.name
                rows.append((element, shape, *cells, f"{min(times):.3f}", str(result.history.iterations)))
            first = found["superlu"]
            failures += [
                f"{element}, {shape}, {name}: the state differs"
                for name, u in found.items()
                if not np.abs(u - first).max() <= 1e-5 * np.abs(first).max()
            ]
    return Study(
        "Whole solves by element and linear solver",
        "all solvers find the same state (to 1e-5)",
        ("element", "body", "unknowns", "entries a row", "solver", "CPU s", "Newton iterations"),
        tuple(rows),
        tuple(failures),
        (
            "bodies in bending, five load steps, without the setup; CPU seconds of all threads together, the better of two "
            "runs; `auto` is based on these times: linear solves of early Newton steps stop early",
        ),
    )


def problem(element: str, shape: str, n: int) -> tuple[Any, Unknowns]:
    """Return K at rest and its unknowns."""
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
                simulate(body, BackwardEuler(dt=1 / 60, solver=solver), until=1 / 60, v0=v0, quiet=True)  # compiles and loads
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
                    failures.append(f"{element}, {cells} cells, {solver}: the motion differs by {off:.1e}")
    return Study(
        "Linear solvers in time steps by element",
        "all solvers lead to the same motion (to 1e-6)",
        ("element", "unknowns", "solver", "CPU ms a step", "Newton iterations"),
        tuple(rows),
        tuple(failures),
        ("a cube of soft tissue (1e5 Pa, 1 m) clamped at one side,  backward Euler in steps of 1/60 s, all work included",),
    )
