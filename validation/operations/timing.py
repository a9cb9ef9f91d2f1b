"""Times of the same sources, compiled, because operation counts do not determine times."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .algorithms import Algorithm, state, zeros
from .body import Body
from .compiled import compiled


def times(chosen: Iterable[Algorithm], body: Body, repeats: int = 15) -> dict[tuple[str, str], float]:
    """Return the shortest time of a call [s] on one thread, by quantity and name. The calls of the algorithms alternate."""
    u = state(body)
    calls = {(a.quantity, a.name): call(a, body, u) for a in chosen}
    return shortest(calls, repeats)


def call(chosen: Algorithm, body: Body, u: NDArray[np.float64], prepare: Callable[[Body], Any] | None = None) -> Callable[[], Any]:
    """Return a function that runs a compiled algorithm on its own arrays. Each call also clears the arrays."""
    rest = (prepare or chosen.prepare)(body)
    rest = type(rest)(*(unsigned(field) for field in rest))
    out, x = zeros(body, chosen.quantity), u if chosen.displacements else body.p.T + u
    run = compiled(chosen.run)

    def once() -> Any:
        for array in out:
            array.fill(0)
        run(rest, x, *out)
        return out

    return once


def shortest(calls: dict[tuple[str, str], Callable[[], Any]], repeats: int) -> dict[tuple[str, str], float]:
    """Return the shortest time of each call [s], after one call to warm up."""
    for once in calls.values():
        once()
    best = dict.fromkeys(calls, np.inf)
    for _ in range(repeats):
        for key, once in calls.items():
            begin = perf_counter()
            once()
            best[key] = min(best[key], perf_counter() - begin)
    return best


def unsigned(field: NDArray[Any]) -> NDArray[Any]:
    """Return indices as unsigned integers, which need no test for negative values."""
    return field.astype(np.uint32) if field.dtype.kind == "i" else field
