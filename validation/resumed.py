"""Motions and paths that are resumed from a checkpoint: differences from uninterrupted runs, which must be 0."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import skfem
from rich.console import Console
from rich.table import Table

from skfem_stvk import Gravity, StVK, System, simulate, solve_static
from skfem_stvk.linear import SOLVERS
from skfem_stvk.linear.pardiso import pardiso_is_installed
from skfem_stvk.solvers.dynamics import INTEGRATORS

STEPS, STOPS = 16, (3, 9)


class Resumed(NamedTuple):
    """Resumed run, its solver, and the largest difference of displacements relative to the largest displacement."""

    what: str
    solver: str
    difference: float


def main() -> int:
    """Compare resumed runs of all integrators and of statics, with each solver, with uninterrupted runs."""
    table, ok = Table("resumed", "solver", "difference", box=None), True
    for row in rows():
        table.add_row(row.what, row.solver, f"{row.difference:.1e}" if row.difference else "0")
        ok &= row.difference == 0 or row.solver == "pardiso"
    Console(highlight=False, width=132).print(table)
    return 0 if ok else 1


def rows() -> Iterator[Resumed]:
    """Yield the results of all integrators, then of statics, with all their solvers."""
    solvers = [one.name for one in SOLVERS if one.name != "pardiso" or pardiso_is_installed()]
    for name, integrator in INTEGRATORS.items():
        for solver in ["none"] if integrator.explicit else solvers:
            yield Resumed(name, solver, motion(name, solver))
    for solver in solvers:
        yield Resumed("load steps", solver, path(solver))


def body(young: float = 2e4) -> System:
    """Return a clamped bar under its weight, large enough for several levels of multigrid."""
    mesh = skfem.MeshTet.init_tensor(np.linspace(0, 3, 14), np.linspace(0, 1.1, 5), np.linspace(0, 0.9, 5))
    law = StVK(young=young, poisson=0.3, density=1e3)
    return System(mesh, [law, Gravity((0, 0, -9.0))], fixed=[(lambda x: x[0] == 0, "xyz")])


def motion(name: str, solver: str) -> float:
    """Return the difference after motions that were resumed after 3 and after 9 of 16 steps."""
    kind, system = INTEGRATORS[name], body()
    integrator = kind(dt=2e-4) if kind.explicit else kind(dt=2e-2, solver=solver)  # type: ignore[call-arg]
    dt = 2e-4 if kind.explicit else 2e-2
    whole, worst = simulate(system, integrator, until=STEPS * dt, quiet=True), 0.0
    with tempfile.TemporaryDirectory() as folder:
        for stop in STOPS:
            at = Path(folder) / str(stop)
            simulate(system, integrator, until=stop * dt, checkpoint=at, quiet=True)
            again = simulate(system, integrator, until=STEPS * dt, checkpoint=at, resume=True, quiet=True)
            worst = max(worst, float(np.abs(again.u - whole.u).max() / np.abs(whole.u).max()))
    return worst


def path(solver: str) -> float:
    """Return the difference after a path that was resumed from its first three states."""
    with tempfile.TemporaryDirectory() as folder:
        whole = solve_static(body(2e6), steps=8, solver=solver, checkpoint=folder, quiet=True)
        for file in sorted(Path(folder).glob("state_*.npz"))[3:]:
            file.unlink()
        again = solve_static(body(2e6), steps=8, solver=solver, checkpoint=folder, resume=True, quiet=True)
    return float(np.abs(again.u - whole.u).max() / np.abs(whole.u).max())
