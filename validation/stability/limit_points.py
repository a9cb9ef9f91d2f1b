"""Arc-length paths, their first critical points, and the convergence of these under refinement."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from skfem_stvk import StvkWarning, System, solve_static
from skfem_stvk.solvers.statics import CriticalPoint, StaticResult, Stop

from ..statics.orders import extrapolated, fitted_order
from .not_found import NotFoundError


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


def wrong(result: StaticResult, count: int = 2) -> Iterator[str]:
    """Yield the faults of a snap-through path: other critical points than `count` limit points, and inverted elements."""
    kinds = [point.kind for point in result.critical_points]
    if kinds != ["limit point"] * count:
        yield f"{', '.join(kinds) or 'nothing'} found; expected {count} limit point(s)"
    if not min(step.smallest_volume_ratio for step in result.history) > 0:
        yield "elements inverted on the path"


class Convergence(NamedTuple):
    """Values on meshes that are halved each time, and the exact value."""

    values: Sequence[float]
    truth: float

    @property
    def limit(self) -> float:
        """Limit load by repeated Richardson extrapolation."""
        return extrapolated(self.values)

    @property
    def order(self) -> float:
        """Order of the errors on the last three meshes."""
        errors = np.abs(np.asarray(self.values) - self.truth)[-3:]
        return fitted_order(0.5 ** np.arange(len(errors)), errors)

    def rows(self, names: Sequence[str]) -> list[tuple[str, ...]]:
        """Return rows of name, value and relative error for each mesh, the extrapolated limit, and the order."""
        values = [(name, f"{value:.6f}", f"{value / self.truth - 1:+.3%}") for name, value in zip(names, self.values, strict=True)]
        return [
            *values,
            ("extrapolated", f"{self.limit:.6f}", f"{self.limit / self.truth - 1:+.3%}"),
            ("order", f"{self.order:.2f}", ""),
        ]

    def failures(self, limit: float, order: tuple[float, float]) -> Iterator[str]:
        """Yield messages if the error of the limit exceeds `limit`, or the order differs from `order[0]` by over `order[1]`."""
        if not abs(self.limit / self.truth - 1) <= limit:
            yield f"extrapolated limit = {self.limit:.6f}; expected {self.truth:.6f}"
        if not abs(self.order - order[0]) <= order[1]:
            yield f"order {self.order:.2f}; expected {order[0]:g} +- {order[1]:g}"
