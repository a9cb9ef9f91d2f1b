"""Calls of several Python threads that share an object with caches or scratch arrays, switched between any two lines."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from threading import Barrier
from types import FrameType
from typing import Any, NamedTuple

import numpy as np
import skfem
from scipy.sparse import csr_matrix

from skfem_stvk import (
    Corotated,
    EnergyMomentum,
    Gravity,
    NeoHookean,
    Pressure,
    ReducedSystem,
    StVK,
    System,
    simulate,
    solve_static,
)
from skfem_stvk.arguments import Array
from skfem_stvk.linear import SOLVERS, Kind, LinearSolver
from skfem_stvk.linear.pardiso import pardiso_is_installed
from skfem_stvk.system import FreeOperator
from skfem_stvk.system.free_tangent import FreeTangent

Call = Callable[[], Any]
THREADS, INTERVAL = 4, 1e-6
TIMES = 0.25, 0.5, 0.75, 1.0


class Case(NamedTuple):
    """Calls that share one object, created by `make`. Threads are switched between the lines of the file `within`."""

    within: str
    make: Callable[[], list[Call]]


class Count(NamedTuple):
    """Number of calls, and number of calls that raised an error or returned a different result than in one thread."""

    wrong: int
    calls: int


def measure(case: Case, seconds: float) -> Count:
    """Make the calls in four threads for `seconds` [s], and compare each with its result in one thread."""
    expected = [arrays_of(call()) for call in case.make()]
    calls, barrier = case.make(), Barrier(THREADS)
    end = time.perf_counter() + seconds

    def work(seed: int) -> Count:
        order, wrong, count = np.random.default_rng(seed), 0, 0
        barrier.wait()
        with switched_within(case.within, order.random(4096) < 0.5):
            while time.perf_counter() < end or count < 10:
                number = int(order.integers(len(calls)))
                wrong, count = wrong + (not agrees(calls[number], expected[number])), count + 1
        return Count(wrong, count)

    before = sys.getswitchinterval()
    sys.setswitchinterval(INTERVAL)
    try:
        with ThreadPoolExecutor(THREADS) as pool:
            found = list(pool.map(work, range(THREADS)))
    finally:
        sys.setswitchinterval(before)
    return Count(sum(one.wrong for one in found), sum(one.calls for one in found))


def agrees(call: Call, expected: list[Array]) -> bool:
    """Return whether a call returns these arrays, bit for bit; an error counts as a difference."""
    try:
        return all(map(np.array_equal, arrays_of(call()), expected))
    except Exception:
        return False


def arrays_of(value: Any) -> list[Array]:
    """Return copies of the arrays and numbers in a result."""
    if isinstance(value, tuple | list):
        return [array for one in value for array in arrays_of(one)]
    return [value.data.copy(), value.indices.copy()] if isinstance(value, csr_matrix) else [np.array(value)]


@contextmanager
def switched_within(file: str, switches: Array) -> Iterator[None]:
    """Release the GIL before some of the lines of a file of the package, in this thread."""
    count = 0

    def lines(frame: FrameType, event: str, argument: Any) -> Any:
        nonlocal count
        count += 1
        if switches[count % len(switches)]:
            time.sleep(0)
        return lines

    def calls(frame: FrameType, event: str, argument: Any) -> Any:
        return lines if frame.f_code.co_filename.endswith(file) else None

    before = sys.gettrace()
    sys.settrace(calls)
    try:
        yield
    finally:
        sys.settrace(before)


def states(n: int, size: float = 0.02) -> Array:
    """Return displacements or unknowns at the four `TIMES`, (4, n)."""
    return size * np.random.default_rng(0).standard_normal((len(TIMES), n))


def left(x: Array) -> Any:
    return x[0] == 0


def right(x: Array) -> Any:
    return x[0] == 2


def body(*terms: Any, law: Any = None, **held: Any) -> System:
    """Return a bar of 96 tetrahedra, clamped at one end."""
    mesh = skfem.MeshTet.init_tensor(np.linspace(0, 2, 5), np.linspace(0, 1.1, 3), np.array([0, 0.4, 0.9]))
    law = law or StVK(young=1e5, poisson=0.3, density=1e2)
    return System(mesh, [law, *terms], fixed=[(left, "xyz")], **held)


def growing(t: float) -> tuple[float, float, float]:
    return 0.0, 3 * t, -9 * t


def reduced(law: Any = None, **options: Any) -> ReducedSystem:
    pulled = [(right, {"x": lambda x, t: 0.1 * t + 0 * x[1]})]
    return ReducedSystem(body(law=law, prescribed=pulled), 6, 4, quiet=True, **options)


def unknowns(**options: Any) -> list[Call]:
    one = reduced(**options)
    return [partial(one.linearize, q, t) for q, t in zip(states(6, 0.3), TIMES, strict=True)]


def amounts() -> list[Call]:
    one = reduced()
    return [partial(one.amounts, t) for t in TIMES]


def loads() -> list[Call]:
    one = body(Gravity(growing))
    return [partial(one.external_force, np.zeros(one.ndofs), t) for t in TIMES]


def parts_of_K(*terms: Any) -> list[Call]:
    one = body(*terms)
    every = [one.free_dofs(np.arange(first, first + 20)) for first in (0, 7, 15)]
    return [partial(one.jacobian, u, free=free) for u, free in zip(states(one.ndofs), every, strict=False)]


def parts_of_mass(kind: str) -> list[Call]:
    one = body()

    def scaled(free: Any) -> csr_matrix:
        K = free.structure.matrix(np.zeros(free.structure.nnz))
        one.mass(kind).add_to(K, 2.0, free)
        return K

    return [partial(scaled, one.free_dofs(np.arange(first, first + 20))) for first in (0, 7, 15)]


def products() -> list[Call]:
    one = body()
    free = one.free_dofs(np.arange(30))
    K = FreeOperator(one.linear_operator(np.zeros(one.ndofs)), free)
    return [partial(K.matvec, v[free.free]) for v in states(one.ndofs)]


def rotations(t: float) -> Array:
    c, s = np.cos(t), np.sin(t)
    return np.tile(np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]), (96, 1, 1))


def frames() -> list[Call]:
    one = body(law=Corotated(young=1e5, poisson=0.3, rotation=rotations))
    pairs = list(zip(states(one.ndofs), TIMES, strict=True))
    return [partial(what, u, t) for what in (one.residual, one.jacobian) for u, t in pairs]


def solves_with(solver: LinearSolver) -> list[Call]:
    one, u = body(), np.zeros(135)
    tangent = FreeTangent(one, solver, Kind.SYMMETRIC)
    K = FreeOperator(one.linear_operator(u), tangent.free) if solver.matrix_free else tangent.free_matrix(u, 1.0)
    factors = tangent.factorise(K)
    return [lambda b=b: factors.solve(b[tangent.free.free], 1e-8).x for b in states(one.ndofs)]  # type: ignore[misc]


def paths() -> list[Call]:
    one = body(Gravity(growing))
    return [lambda n=n: solve_static(one, steps=n, solver="superlu", quiet=True).u for n in (1, 2, 3)]  # type: ignore[misc]


def motions() -> list[Call]:
    one = body(Gravity(growing))
    steps = (EnergyMomentum(dt, solver="superlu") for dt in (1e-3, 5e-4))
    return [lambda step=step: simulate(one, step, until=2e-3, quiet=True).u for step in steps]  # type: ignore[misc]


NEO_HOOKEAN = NeoHookean(young=1e5, poisson=0.3, density=1e2)
CASES = {
    "ReducedSystem: energy, force, tangent": Case("coordinates.py", unknowns),
    "the same, of a law on the mesh": Case("solvers/reduced/quartic.py", partial(unknowns, law=NEO_HOOKEAN)),
    "ReducedSystem: what is prescribed": Case("solvers/reduced/basis.py", amounts),
    "dead loads as functions of time": Case("terms/loads/dead_loads.py", loads),
    "K over free degrees of freedom": Case("edges/streaming.py", parts_of_K),
    "the same, under a follower load": Case("system/pattern.py", partial(parts_of_K, Pressure(right, 1e3))),
    "lumped mass added to K": Case("system/mass.py", partial(parts_of_mass, "lumped")),
    "consistent mass added to K": Case("system/mass.py", partial(parts_of_mass, "consistent")),
    "FreeOperator": Case("system/operator.py", products),
    "residual and Jacobian with given frames": Case("edges/assembly.py", frames),
    **{
        f"factors of '{one.name}'": Case("linear/cg.py", partial(solves_with, one))
        for one in SOLVERS
        if one.name != "pardiso" or pardiso_is_installed()
    },
    "solve_static under loads in time": Case("terms/loads/dead_loads.py", paths),
    "simulate under loads in time": Case("terms/loads/dead_loads.py", motions),
}
