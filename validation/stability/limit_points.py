"""Paths by their length, their first limit points, and what these tend to on finer meshes."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from skfem_stvk import StvkWarning, System, solve_static
from skfem_stvk.statics import CriticalPoint, StaticResult, Stop

from ..statics.orders import extrapolated, fitted_order
from .not_found import NotFoundError


def through(system: System, stop: Stop, steps: int, **options: Any) -> StaticResult:
    """A path by its length, whatever the state in which it ends and the elements that soften on the way."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StvkWarning)
        return solve_static(system, steps, method="arc-length", stop=stop, quiet=True, raise_on_failure=False, **options)


def first(result: StaticResult, kind: str) -> CriticalPoint:
    """The first "limit point" or "bifurcation" of a path.

    Raises
    ------
    NotFoundError
        if there is none, or it was not resolved.
    """
    point = next((point for point in result.critical_points if point.kind == kind), None)
    if point is None:
        raise NotFoundError(f"There is no {kind} on the path. {result.message}")
    if not point.resolved:
        raise NotFoundError(f"A {kind} was found, but not resolved: {point}.")
    return point


def wrong(result: StaticResult, turns: int = 2) -> Iterator[str]:
    """What a path that snaps through, over one limit point down to another and up again, must not be; or over one only."""
    kinds = [point.kind for point in result.critical_points]
    if kinds != ["limit point"] * turns:
        yield f"{', '.join(kinds) or 'nothing'} found; expected {turns} limit point(s)"
    if not min(step.smallest_volume_ratio for step in result.history) > 0:
        yield "elements turned inside out"


class Convergence(NamedTuple):
    """Values on meshes that are halved each time, and the truth."""

    values: Sequence[float]
    truth: float

    @property
    def limit(self) -> float:
        """The limit load by Richardson's extrapolation, repeated."""
        return extrapolated(self.values)

    @property
    def order(self) -> float:
        """The order of the distance from the truth, on the last three meshes."""
        errors = np.abs(np.asarray(self.values) - self.truth)[-3:]
        return fitted_order(0.5 ** np.arange(len(errors)), errors)

    def rows(self, names: Sequence[str]) -> list[tuple[str, ...]]:
        """A name, a value and its distance from the truth each; the limit and the order."""
        values = [(name, f"{value:.6f}", f"{value / self.truth - 1:+.3%}") for name, value in zip(names, self.values, strict=True)]
        return [
            *values,
            ("extrapolated", f"{self.limit:.6f}", f"{self.limit / self.truth - 1:+.3%}"),
            ("order", f"{self.order:.2f}", ""),
        ]

    def failures(self, limit: float, order: tuple[float, float]) -> Iterator[str]:
        """If the limit is further off than `limit`, or the order than `order[1]` from `order[0]`."""
        if not abs(self.limit / self.truth - 1) <= limit:
            yield f"extrapolated to {self.limit:.6f}, expected {self.truth:.6f}"
        if not abs(self.order - order[0]) <= order[1]:
            yield f"order {self.order:.2f}"
