"""Speed against error: W, F and K of every player in one run."""

from __future__ import annotations

import time
import tracemalloc
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arguments import Array
from ...errors import StvkWarning
from ...mesh.geometry import vertex_sizes
from ...reference import ReferenceStVK
from ...system import System
from ..bodies import Homogeneous
from ..case import OURS, REFERENCE, Case
from ..exact import ExactStVK
from ..players import METHODS, Foul
from ..states import STRETCH
from .precision import TEXTBOOK, forms_on, patch

REPETITIONS, SECONDS = 5, 1.0


def speed_table(case: Case) -> Iterator[dict[str, Any]]:
    """Rows player, quantity, ns_per_element (best), median_ns_per_element, ratio to the reference's best, peak_bytes_per_element.

    A player without the method, or that raises, has no row; agreement says so.
    """
    u = case.states[STRETCH]
    for quantity, method in METHODS.items():
        reference_best = None
        for player in [case.scikit_fem, *case.players]:
            if not player.has(quantity):
                continue
            call = partial(player.call, quantity, u)
            try:
                getattr(player, quantity)(u)  # what it returns can be used
                seconds, peak = _timed(call), _peak(call)
            except Foul:
                continue
            best = min(seconds)
            reference_best = best if reference_best is None else reference_best
            yield {
                "player": player.name,
                "quantity": quantity,
                "method": method,
                "ns_per_element": 1e9 * best / case.mesh.nt,
                "median_ns_per_element": 1e9 * float(np.median(seconds)) / case.mesh.nt,
                "ratio": reference_best / best,
                "peak_bytes_per_element": peak / case.mesh.nt,
                "repetitions": len(seconds),
            }


def _timed(call: Callable[[], Any]) -> list[float]:
    """Seconds of each repetition, after one that is not counted."""
    call()
    seconds: list[float] = []
    while len(seconds) < REPETITIONS or (sum(seconds) < SECONDS / 10 and len(seconds) < 100):
        start = time.perf_counter()
        call()
        seconds.append(time.perf_counter() - start)
        if sum(seconds) > SECONDS and len(seconds) >= 2:
            break
    return seconds


def _peak(call: Callable[[], Any]) -> int:
    """Largest memory that NumPy and Python held during the call, in bytes, beyond what they held before."""
    tracemalloc.start()
    try:
        call()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def error_table(case: Case, body: Homogeneous) -> dict[str, dict[str, float]]:
    """Errors of W, F and K v against 50 digits on a patch of the body, strained by 0.1 %: what the speed is shown against."""
    piece = patch(case.mesh)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StvkWarning)  # the patch may be in pieces
        ours = System(piece, body.term)
    reference = ReferenceStVK(piece.p, piece.t, body.tensor)
    noise = 1e-3 * vertex_sizes(piece)[:, None] * case.random("speed").standard_normal((2, piece.nv, piece.d))
    u, v = noise.reshape(2, -1)
    exact = ExactStVK(piece.p, piece.t, body.lame)
    (W, F), Kv = exact.energy_and_force(u), exact.product(u, v)
    errors = {
        name: {
            "W": abs(model.energy(u) - W) / W,
            "F": _relative(model.internal_force(u), F),
            "K": _relative(model.tangent(u) @ v, Kv),
        }
        for name, model in ((OURS, ours), (REFERENCE, reference))
    }
    textbook = forms_on(piece, body)[TEXTBOOK]
    return errors | {TEXTBOOK: {"F": _relative(textbook(u), F)}}


def _relative(value: NDArray[Any], truth: Array) -> float:
    return float(np.abs(value - truth).max() / np.abs(truth).max())
