"""Arc-length paths, their first critical points, and the convergence of these under refinement."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any, NamedTuple

from skfem_stvk import StvkWarning, System, solve_static
from skfem_stvk.solvers.statics import CriticalPoint, StaticResult, Stop

from ..statics.orders import extrapolated


class NotFoundError(RuntimeError):
    """Missing limit point or bifurcation."""


def through(system: System, stop: Stop, steps: int, **options: Any) -> StaticResult:
    """Return a path by the arc-length method.

    The path may end without success, and warnings about softening elements are ignored.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StvkWarning)
        return solve_static(system, steps, method="arc-length", stop=stop, quiet=True, raise_on_failure=False, **options)


def first(result: StaticResult, kind: str) -> CriticalPoint:
    """Return the first "limit point" or "bifurcation" of a path.

    Raises
    ------
    NotFoundError
        if there is no such point, or it was not resolved.
    """
    point = next((point for point in result.critical_points if point.kind == kind), None)
    if point is None:
        raise NotFoundError(f"There is no {kind} on the path. {result.message}")
    if not point.resolved:
        raise NotFoundError(f"A {kind} was found, but not resolved: {point}.")
    return point


class Convergence(NamedTuple):
    """Values on meshes that are halved each time, and the exact value."""

    values: Sequence[float]
    truth: float

    @property
    def limit(self) -> float:
        """Limit load by repeated Richardson extrapolation."""
        return extrapolated(self.values)
