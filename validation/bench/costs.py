"""Costs of calls and systems: times, setup, first use, memory, and the bytes that a call must read and write."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Hashable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any, TypeVar

import numba
import numpy as np
from scipy.sparse import csr_matrix

from skfem_stvk.errors import StvkError
from skfem_stvk.system import System

from .meshes import Specimen
from .results import OURS, Benchmark, Memory, Seconds

COPIED = 2**29  # [B]; more than a last-level cache
MEMORY_CALLS: dict[str, Callable[[System, Any], Any]] = {
    "F": lambda body, u: body.internal_force(u),
    "F and K": lambda body, u: body.tangent(u),
    "F and K v": lambda body, u: body.product(u, u),
}
CALLS: dict[str, Callable[[System, Any], Any]] = {"W+F": System.energy_and_force, "K": System.tangent}
FIRST_USE = """
from time import perf_counter
import numpy as np, skfem
from skfem_stvk import StVK, System
begin = perf_counter()
body = System(skfem.MeshTet().refined(1), StVK(young=1.0, poisson=0.3))
u = np.zeros(body.ndofs)
body.energy_and_force(u), body.tangent(u), body.product(u, u)
print(perf_counter() - begin)
"""
Key = TypeVar("Key", bound=Hashable)


def best_and_median(calls: Mapping[Key, Callable[[], Any]], seconds: float) -> dict[Key, Seconds]:
    """Return the shortest and median time of each call, with caches warm from the same call.

    The calls alternate, so that other load of the machine affects all of them in the same way. Each turn makes one call without
    timing and five with timing. The untimed call fills the caches: a CSR product took twice as long after another call. A call
    gets turns until its `seconds` are spent.
    """
    taken: dict[Key, list[float]] = {key: [] for key in calls}
    while waiting := [key for key, times in taken.items() if not times or sum(times) < seconds]:
        for key in waiting:
            calls[key]()
            taken[key] += _clocked(calls[key], 5)
    return {key: _summary(times) for key, times in taken.items()}


def _clocked(call: Callable[[], Any], repetitions: int) -> list[float]:
    times = []
    for _ in range(repetitions):
        begin = perf_counter()
        call()
        times.append(perf_counter() - begin)
    return times


def _summary(times: list[float]) -> Seconds:
    return Seconds(min(times), float(np.median(times)), len(times))


@contextmanager
def threads(count: int) -> Iterator[None]:
    """Set the number of numba's threads within a `with` block."""
    before = numba.get_num_threads()
    numba.set_num_threads(count)
    try:
        yield
    finally:
        numba.set_num_threads(before)


def most_threads() -> int:
    """Return the largest number of threads that numba can use on this machine."""
    most: int = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
    return most


def time_setup(results: Benchmark, specimen: Specimen) -> None:
    """Time the setup from arrays to the first W and F, and to the first K: the best of three, on one thread.

    The time of one such call is subtracted.
    """
    with threads(1):
        for quantity, call in CALLS.items():
            ours = results.best(specimen.name, OURS, quantity)
            if ours is None:
                continue
            start = partial(_first, specimen, call)
            taken = [time - 1e-9 * ours * specimen.mesh.nt for time in _clocked(start, 3)]
            results.add(specimen, OURS, f"setup of {quantity}", _summary(taken))


def _first(specimen: Specimen, call: Callable[[System, Any], Any]) -> None:
    call(System((specimen.mesh.p, specimen.mesh.t), specimen.term), specimen.u)


def first_use() -> float:
    """Return the time [s] of the first W, F, K and K v of tetrahedra in double precision, all compiled by a new process."""
    with TemporaryDirectory() as folder:
        settings = os.environ | {"NUMBA_CACHE_DIR": folder}
        done = subprocess.run([sys.executable, "-c", FIRST_USE], env=settings, capture_output=True, text=True, check=False)
    if done.returncode:
        raise StvkError(f"The first use in a new process failed: {done.stderr.strip()[-300:]}")
    return float(done.stdout)


def weigh(results: Benchmark, specimen: Specimen) -> None:
    """Record the memory of systems on one thread, each after one of the calls in `MEMORY_CALLS`."""
    for dtype in ("float64", "float32"):
        for quantity, ask in MEMORY_CALLS.items():
            body = System(specimen.mesh, specimen.term, dtype=dtype)
            with threads(1):
                body.internal_force(specimen.u)
                ask(body, specimen.u)
            results.memory.append(Memory(specimen.name, specimen.mesh.nt, quantity, dtype, body.memory()))


def least_bytes(body: System, K: csr_matrix) -> dict[str, int]:
    """Return the bytes that each quantity must read and write once.

    The sizes are those of the arrays of a system that has computed all quantities.

    - W, F: the simplices (vertices, coefficients, coordinates), u and F.
    - K: the simplices with the ids of their edges, u, the blocks of the edges written and read again, their positions in K, and
      the values of K.
    - K v: the blocks and vertices of the edges, v and the result. The preparation counts as K, up to writing the blocks.
    - one CSR product: values, columns and rows of K, v and the result.
    """
    parts, vector, value = body.memory(), body.ndofs * K.data.itemsize, K.data.itemsize
    edges = (K.nnz // 9 - body.mesh.nv) // 2
    blocks, prepare = 9 * value * edges, parts["elements"] + parts["own edges"] + vector
    return {
        "W": parts["elements"] + vector,
        "F": parts["elements"] + 2 * vector,
        "W+F": parts["elements"] + 2 * vector,
        "K": prepare + 2 * blocks + parts["rows of K"] + K.data.nbytes,
        "W+F+K": prepare + vector + 2 * blocks + parts["rows of K"] + K.data.nbytes,
        "K v: prepare": prepare + blocks,
        "K v": blocks + 8 * edges + 2 * vector,
        "CSR product": K.data.nbytes + K.indices.nbytes + K.indptr.nbytes + 2 * vector,
    }


def copy_bandwidth(size: int = COPIED) -> float:
    """Return the bytes per second that one thread reads and writes when it copies an array of `size` bytes, best of five."""
    source, target = np.ones(size // 8), np.zeros(size // 8)
    return 2 * source.nbytes / min(_clocked(partial(np.copyto, target, source), 5))
