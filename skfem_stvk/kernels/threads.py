"""Kernels on several threads.

Kernels let go of the GIL, so Python's own threads run them. They sleep when there is nothing to do. OpenMP's, which numba would use, wait
awake: with another process on the machine, K on 2 of 2 cores then took 1080 ns a tetrahedron instead of 59.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import pairwise
from typing import Any, TypeVar

import numba
import numpy as np
from numpy.typing import NDArray

Result = TypeVar("Result")

#: Items (simplices, vertices, edges) that a thread gets at least: with fewer, waking it takes longer than their work.
SMALLEST_PART = 4096


def threads() -> int:
    """How many threads kernels run on: what `numba.set_num_threads` says, by default one a core."""
    count: int = numba.get_num_threads()
    return count


def parts_of(count: int, each: int, threads: int) -> NDArray[np.int64]:
    """(n + 1,) where the parts of `count` rows of `each` items begin, and the end: `threads` parts unless they are too small."""
    n = max(1, min(threads, count * each // SMALLEST_PART))
    return np.linspace(0, count, n + 1).astype(np.int64)


def run(kernel: Callable[..., Result], parts: NDArray[np.int64], *arguments: Any) -> list[Result]:
    """`kernel(begin, end, *arguments)` for each part at the same time; results in the order of the parts."""
    (begin, end), *others = [(int(begin), int(end)) for begin, end in pairwise(parts)]
    running = [_pool().submit(kernel, *part, *arguments) for part in others]
    first = kernel(begin, end, *arguments)
    return [first, *(part.result() for part in running)]


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(os.cpu_count(), thread_name_prefix="skfem-stvk")


if hasattr(os, "register_at_fork"):  # threads do not live on in a forked process
    os.register_at_fork(after_in_child=_pool.cache_clear)
