"""W, F, K and K v of this package, of the C loop, and one CSR product with the same K: timed in turns."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from operator import matmul
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import StvkError
from ..peers.peer import lame
from ..system import System
from .case import POISSON, YOUNG, Case
from .checkout import from_checkout
from .results import CONTROL, CSR, OURS, Benchmark
from .timing import best_and_median, most_threads, threads
from .traffic import least_bytes

Calls = dict[tuple[str, str], Callable[[], Any]]

METHODS = {"W": "energy", "F": "internal_force", "K": "tangent"}


def time_contenders(results: Benchmark, case: Case) -> None:
    """Both precisions on one and two threads; the C loop and the CSR product have one."""
    control = results.optional(CONTROL, partial(_control_calls, case))
    for dtype in ("float64", "float32"):
        body, u, v = System(case.mesh, case.term, dtype=dtype), case.u.astype(dtype), case.v.astype(dtype)
        for count in (1, 2):
            if count > most_threads():
                results.not_measured["2 threads"] = "numba has one thread here"
                continue
            with threads(count):
                calls, K = our_calls(body, u, v)
                if count == 1:
                    calls[CSR, "K v"] = partial(matmul, K, v)
                if count == 1 and dtype == "float64":
                    calls |= control or {}
                for (player, quantity), taken in best_and_median(calls, results.plan.seconds).items():
                    results.add(case, player, quantity, taken, count, dtype)
                if count == 1 and dtype == "float64":
                    results.least_bytes[case.name] = {what: n / case.mesh.nt for what, n in least_bytes(body, K).items()}


def our_calls(body: System, u: NDArray[Any], v: NDArray[Any]) -> tuple[Calls, Any]:
    """The calls of a system, and the K that they fill."""
    K, operator = body.tangent(u), body.linear_operator(u)
    calls: dict[str, Callable[[], Any]] = {
        "W": partial(body.energy, u),
        "F": partial(body.internal_force, u),
        "W+F": partial(body.energy_and_force, u),
        "K": partial(body.tangent, u, out=K),
        "W+F+K": partial(body.linearize, u, out=K),
        "K v: prepare": partial(operator.prepare, u),
        "K v": partial(operator.matvec, v),
    }
    return {(OURS, quantity): call for quantity, call in calls.items()}, K


def _control_calls(case: Case) -> Calls:
    """The C loop's.

    Raises
    ------
    StvkError
        if there is no checkout or no compiler.
    """
    try:
        loop = from_checkout("control").Control(case.mesh.p, case.mesh.t, *lame(YOUNG, POISSON))
    except (OSError, np.linalg.LinAlgError) as error:
        raise StvkError(f"the C loop cannot be used ({error})") from error
    return {(CONTROL, quantity): partial(getattr(loop, method), case.u) for quantity, method in METHODS.items()}
