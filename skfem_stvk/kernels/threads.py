"""Kernels on several threads.

Kernels let go of the GIL, so Python's own threads run them. They sleep when there is nothing to do. OpenMP's, which numba would
use, wait awake: with another process on the machine, K on 2 of 2 cores then took 1080 ns a tetrahedron instead of 59.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from functools import cache, wraps
from itertools import pairwise
from threading import RLock
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

Result = TypeVar("Result")
Method = TypeVar("Method", bound=Callable[..., Any])

#: Simplices, or work of as many, that a thread gets at least: with fewer, waking it takes longer than the work.
SMALLEST_PART = 4096


def threads() -> int:
    """The number of threads that kernels run on: what `numba.set_num_threads` says in this Python thread, else one per core."""
    try:
        count: int = numba.get_num_threads()
    except ValueError:  # numba misses the library that NUMBA_THREADING_LAYER asks for, which is not needed here
        count = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
    return count


class Turn:
    """A lock for arrays that calls work in, one Python thread at a time. A copy, or one in another process, has its own."""

    def __init__(self) -> None:
        self._lock = RLock()

    def __enter__(self) -> None:
        self._lock.acquire()

    def __exit__(self, *exception: object) -> None:
        self._lock.release()

    def __reduce__(self) -> tuple[type[Turn], tuple[()]]:
        return Turn, ()


def in_turn(method: Method) -> Method:
    """A method that waits for the `_turn` of its object."""

    @wraps(method)
    def waiting(self: Any, *arguments: Any, **named: Any) -> Any:
        with self._turn:
            return method(self, *arguments, **named)

    return cast(Method, waiting)


def parts_of(count: int, each: float, threads: int) -> NDArray[np.int64]:
    """(n + 1,) where the parts of `count` rows begin, and the end: `threads` parts unless they are too small.

    A row is as much work as `each` simplices.
    """
    n = max(1, min(threads, int(count * each // SMALLEST_PART)))
    return np.linspace(0, count, n + 1).astype(np.int64)


def run(kernel: Callable[..., Result], parts: NDArray[np.int64], *arguments: Any) -> list[Result]:
    """`kernel(begin, end, *arguments)` for each part at the same time; results in the order of the parts."""
    (begin, end), *others = [(int(begin), int(end)) for begin, end in pairwise(parts)]
    if not others:
        return [kernel(begin, end, *arguments)]
    try:
        running = [_pool().submit(kernel, *part, *arguments) for part in others]
    except RuntimeError:  # Python is on its way out and starts nothing any more
        return [kernel(begin, end, *arguments), *(kernel(*part, *arguments) for part in others)]
    try:
        first = kernel(begin, end, *arguments)
    finally:
        wait(running)  # after Ctrl-C too nobody writes on
    return [first, *(part.result() for part in running)]


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(os.cpu_count(), thread_name_prefix="skfem-stvk")


if hasattr(os, "register_at_fork"):  # threads do not live on in a forked process
    os.register_at_fork(after_in_child=_pool.cache_clear)
