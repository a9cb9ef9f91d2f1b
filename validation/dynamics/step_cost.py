"""What a step costs: explicit ones in internal forces, implicit ones by part."""

from __future__ import annotations

import numpy as np
import skfem

from skfem_stvk import Gravity, StVK, System
from skfem_stvk.dynamics import ForwardEuler, LinearBackwardEuler, VelocityVerlet, simulate
from skfem_stvk.dynamics.books import Books
from skfem_stvk.dynamics.motion import Motion
from skfem_stvk.dynamics.state import State

from ..statics.study import Study
from .scenes import Array
from .swing import clock

#: Cells of cubes, 6 n^3 tetrahedra; steps that are timed; repetitions.
SIZES, QUICK_SIZES, TIMED, REPEATS = (19, 35), (12,), 200, 5
#: A step in internal forces at most.
FORCES = 1.5
DT = 1e-6


def explicit_cost(quick: bool) -> Study:
    """Times of a step and of an internal force side by side."""
    rows, failures = [], []
    for n in QUICK_SIZES if quick else SIZES:
        mesh = skfem.MeshTet.init_tensor(*[np.linspace(0, 1, n + 1)] * 3)
        material = StVK(young=1e5, poisson=0.3, density=1000.0)
        system = System(mesh, [material, Gravity((0, 0, -9.81))], fixed={lambda x: x[2] == 0: "xyz"})
        for integrator in (VelocityVerlet(dt=DT), ForwardEuler(dt=DT)):
            step, force = _side_by_side(system, integrator)
            each, ratio = 1e9 / system.mesh.nt, step / force
            rows.append((integrator.name, str(system.mesh.nt), f"{each * force:.1f}", f"{each * step:.1f}", f"{ratio:.2f}"))
            if ratio > FORCES and not quick:
                failures.append(f"{integrator.name}, {system.mesh.nt} tetrahedra: a step takes {ratio:.2f} internal forces")
    return Study(
        "Explicit steps",
        "" if quick else f"a step takes at most {FORCES:g} times as long as an internal force",
        ("integrator", "tetrahedra", "F, ns a tet", "step, ns a tet", "x"),
        tuple(rows),
        tuple(failures),
        ("one thread; ledger, guard against blow-up and watch over the critical step included; best of several, in turn",),
    )


def _side_by_side(system: System, integrator: VelocityVerlet | ForwardEuler) -> tuple[float, float]:
    """The best time of a step, of runs of `TIMED` and of twice as many steps, and of an internal force [s]."""
    u, force = np.zeros(system.ndofs), np.zeros(system.ndofs)
    short = long = one = np.inf
    for _ in range(REPEATS):
        short, long = min(short, _run(system, integrator, TIMED)), min(long, _run(system, integrator, 2 * TIMED))
        begin = clock()
        for _ in range(TIMED):  # as long as the steps: a busy machine is then as bad for both
            system.energy_and_force(u, out=force)
        one = min(one, (clock() - begin) / TIMED)
    return (long - short) / TIMED, one


def _run(system: System, integrator: VelocityVerlet | ForwardEuler, steps: int) -> float:
    begin = clock()
    simulate(system, integrator, until=steps * DT, quiet=True)
    return clock() - begin


def split(system: System, integrator: LinearBackwardEuler, v: Array) -> Study:
    """Where the time of a step of eq. 9 goes."""
    simulate(system, integrator, until=3 * integrator.dt, v0=v, quiet=True)
    runs = [simulate(system, integrator, until=1.0, v0=v, quiet=True) for _ in range(3)]
    run = min(runs, key=lambda run: sum(run.seconds.values()))
    steps, total = run.ledger.steps - 1, sum(run.seconds.values())
    books, state = Books(Motion(system, "lumped", None), {}), State.at(0.0, run.u, run.v)
    ledger = min(_once(books, state) for _ in range(100)) * steps
    parts = {
        "F and K": run.seconds["assemble"],
        "diagonal blocks, inverted": run.seconds["factor"],
        "conjugate gradients": run.seconds["solve"],
        "ledger": ledger,
        "rest": run.seconds["other"] - ledger,
    }
    rows = tuple((name, f"{1e3 * seconds / steps:.3f}", f"{seconds / total:.0%}") for name, seconds in parts.items())
    return Study(
        "A step of eq. 9",
        "all of the time is accounted for",
        ("part", "ms", "share"),
        (*rows, ("all", f"{1e3 * total / steps:.3f}", "100%")),
        () if min(parts.values()) > 0 else ("a part takes no time",),
        (
            f"{system.mesh.nt} tetrahedra, {run.iterations / steps:.0f} iterations of conjugate gradients a step of {1e3 * integrator.dt:.3g} ms",
        ),
    )


def _once(books: Books, state: State) -> float:
    begin = clock()
    books.enter(state, 0.0)
    return clock() - begin
