"""Costs of reduced models, measured in one run: construction, one evaluation, and one step next to a step of the full model."""

from __future__ import annotations

import tracemalloc
import warnings
from collections.abc import Iterable, Iterator
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import skfem

from skfem_stvk import Gravity, LinearBackwardEuler, Newmark, ReducedSystem, StVK, StvkWarning, System, simulate
from skfem_stvk.arguments import Array

from ..bench.costs import best_and_median
from ..statics.study import Study
from .against_full import MATERIAL, clamp

#: Sizes by the cells of a mesh along the bar and across. The time to construct a basis grows with the fourth power of its size.
MESHES: dict[tuple[int, int, int], tuple[int, ...]] = {(20, 4, 2): (5, 20, 30, 60), (40, 8, 6): (5, 20, 30), (50, 14, 12): (30,)}
QUICK: dict[tuple[int, int, int], tuple[int, ...]] = {(20, 4, 2): (5, 20)}
DT, STEPS, QUICK_STEPS = 0.01, 200, 20
#: Tetrahedra times steps of the full model, and the number of measurements of a step; the shortest is used.
OF_FULL, TIMES = 50_000, 3
SECONDS = 0.2


def body(cells: tuple[int, int, int]) -> System:
    """Return a bar under a twentieth of its weight, with a deflection of about its height."""
    x = [np.linspace(0, length, n + 1) for length, n in zip((5.0, 1.0, 0.75), cells, strict=True)]
    return System(skfem.MeshTet.init_tensor(*x), [StVK(MATERIAL), Gravity((0.0, -0.5, 0.0))], fixed={clamp: "xyz"})


def costs(quick: bool, folder: Path | None) -> Iterable[Study]:
    """Yield the study of time and memory: basis and coefficients, one evaluation, and one step, reduced and full."""
    meshes, steps = (QUICK, QUICK_STEPS) if quick else (MESHES, STEPS)
    rows = []
    for cells, sizes in meshes.items():
        full = body(cells)
        few = max(OF_FULL // full.mesh.nt, 2)
        ours = _step(full, LinearBackwardEuler(DT), few), _step(full, Newmark(DT), few)
        rows.append((f"{full.mesh.nt}", "full", "", "", "", *(f"{1e3 * one:.2f}" for one in ours)))
        for size in sizes:
            reduced, seconds, memory = _made(full, size)
            q = 0.1 * np.cos(np.arange(size)) / (1 + np.arange(size))
            factors = iter(np.linspace(1.0, 1.1, 1_000_003))  # a new state in each call, because the model caches the last state
            taken = best_and_median({"WFK": partial(_respond, reduced, q, factors)}, SECONDS)["WFK"]
            fast = (_step(reduced, one, steps) for one in (LinearBackwardEuler(DT), Newmark(DT)))
            rows.append(
                (
                    "",
                    f"r = {size}",
                    f"{seconds:.1f}",
                    f"{memory / 1e6:.0f}",
                    f"{1e6 * taken.best:.0f}",
                    *(f"{1e3 * one:.2f}" for one in fast),
                )
            )
    yield Study(
        "Costs of reduced models",
        "",
        ("tetrahedra", "model", "made in [s]", "[MB]", "W + F + K [us]", "eq. 9 [ms]", "Newmark [ms]"),
        tuple(rows),
        (),
        (
            "made: modes, their derivatives, PCA and coefficients, all threads; [MB]: peak memory in addition to the full body",
            f"steps include rows of the ledger, from rest under g = 0.5 m/s^2, dt = {DT:g} s; full: the default solvers",
        ),
    )


def _respond(reduced: ReducedSystem, q: Array, factors: Iterator[float]) -> None:
    reduced.response(next(factors) * q)


def _made(full: System, size: int) -> tuple[ReducedSystem, float, int]:
    """Return the body on a basis of this size, and the seconds and the peak memory [bytes] of its construction."""
    modes = 20 if size > 10 else 5
    tracemalloc.start()
    try:
        start = perf_counter()
        reduced = ReducedSystem(full, size, modes, quiet=True)
        return reduced, perf_counter() - start, tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def _step(system: System | ReducedSystem, integrator: Any, steps: int) -> float:
    """Return the seconds of one step: the difference of a long and a short run, without the time of initialisation."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StvkWarning)
        taken = [[_run(system, integrator, n) for n in (steps, 3 * steps)] for _ in range(TIMES)]
    short, long = np.min(taken, axis=0)
    return max(float(long - short), 0.0) / (2 * steps)


def _run(system: System | ReducedSystem, integrator: Any, steps: int) -> float:
    start = perf_counter()
    simulate(system, integrator, until=steps * integrator.dt, quiet=True)
    return perf_counter() - start
