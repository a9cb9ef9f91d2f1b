"""Steps of a simulation in a loop of another program: their time against W, F and K, and its distribution."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from skfem_stvk import EnergyMomentum, Gravity, LinearBackwardEuler, ReducedSystem, Simulation, StVK, System
from skfem_stvk.mesh import box

#: Unknowns of the reduced body, and length of a step [s].
SIZE, DT = 30, 1e-3
#: Largest time of a step over that of W, F and K on a basis, with two Newton iterations of `EnergyMomentum`.
TARGETS = {"LinearBackwardEuler": 2.0, "EnergyMomentum": 9.0}


def main(quick: bool = False) -> int:
    """Print the time of steps of a bar of 5 184 tetrahedra, and the distribution of 100 000 steps on a basis.

    It needs an idle machine and one thread: OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1.
    """
    console, cells = Console(highlight=False, width=132), 3 if quick else 6
    mesh = box((4.0, 1.0, 1.0), (4 * cells, cells, cells))
    terms: list[Any] = [StVK(young=1e5, poisson=0.3, density=1e3), Gravity((0, 0, -9.81))]
    held = System(mesh, terms, fixed={"left": "xyz"})
    moved = System(mesh, terms, fixed={"left": "xyz"}, prescribed={"right": "xyz"})
    table = Table("body", "integrator", "inputs", "W + F + K [us]", "a step [us]", "ratio", "iterations", box=None)
    for system in (held, moved):
        reduced = ReducedSystem(system, size=SIZE, quiet=True)
        for integrator in (LinearBackwardEuler(DT), EnergyMomentum(DT)):
            table.add_row(f"{SIZE} unknowns", integrator.name, *_on_basis(reduced, integrator, system is moved, quick))
    for system in (held, moved):
        table.add_row(f"{mesh.nt} tetrahedra", "LinearBackwardEuler", *_of_mesh(system, system is moved, quick))
    console.print(table)
    reduced = ReducedSystem(moved, size=SIZE, quiet=True)
    for collects in (True, False):
        times = 1e6 * _distribution(reduced, collects, 1000 if quick else 100_000)
        parts = (np.median(times), np.quantile(times, 0.999), times.max())
        words = ", ".join(f"{word} {value:.0f} us" for word, value in zip(("median", "99.9 %", "worst"), parts, strict=True))
        console.print(f"{len(times)} steps of LinearBackwardEuler, garbage collector {'on' if collects else 'off'}: {words}")
    return 0


def _steps(sim: Simulation, moves: bool) -> Callable[[], None]:
    """Return a function that makes a step with a pushing force, and with a moving grip whose reaction is read."""
    count = [0]

    def step() -> None:
        count[0] += 1
        if moves:
            x = 0.01 * np.sin(0.01 * count[0])
            sim.step(top=(0.0, 0.0, -5.0), right=(x, 0.0, x))
            sim.reaction("right")
        else:
            sim.step(top=(0.0, 0.0, -5.0))

    return step


def _best(call: Callable[[], object], quick: bool) -> float:
    """Return the smallest mean time [us] of many calls."""
    times, calls = [], 20 if quick else 200
    for _ in range(3 if quick else 15):
        begin = time.perf_counter()
        for _ in range(calls):
            call()
        times.append((time.perf_counter() - begin) / calls)
    return 1e6 * min(times)


def _on_basis(reduced: ReducedSystem, integrator: LinearBackwardEuler | EnergyMomentum, moves: bool, quick: bool) -> list[str]:
    q, number = 0.01 * np.cos(np.arange(reduced.size)), [0]

    def linearize() -> None:
        number[0] += 1
        reduced.linearize(q * (1 + 1e-9 * number[0]))

    sim = Simulation(reduced, integrator, pushed=["top"])
    one, step = _best(linearize, quick), _best(_steps(sim, moves), quick)
    target = TARGETS[integrator.name]
    ratio = f"{step / one:.2f} (target {target:g})"
    return [_inputs(moves), f"{one:.1f}", f"{step:.1f}", ratio, f"{sim.iterations / sim.steps:.1f}"]


def _of_mesh(system: System, moves: bool, quick: bool) -> list[str]:
    sim = Simulation(system, LinearBackwardEuler(DT), pushed=["top"])
    step = _best(_steps(sim, moves), quick)
    return [_inputs(moves), "", f"{step:.0f}", "", f"{sim.iterations / sim.steps:.1f}"]


def _inputs(moves: bool) -> str:
    return "a force" + ", 3 displacements, a reaction" * moves


def _distribution(reduced: ReducedSystem, collects: bool, steps: int) -> np.ndarray:
    """Return the times of single steps [s], with Python's garbage collector or without."""
    sim = Simulation(reduced, LinearBackwardEuler(DT), pushed=["top"])
    step, times = _steps(sim, True), np.empty(steps)
    for _ in range(100):
        step()
    (gc.enable if collects else gc.disable)()
    try:
        for i in range(steps):
            begin = time.perf_counter()
            step()
            times[i] = time.perf_counter() - begin
    finally:
        gc.enable()
    return times
