"""Linear solvers in time steps: cost of a step with each solver, for the bar of soft tissue, plates and plane bodies.

Times are CPU times of one thread. They exclude the ledger and the first step, in which matrices are analysed and kernels compiled.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import skfem

from skfem_stvk import Gravity, StVK, System
from skfem_stvk.linear import SsorCg
from skfem_stvk.linear.pardiso import pardiso_is_installed
from skfem_stvk.solvers.dynamics import BackwardEuler, EnergyMomentum
from skfem_stvk.solvers.dynamics.integrators.implicit import Implicit

from ..solvers import RTOL, problem, times_of
from ..statics.study import Study
from .scenes import Array, begun, expected
from .swing import DENSITY, GRAVITY, LENGTH, POISSON, SIDE, YOUNG, bar, clock, eq9, on_threads, push

FRAME = 1 / 60
#: Steps of eq. 9: cells across the bar, steps/s, stiffness [Pa] and tolerance; duration of the motion [s], and number of
#: repetitions.
EQ9 = (
    *((8, 60, 3e4, rtol) for rtol in (1e-2, 1e-3, 1e-4)),
    (8, 60, 1e5, 1e-3),
    *((12, 60, 3e4, rtol) for rtol in (1e-2, 1e-3, 1e-4)),
    *((12, 60, 1e5, rtol) for rtol in (1e-3, 1e-4)),
    (7, 1000, 3e4, 1e-4),
)
QUICK_EQ9, UNTIL, QUICK_UNTIL, REPEATS = ((3, 60, 3e4, 1e-3),), 0.5, 0.1, 3
#: Largest ratio of SSOR's iterations to those with diagonal blocks, in steps of 1/60 s.
PART = 0.5
#: Converged steps: number of timed steps by cells across the bar; runs that are skipped because they take minutes.
CONVERGED, QUICK_CONVERGED = {4: 12, 8: 6, 12: 3}, {2: 2}
SOLVERS = ("superlu", "pardiso", "amg-cg", "ssor-cg")
TOO_LONG = {(12, EnergyMomentum, "superlu")}
#: Largest difference of motions with different solvers, relative to the largest displacement.
ALIKE = 1e-6
#: Relaxation of SSOR: stiffnesses [Pa], cells across the bar and across the cube of statics; largest ratio of the iterations with
#: the package's factor to the fewest.
OMEGAS, YOUNGS, ACROSS, CUBE, QUICK_ACROSS, NEAR = (1.0, 1.2, 1.4, 1.6, 1.8), (3e4, 1e5), 12, 25, 3, 1.1


class Steps(NamedTuple):
    """Single steps: CPU time per step without the first [s], iterations of all, and the last displacements (ndofs,) [m]."""

    seconds: float
    iterations: int
    u: Array


def step_solvers(quick: bool = False, folder: Path | None = None) -> Sequence[Study]:
    """Measure the cost of a time step with each linear solver on soft tissue, plates and triangles; and the relaxation of SSOR."""
    with on_threads(1), one_thread_of_mkl(), expected():
        return (_of_eq9(quick), _converged(quick), _nearly_static(quick), _relaxation(quick))


@contextmanager
def one_thread_of_mkl() -> Iterator[None]:
    """Run PARDISO on one thread within the `with` block, if it is installed."""
    if not pardiso_is_installed():
        yield
        return
    import pypardiso

    set_threads = pypardiso.PyPardisoSolver().libmkl.MKL_Set_Num_Threads_Local
    before = set_threads(1)
    try:
        yield
    finally:
        set_threads(before)


def stepped(system: System, integrator: Implicit, v: Array, count: int) -> Steps:
    """Make one untimed step and `count` timed steps of a body without deformation and with velocities `v` (ndofs,) [m/s]."""
    stepper, state = begun(system, integrator, v)
    stepper.step(state, integrator.dt)
    begin = clock()
    for k in range(1, count + 1):
        stepper.step(state, (k + 1) * integrator.dt)
    return Steps((clock() - begin) / count, stepper.counts.iterations, state.u)


def _of_eq9(quick: bool) -> Study:
    """Compare diagonal blocks and SSOR as preconditioners."""
    rows: list[tuple[str, ...]] = []
    failures: list[str] = []
    for n, rate, young, rtol in QUICK_EQ9 if quick else EQ9:
        system, count = bar(n, young), round((QUICK_UNTIL if quick else UNTIL) * rate)
        cells, found = [], []
        for solver in ("block-jacobi-cg", "ssor-cg"):
            integrator = replace(eq9(rate, rtol), solver=solver)
            tries = [stepped(system, integrator, push(n), count) for _ in range(1 if quick else REPEATS)]
            found.append(min(tries, key=lambda one: one.seconds))
            cells += [f"{1e3 * found[-1].seconds:.2f}", f"{found[-1].iterations / (count + 1):.3g}"]
        jacobi, ssor = found
        what = str(system.mesh.nt), str(rate), f"{young:g}", f"{rtol:g}"
        rows.append((*what, *cells, f"{jacobi.seconds / ssor.seconds:.2f}"))
        if rate == 60 and ssor.iterations > PART * jacobi.iterations:
            failures.append(f"{', '.join(what)}: {ssor.iterations} iterations with SSOR, {jacobi.iterations} with diagonal blocks")
    return Study(
        "Steps of eq. 9",
        f"in steps of 1/60 s ssor-cg takes at most {PART:g} times as many iterations as block-jacobi-cg",
        ("tetrahedra", "steps/s", "E, Pa", "rtol", "block-jacobi-cg, ms", "iterations", "ssor-cg, ms", "iterations", "x"),
        tuple(rows),
        tuple(failures),
        (
            f"per step, in the first {QUICK_UNTIL if quick else UNTIL:g} s of the bar of soft tissue; best of "
            f"{1 if quick else REPEATS} runs",
        ),
    )


def _converged(quick: bool) -> Study:
    """Compare all solvers in Newton's method."""
    rows: list[tuple[str, ...]] = []
    failures: list[str] = []
    sizes = QUICK_CONVERGED if quick else CONVERGED
    for n, count in sizes.items():
        system, v = bar(n), push(n)
        for kind in (BackwardEuler, EnergyMomentum):
            names = [name for name in _available() if (n, kind, name) not in TOO_LONG]
            found = {name: stepped(system, kind(dt=FRAME, solver=name), v, count) for name in names}
            rows.append((str(system.mesh.nt), kind.__name__, *_cells(found), f"{found['ssor-cg'].iterations / (count + 1):.3g}"))
            failures += _unlike(f"{system.mesh.nt} tetrahedra, {kind.__name__}", found)
    return Study(
        "Converged steps of 1/60 s",
        f"with each solver Newton's method takes the same number of iterations, and the motions agree within {ALIKE:g} of "
        "the largest displacement",
        ("tetrahedra", "integrator", *(f"{name}, ms" for name in SOLVERS), "Newton iterations"),
        tuple(rows),
        tuple(failures),
        (f"per step of the bar of soft tissue, E = {YOUNG:g} Pa, means of {', '.join(map(str, sizes.values()))} steps by size",),
    )


def _available() -> list[str]:
    return [name for name in SOLVERS if name != "pardiso" or pardiso_is_installed()]


def _cells(found: dict[str, Steps]) -> Iterator[str]:
    """Yield the times of the table to three digits, in the order of `SOLVERS`."""
    for name in SOLVERS:
        if name in found:
            yield np.format_float_positional(1e3 * found[name].seconds, 3, fractional=False, trim="-")
        else:
            yield "not run" if name in _available() else "not installed"


def _unlike(what: str, found: dict[str, Steps]) -> Iterator[str]:
    """Yield the solvers whose motion or number of Newton iterations differs from that of the last solver."""
    *others, last = found
    expected = found[last]
    for name in others:
        off = float(np.abs(found[name].u - expected.u).max() / np.abs(expected.u).max())
        if not off <= ALIKE:
            yield f"{what}: motions with {name} and {last} differ by {off:.1e}"
        if found[name].iterations != expected.iterations:
            yield f"{what}: {found[name].iterations} iterations with {name}, {expected.iterations} with {last}"


def _nearly_static(quick: bool) -> Study:
    """Compare solvers on bodies with small inertia relative to stiffness, and on bodies with small factors."""
    rows: list[tuple[str, ...]] = []
    failures: list[str] = []
    for name, system, steps in _bodies(quick):
        v = np.zeros(system.ndofs)
        for dt in steps:
            found = {solver: stepped(system, BackwardEuler(dt=dt, solver=solver), v, 3) for solver in _available()}
            free = system.ndofs - len(system.supports.held)
            rows.append((name, str(system.mesh.nt), str(free), f"{1e3 * dt:.3g}", *_cells(found)))
            failures += _unlike(f"{name}, dt = {dt:.3g} s", found)
    return Study(
        "Converged steps, nearly static or in the plane",
        "with each solver Newton's method takes the same number of iterations and gives the same motion",
        ("body", "elements", "unknowns", "dt, ms", *(f"{name}, ms" for name in SOLVERS)),
        tuple(rows),
        tuple(failures),
        ("per step of BackwardEuler, means of 3 steps; bodies clamped along one side and released under their weight",),
    )


def _bodies(quick: bool) -> Iterator[tuple[str, System, tuple[float, ...]]]:
    """Yield plates of tetrahedra and soft tissue of triangles, with time steps [s]."""
    steel = StVK(young=210e9, poisson=0.3, density=7800.0)
    for thick, n, steps in ((0.01, 40, (FRAME,)), (0.02, 16, (0.01, 0.1))):
        lines = *2 * [np.linspace(0, 1, (4 if quick else n) + 1)], np.linspace(0, thick, 2)
        plate = System(skfem.MeshTet.init_tensor(*lines), [steel, Gravity(GRAVITY)], fixed={lambda x: x[0] == 0: "xyz"})
        yield f"steel plate, 1 x 1 x {thick:g} m", plate, steps
    tissue = StVK(young=YOUNG, poisson=POISSON, density=DENSITY)
    for n in (4,) if quick else (24, 48):
        sheet = skfem.MeshTri.init_tensor(np.linspace(0, LENGTH, 2 * n + 1), np.linspace(0, SIDE, n + 1))
        soft = System(sheet, [tissue, Gravity((0.0, -9.81))], fixed={lambda x: x[0] == 0: "xy"})
        yield "soft tissue of triangles", soft, (FRAME,)


def relaxed(omega: float) -> SsorCg:
    """Return the SSOR solver with the relaxation factor `omega`."""
    solver: SsorCg = type("Relaxed", (SsorCg,), {"omega": omega})()
    return solver


def _relaxation(quick: bool) -> Study:
    """Count iterations by omega, in time steps and in statics."""
    n, cube = (QUICK_ACROSS, QUICK_ACROSS) if quick else (ACROSS, CUBE)
    (K, unknowns), bars = problem("cube", cube, matrix_free=True), [bar(n, young) for young in YOUNGS]
    counts = {}
    for omega in OMEGAS:
        integrator = replace(eq9(60), solver=relaxed(omega))
        steps = [stepped(one, integrator, push(n), 5).iterations / 6 for one in bars]
        counts[omega] = *steps, times_of(relaxed(omega), K, unknowns)["iterations"]
    most = np.max(np.array(counts[SsorCg.omega]) / np.min(list(counts.values()), axis=0))
    return Study(
        "Relaxation of ssor-cg",
        "" if quick else f"the package's omega = {SsorCg.omega:g} takes at most {NEAR:g} times as many iterations as the best",
        ("omega", *(f"steps, E = {young:g} Pa" for young in YOUNGS), "statics"),
        tuple((f"{omega:g}", *(f"{count:.3g}" for count in row)) for omega, row in counts.items()),
        () if quick or most <= NEAR else (f"{most:.2f} times as many iterations",),
        (
            f"iterations per step of eq. 9, {12 * n**3} tetrahedra, 60 steps/s, rtol = {eq9(60).rtol:g}; statics: a cube at rest, "
            f"{unknowns.n} unknowns, to {RTOL:g}",
        ),
    )
