"""How threads share the work: in parts that write to places of their own."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..kernels.threads import parts_of


class Shares(NamedTuple):
    """Parts, and where each adds what it computes.

    A target belongs to the first part that has it. Other parts add to slots of their own behind the targets, and those are folded back
    in a fixed order: no races, and results do not depend on which thread is faster.

    Attributes
    ----------
    parts : (n + 1,) rows of the targets where the parts begin, and the end.
    slots : in the place of the targets, flat.
    extra : targets of the slots behind.
    """

    parts: NDArray[np.int64]
    slots: NDArray[Any]
    extra: NDArray[np.int32]


def shares_of(targets: NDArray[Any], size: int, each: float, threads: int) -> Shares:
    """Shares of the rows of `targets` (n, m), which are 0 ... size - 1; a row is as much work as `each` simplices."""
    parts = parts_of(len(targets), each, threads)
    n = len(parts) - 1
    if n == 1:
        return Shares(parts, targets.ravel(), np.empty(0, dtype=np.int32))
    owner = np.empty(size, dtype=np.int32)
    for part in range(n - 1, -1, -1):
        owner[targets[parts[part] : parts[part + 1]].ravel()] = part
    index, extra = targets.copy(), np.empty(0, dtype=np.int32)
    for part in range(1, n):
        rows = index[parts[part] : parts[part + 1]]
        foreign = owner[rows] != part
        ids = np.unique(rows[foreign])
        rows[foreign] = size + len(extra) + np.searchsorted(ids, rows[foreign])
        extra = np.concatenate([extra, ids]).astype(np.int32)
    return Shares(parts, index.ravel(), extra)
