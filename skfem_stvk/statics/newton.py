"""Newton's method at one load."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import StateError
from ..linear import Outcome, Solution
from .equilibrium import Equilibrium, Residual, Tangent
from .line_search import quartic_minimum, root_of_slope
from .status import Status

Array = NDArray[Any]

#: With the line search, and with full steps.
MOST_ITERATIONS, MOST_FULL = 40, 20
#: The loosest linear solve of an iterative solver (Eisenstat and Walker 1996, choice 2).
LOOSEST = 0.1


class End(Enum):
    """How Newton's method ended; the value says it in words."""

    CONVERGED = "the residual is below rtol times loads and reactions"
    AT_ROUND_OFF = "the residual is what rounding leaves"
    OUT_OF_ITERATIONS = f"Newton's method did not converge in {MOST_ITERATIONS} iterations"
    INSIDE_OUT = "elements would turn inside out"
    NO_DESCENT = "no tangent gave a direction of descent"
    NO_LENGTH = "the residual does not fall along the direction of Newton's method"
    OVERFLOW = "displacements grew without bound"

    @property
    def converged(self) -> bool:
        """Whether a state of equilibrium was found."""
        return self in (End.CONVERGED, End.AT_ROUND_OFF)

    @property
    def status(self) -> Status:
        """Of a state that was found, if it is stable and not inside out."""
        return Status.CONVERGED if self is End.CONVERGED else Status.AT_ROUND_OFF


@dataclass
class Iterations:
    """What happened in the iterations, one entry each.

    Attributes
    ----------
    residuals : relative to loads and reactions, where each iteration began and at the end.
    lengths : factors of the line search.
    tangents : "exact", "clamped" or "shifted".
    linear : iterations of the linear solver.
    negative_pivots : of the last exact tangent; None if the solver does not know.
    restarted : after how many iterations full steps were given up and it began anew with the line search; None if it did not.
    detail : what a failure says of itself.
    """

    residuals: list[float] = field(default_factory=list)
    lengths: list[float] = field(default_factory=list)
    tangents: list[str] = field(default_factory=list)
    linear: list[int] = field(default_factory=list)
    negative_pivots: int | None = None
    restarted: int | None = None
    detail: str = ""

    def __len__(self) -> int:
        return len(self.lengths)


def newton(
    problem: Equilibrium,
    u: Array,
    t: float,
    rtol: float,
    most_inside_out: int,
    watch: Callable[[Iterations], None],
    full_first: bool,
) -> tuple[Array, End, Iterations]:
    """Equilibrium at load factor `t` from `u` (ndofs,), whose held degrees of freedom are where they belong.

    With `full_first`, full steps of the exact tangent are tried: slender bodies bend that way in a third of the iterations, for a full step
    stretches them first and a line search does not let it. Unless they arrive, at a stable state and with no more than `most_inside_out`
    elements inside out, it begins anew with the line search, which is exact where loads have a potential (W is a quartic along any line), a
    tangent that is positive definite where the exact one gives no descent, and steps cut back where elements would turn inside out.
    """
    record = Iterations()
    if full_first:
        found, end = _iterate(problem, u, t, rtol, most_inside_out, record, watch, search=False)
        if end.converged and not record.negative_pivots and len(problem.inside_out(found)) <= most_inside_out:
            return found, end, record
        record.restarted = len(record)
    found, end = _iterate(problem, u, t, rtol, most_inside_out, record, watch, search=True)
    return found, end, record


def _iterate(
    problem: Equilibrium,
    u: Array,
    t: float,
    rtol: float,
    most_inside_out: int,
    record: Iterations,
    watch: Callable[[Iterations], None],
    search: bool,
) -> tuple[Array, End]:
    """Newton's iterations, with the line search or with full steps."""
    forcing, before, most = LOOSEST, None, len(record) + (MOST_ITERATIONS if search else MOST_FULL)
    try:
        residual = problem.residual(u, t)
        while True:
            record.residuals.append(residual.relative)
            watch(record)
            if residual.size <= rtol * residual.scale:
                return u, _converged(problem, record, End.CONVERGED)
            # the estimate is an upper one: what rounding leaves has also ceased to fall
            ceased = before is None or residual.size > before.size / 2
            if ceased and residual.size <= problem.round_off(u, t):
                return u, _converged(problem, record, End.AT_ROUND_OFF)
            if len(record) == most:
                if record.tangents[-1] != "exact":
                    record.detail = "K is not positive definite there: the body gives way or buckles"
                    record.detail += ", or it is too ill-conditioned for CG: try solver='superlu'" * problem.solver.iterative
                return u, End.OUT_OF_ITERATIONS
            v = _direction(problem, u, t, residual, max(forcing, 0.3 * rtol / residual.relative), record, search)
            if v is None:
                return u, End.NO_DESCENT
            moved = _moved(problem, u, v, t, residual, most_inside_out, record, search)
            if isinstance(moved, End):
                return u, moved
            u, before = moved, residual
            residual = problem.residual(u, t)
            forcing = _forcing(forcing, residual, before)
    except StateError:
        return u, End.OVERFLOW


def _converged(problem: Equilibrium, record: Iterations, end: End) -> End:
    """The end, with what the last exact tangent says of stability; each iteration has one, also where another one is taken."""
    if len(record):
        record.negative_pivots = problem.negative_pivots()
    return end


def _forcing(last: float, now: Residual, before: Residual) -> float:
    """How precise the next linear solve of an iterative solver has to be."""
    new = 0.9 * (now.size / before.size) ** 2
    kept = 0.9 * last**2
    return min(LOOSEST, max(new, kept) if kept > 0.1 else new)


def _direction(
    problem: Equilibrium, u: Array, t: float, residual: Residual, rtol: float, record: Iterations, search: bool
) -> Array | None:
    """(ndofs,) Newton's direction, with the first tangent that gives one of descent; for full steps the exact one only."""
    for tangent in Tangent if search else (Tangent.EXACT,):
        factors = problem.factorise(u, t, tangent)
        solution = problem.solve(factors, -residual.free, rtol)
        if not usable(solution):
            record.detail = solution.outcome.value
            continue
        if solution.x @ residual.free < 0:
            record.tangents.append(tangent.value)
            record.linear.append(solution.iterations)
            record.detail = ""
            return problem.free.vector(solution.x)
        record.detail = "the direction is not one of descent"
    return None


def usable(solution: Solution) -> bool:
    """Whether Newton's method can go on with it: with less precision than asked for, too, as long as most of the residual is answered."""
    imprecise = solution.outcome in (Outcome.INACCURATE, Outcome.OUT_OF_ITERATIONS)
    return solution.outcome is Outcome.SOLVED or (imprecise and solution.residual <= LOOSEST)


def _moved(
    problem: Equilibrium, u: Array, v: Array, t: float, residual: Residual, most_inside_out: int, record: Iterations, search: bool
) -> Array | End:
    """`u + s v`, with the length `s` of the line search, cut back where elements would turn inside out; or the full step."""
    if not search:
        record.lengths.append(1.0)
        return u + v
    s = _length(problem, u, v, t, residual)
    if s is None:
        return End.NO_LENGTH
    for _ in range(10):
        moved = u + s * v
        turned = problem.inside_out(moved)
        if len(turned) <= most_inside_out:
            record.lengths.append(s)
            return moved
        s /= 2
    record.detail = problem.named(turned)
    return End.INSIDE_OUT


def _length(problem: Equilibrium, u: Array, v: Array, t: float, residual: Residual) -> float | None:
    slope = float(residual.free @ v[problem.free.free])
    if problem.system.conservative:
        c = problem.energy_along(u, v, t)
        if abs(c[1] - slope) > 0.1 * abs(slope):  # rounding is as large as what there is to gain
            return 1.0
        s = quartic_minimum(c)
        return s if np.isfinite(s) else None

    def slope_at(s: float) -> float:
        return float(problem.residual(u + s * v, t).free @ v[problem.free.free])

    return root_of_slope(slope_at, slope)
