"""Newton's method at one load."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from ..arguments import Array
from ..errors import StateError
from ..linear import Outcome, Solution
from ..terms.load import Time
from .line_search import quartic_minimum, root_of_slope
from .problem import Problem, Residual, Tangent

#: With the line search, the same from a state with elements inside out, and with full steps.
MOST_ITERATIONS, MOST_TANGLED, MOST_FULL = 40, 120, 20
#: The loosest linear solve of an iterative solver (Eisenstat and Walker 1996, choice 2).
LOOSEST = 0.1
#: The line search stops at this part of the length at which the first element would be flat, and where that is shorter than this, it is over.
BEFORE_THE_LIMIT, SHORTEST = 0.8, 1e-3


class End(Enum):
    """How Newton's method ended; the value says it in words."""

    CONVERGED = "the residual is below rtol times loads and reactions"
    AT_ROUND_OFF = "the residual is what rounding leaves"
    OUT_OF_ITERATIONS = "Newton's method ran out of iterations"
    INSIDE_OUT = "elements would turn inside out"
    NO_DESCENT = "no tangent gave a direction of descent"
    NO_LENGTH = "the residual does not fall along the direction of Newton's method"
    OVERFLOW = "displacements grew without bound"
    TOO_SHARP = "the path turns too sharply"

    @property
    def converged(self) -> bool:
        """Whether a state of equilibrium was found."""
        return self in (End.CONVERGED, End.AT_ROUND_OFF)


@dataclass
class Iterations:
    """What happened in the iterations, one entry each.

    Attributes
    ----------
    residuals : relative to loads and reactions, where each iteration began and at the end.
    lengths : factors of the line search.
    tangents : "exact", "clamped" or "shifted".
    linear : iterations of the linear solver.
    negative_pivots : of the last exact tangent, or of that of the state that was found; None if the solver does not know.
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
    problem: Problem,
    u: Array,
    t: Time,
    rtol: float,
    most_inside_out: int,
    watch: Callable[[Iterations], None],
    full_first: bool,
) -> tuple[Array, End, Iterations]:
    """Equilibrium at load factor `t` from `u` (ndofs,), whose held degrees of freedom are where they belong.

    With `full_first`, full steps of the exact tangent are tried: slender bodies bend that way in a third of the iterations, for a full step
    stretches them first and a line search does not let it. Unless they arrive, at a stable state, with no more than `most_inside_out` elements
    inside out and none that would be flat on the straight way there, it begins anew with the line search, which is exact where W is a quartic
    along any line and loads are dead, a tangent that is positive definite where the exact one gives no descent, and steps that end
    before elements turn inside out, unless some are already.
    """
    record = Iterations()
    if full_first:
        found, end = _iterate(problem, u, t, rtol, record, watch, search=False)
        stable = end.converged and not record.negative_pivots
        if stable and len(problem.inside_out(found)) <= most_inside_out and problem.on_this_side(u, found):
            return found, end, record
        record.restarted = len(record)
    found, end = _iterate(problem, u, t, rtol, record, watch, search=True)
    if end.converged and len(turned := problem.inside_out(found)) > most_inside_out:
        record.detail = problem.named(turned)
        return found, End.INSIDE_OUT, record
    return found, end, record


def _iterate(
    problem: Problem,
    u: Array,
    t: Time,
    rtol: float,
    record: Iterations,
    watch: Callable[[Iterations], None],
    search: bool,
) -> tuple[Array, End]:
    """Newton's iterations, with the line search or with full steps."""
    forcing, before, tangled = LOOSEST, None, len(problem.inside_out(u)) > 0
    most = len(record) + (MOST_FULL if not search else MOST_TANGLED if tangled else MOST_ITERATIONS)
    try:
        residual = problem.residual(u, t)
        while True:
            record.residuals.append(residual.relative)
            watch(record)
            end = arrived(problem, u, t, residual, before, rtol)
            if end is not None:
                if len(record):  # each iteration has made an exact tangent, also where another one was taken
                    record.negative_pivots = problem.negative_pivots()
                return u, end
            if len(record) == most:
                if record.tangents[-1] != "exact":
                    record.detail = "K is not positive definite there: the body gives way or buckles"
                    record.detail += ", or it is too ill-conditioned for CG: try solver='superlu'" * problem.iterative
                return u, End.OUT_OF_ITERATIONS
            v = _direction(problem, u, t, residual, max(forcing, 0.3 * rtol / residual.relative), record, search)
            if v is None:
                return u, End.NO_DESCENT
            moved = _moved(problem, u, v, t, residual, record, search, tangled)
            if isinstance(moved, End):
                return u, moved
            u, before = moved, residual
            residual = problem.residual(u, t)
            forcing = _forcing(forcing, residual, before)
    except StateError:
        return u, End.OVERFLOW


def arrived(problem: Problem, u: Array, t: Time, residual: Residual, before: Residual | None, rtol: float) -> End | None:
    """How the state is one of equilibrium, if it is; `before` is the residual of the iteration before."""
    if residual.size <= rtol * residual.scale:
        return End.CONVERGED
    # the estimate is an upper one: what rounding leaves has also ceased to fall
    ceased = before is None or residual.size > before.size / 2
    return End.AT_ROUND_OFF if ceased and residual.size <= problem.round_off(u, t) else None


def _forcing(last: float, now: Residual, before: Residual) -> float:
    """How precise the next linear solve of an iterative solver has to be."""
    new = 0.9 * (now.size / before.size) ** 2
    kept = 0.9 * last**2
    return min(LOOSEST, max(new, kept) if kept > 0.1 else new)


def _direction(
    problem: Problem, u: Array, t: Time, residual: Residual, rtol: float, record: Iterations, search: bool
) -> Array | None:
    """(ndofs,) Newton's direction, with the first tangent that gives one of descent; for full steps the exact one only."""
    for tangent in Tangent if search else (Tangent.EXACT,):
        factors = problem.factorise(u, t, tangent)
        solution = problem.solve(factors, -residual.free, rtol)
        if not usable(solution) and tangent is Tangent.EXACT and problem.take_over(u, t):
            solution = problem.solve(problem.factorise(u, t), -residual.free, rtol)
        if not usable(solution):
            record.detail = solution.outcome.value
            continue
        v = problem.direction(solution.x)
        if problem.slope(residual, v) < 0:
            record.tangents.append(tangent.value)
            record.linear.append(solution.iterations)
            record.detail = ""
            return v
        record.detail = "the direction is not one of descent"
    return None


def usable(solution: Solution, singular: bool = False) -> bool:
    """Whether Newton's method can go on with it: with less precision than asked for, too, as long as most of the residual is answered.

    Where K is expected to be as good as `singular`, all that is missing lies along the mode in which the body gives way, and any answer of a
    direct solver will do.
    """
    imprecise = solution.outcome in (Outcome.INACCURATE, Outcome.OUT_OF_ITERATIONS)
    enough = solution.residual <= LOOSEST or (singular and solution.outcome is Outcome.INACCURATE)
    return solution.outcome is Outcome.SOLVED or (imprecise and enough)


def _moved(
    problem: Problem, u: Array, v: Array, t: Time, residual: Residual, record: Iterations, search: bool, tangled: bool
) -> Array | End:
    """`u + s v`, with the length `s` of the line search, which ends before elements turn inside out; or the full step.

    From a state that is `tangled`, with elements inside out, others have to turn with them on the way back.
    """
    if not search:
        record.lengths.append(1.0)
        return u + v
    limit = np.inf if tangled else problem.step_limit(u, v)
    s = _length(problem, u, v, t, residual, BEFORE_THE_LIMIT * limit)
    if s is None:
        return End.NO_LENGTH
    if s < SHORTEST and s == BEFORE_THE_LIMIT * limit:
        record.detail = problem.named(problem.inside_out(u + 1.01 * limit * v))
        return End.INSIDE_OUT
    record.lengths.append(s)
    return u + s * v


def _length(problem: Problem, u: Array, v: Array, t: Time, residual: Residual, longest: float) -> float | None:
    """Of the line search, `longest` at most."""
    slope = problem.slope(residual, v)
    if problem.quartic:
        c = problem.energy_along(u, v, t)
        if abs(c[1] - slope) > 0.1 * abs(slope):  # rounding is as large as what there is to gain
            return min(1.0, longest)
        s = min(quartic_minimum(c), longest)
        return s if np.isfinite(s) else None

    def slope_at(s: float) -> float:
        return problem.slope(problem.residual(u + s * v, t), v)

    return root_of_slope(slope_at, slope, longest)
