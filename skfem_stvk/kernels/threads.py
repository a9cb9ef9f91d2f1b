"""Kernels on several threads.

Kernels release the GIL, so that Python threads can run them. Python threads sleep while they are idle. The OpenMP threads of numba
wait actively. With another process on the machine, K on 2 of 2 cores then took 1080 ns per tetrahedron instead of 59.
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
from numba.np.ufunc import parallel
from numpy.typing import NDArray

Result = TypeVar("Result")
Method = TypeVar("Method", bound=Callable[..., Any])

#: Smallest work of a thread, in simplices. For less work, waking the thread takes longer than the work itself.
SMALLEST_PART = 4096


def threads() -> int:
    """Return the number of threads of kernels.

    This is the value of `numba.set_num_threads` in this Python thread, by default one thread per core.

    `numba.get_num_threads` takes a semaphore that forked processes share, and if one of them is killed meanwhile, all others wait
    for ever. The function that numba loads at its first launch takes none.
    """
    launched = getattr(parallel, "_get_num_threads", numba.get_num_threads)
    try:
        count: int = launched()
    except ValueError:  # numba does not find the library that NUMBA_THREADING_LAYER names; it is not needed
        count = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
    return count


class CopyableLock(type(RLock())):  # type: ignore[misc]  # the class that `RLock` makes
    """Lock for scratch arrays that calls share, held by one Python thread at a time.

    A copy, or one in another process, is a new lock.
    """

    def __reduce__(self) -> tuple[type[CopyableLock], tuple[()]]:
        return CopyableLock, ()


def locked(method: Method) -> Method:
    """Return a method that holds the lock `_lock` of its object while it runs."""

    @wraps(method)
    def waiting(self: Any, *arguments: Any, **named: Any) -> Any:
        with self._lock:
            return method(self, *arguments, **named)

    return cast(Method, waiting)


def parts_of(count: int, each: float, threads: int) -> NDArray[np.int64]:
    """Return the indices (n + 1,) at which the parts of `count` rows begin, and the end.

    n is `threads`, or fewer if parts would be too small. A row is as much work as `each` simplices.
    """
    n = max(1, min(threads, int(count * each // SMALLEST_PART)))
    return np.linspace(0, count, n + 1).astype(np.int64)


def run(kernel: Callable[..., Result], parts: NDArray[np.int64], *arguments: Any) -> list[Result]:
    """Run `kernel(begin, end, *arguments)` for all parts in parallel, and return the results in the order of the parts."""
    (begin, end), *others = pairwise(parts.tolist())
    if not others:
        return [kernel(begin, end, *arguments)]
    try:
        running = [_pool().submit(kernel, *part, *arguments) for part in others]
    except RuntimeError:  # Python is shutting down and starts no more threads
        return [kernel(begin, end, *arguments), *(kernel(*part, *arguments) for part in others)]
    try:
        first = kernel(begin, end, *arguments)
    finally:
        wait(running)  # so that no thread still writes after Ctrl-C
    return [first, *(part.result() for part in running)]


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(os.cpu_count(), thread_name_prefix="skfem-stvk")


if hasattr(os, "register_at_fork"):  # threads do not survive in a forked process
    os.register_at_fork(after_in_child=_pool.cache_clear)
