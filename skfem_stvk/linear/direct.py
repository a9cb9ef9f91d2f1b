"""A solve with factors that trusts them only as far as the residual says."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .solver import Outcome, Solution, Vector


def solve_checked(product: Callable[[Vector], Vector], inverse: Callable[[Vector], Vector], b: Vector, rtol: float) -> Solution:
    """`x = inverse(b)`, refined once (`x += inverse(b - K x)`) where the residual is above `rtol |b|`, and kept if that made it smaller."""
    size = float(np.linalg.norm(b))
    if not np.isfinite(size):
        return nothing(b, Outcome.NOT_FINITE)
    if size == 0:
        return Solution(np.zeros_like(b), 0, 0.0, Outcome.SOLVED)
    x = inverse(b)
    if not np.isfinite(x).all():
        return nothing(b, Outcome.SINGULAR)
    r = b - product(x)
    residual, refined = float(np.linalg.norm(r)) / size, 0
    if residual > rtol:
        y = x + inverse(r)
        better = float(np.linalg.norm(b - product(y))) / size
        if better < residual:
            x, residual, refined = y, better, 1
    if not np.isfinite(residual):
        return nothing(b, Outcome.NOT_FINITE)
    return Solution(x, refined, residual, Outcome.SOLVED if residual <= rtol else Outcome.INACCURATE)


def nothing(b: Vector, outcome: Outcome) -> Solution:
    """There is no solution, and the outcome says why."""
    return Solution(np.zeros_like(b), 0, 1.0, outcome)
