"""How time and memory grow with the mesh."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .results import OURS, Benchmark


def slope(sizes: Sequence[float], amounts: Sequence[float]) -> float | None:
    """The exponent `s` of `amount ~ size^s`, fitted to logarithms; None if there are fewer than two sizes.

    >>> round(slope([10, 100, 1000], [3, 300, 30000]), 12)
    2.0
    """
    return float(np.polyfit(np.log(sizes), np.log(amounts), 1)[0]) if len(set(sizes)) > 1 else None


def of_time(results: Benchmark, quantity: str) -> float | None:
    """Exponent of a call's time on the boxes: one thread, double precision."""
    found = [results.timing(mesh, OURS, quantity) for mesh in results.meshes if mesh.startswith("box")]
    times = [timing for timing in found if timing is not None]
    return slope([t.nt for t in times], [t.best * t.nt for t in times])


def of_memory(results: Benchmark, quantity: str) -> float | None:
    """Exponent of what a system holds on the boxes, besides the pattern of K."""
    held = [m for m in results.memory if m.mesh.startswith("box") and (m.quantity, m.dtype) == (quantity, "float64")]
    return slope([m.nt for m in held], [m.besides for m in held])
