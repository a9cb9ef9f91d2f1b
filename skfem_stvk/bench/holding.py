"""What a system holds for F, for K and for K v, in both precisions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..system import System
from .case import Case
from .results import Benchmark, Memory
from .timing import threads

ASKED: dict[str, Callable[[System, Any], Any]] = {
    "F": lambda body, u: body.internal_force(u),
    "F and K": lambda body, u: body.tangent(u),
    "F and K v": lambda body, u: body.product(u, u),
}


def weigh(results: Benchmark, case: Case) -> None:
    """Bytes of systems that were asked for one thing each, on one thread."""
    for dtype in ("float64", "float32"):
        for quantity, ask in ASKED.items():
            body = System(case.mesh, case.term, dtype=dtype)
            with threads(1):
                body.internal_force(case.u)
                ask(body, case.u)
            results.memory.append(Memory(case.name, case.mesh.nt, quantity, dtype, body.memory()))
