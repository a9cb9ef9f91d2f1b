"""Newton's method at one load, and its line search along a direction of descent."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from ...arguments import Array
from ...errors import StateError
from ...linear import Outcome, Solution
from ...npz import Count, Measured
from ...terms.loads.load import Time
from .outcome import Status
from .problem import Problem, Residual, Tangent, slope

#: Iteration limits: with the line search, with the line search from a state with inverted elements, and with full steps.
MOST_ITERATIONS, MOST_INVERTED, MOST_FULL = 40, 120, 20
#: Largest relative tolerance of an iterative linear solve (Eisenstat and Walker 1996, choice 2).
LOOSEST = 0.1
#: The line search stops at `BEFORE_THE_LIMIT` times the step at which the first element becomes flat. If that is less than
#: `SHORTEST` of the full step, the method ends.
BEFORE_THE_LIMIT, SHORTEST = 0.8, 1e-3
#: The slope along the line counts as zero below this fraction of its initial value.
GOOD_ENOUGH = 0.1


class End(Enum):
    """Reason why Newton's method ended; the value is its description."""

    CONVERGED = "the residual is below rtol times loads and reactions"
    AT_ROUND_OFF = "the residual is as small as round-off allows"
    OUT_OF_ITERATIONS = "Newton's method ran out of iterations"
    INSIDE_OUT = "elements would invert"
    CONTACT = "the body would pass through a contact"
    NO_DESCENT = "no tangent gave a direction of descent"
    NO_LENGTH = "the residual does not fall along the direction of Newton's method"
    OVERFLOW = "displacements grew without bound"
    TOO_SHARP = "the path turns too sharply"

    @property
    def converged(self) -> bool:
        """Whether a state of equilibrium was found."""
        return self in (End.CONVERGED, End.AT_ROUND_OFF)

    @property
    def status(self) -> Status:
        """Status of the converged state, provided that the state is stable and has no inverted elements."""
        return Status.CONVERGED if self is End.CONVERGED else Status.AT_ROUND_OFF


@dataclass
class Iterations:
    """Record of the iterations of Newton's method; each list has one entry per iteration.

    Attributes
    ----------
    residuals
        Residuals relative to loads and reactions, at the beginning of each iteration and at the end.
    lengths
        Factors of the line search.
    tangents
        Tangents of the iterations, "exact", "clamped" or "shifted".
    linear
        Numbers of iterations of the linear solver.
    negative_pivots
        Number of negative pivots of the last exact tangent, or of the tangent at the converged state; None if the solver does not
        report it.
    restarted
        Number of full-step iterations before the method restarted with the line search; None if it did not restart.
    detail
        Description of a failure, or a remark on the state.
    """

    residuals: list[Measured] = field(default_factory=list)
    lengths: list[Measured] = field(default_factory=list)
    tangents: list[str] = field(default_factory=list)
    linear: list[Count] = field(default_factory=list)
    negative_pivots: Count | None = None
    restarted: Count | None = None
    detail: str = ""

    def __len__(self) -> int:
        return len(self.lengths)


@dataclass(frozen=True)
class NewtonOptions:
    """Options of one Newton solve."""

    rtol: float  # relative tolerance: the residual is small enough below this fraction of its scale
    most_inside_out: int = 0  # largest number of inverted elements allowed in the result
    full_first: bool = True  # try full steps first
    watch: Callable[[Iterations], None] = lambda record: None  # called at the beginning of each iteration


def newton(problem: Problem, u: Array, t: Time, options: NewtonOptions) -> tuple[Array, End, Iterations]:
    """Find the equilibrium at load factor `t`, starting from `u`.

    `u` must satisfy the prescribed displacements at `t`.

    With `full_first`, the method first tries full steps of the exact tangent. Slender bodies bend in a third of the iterations this
    way. A full step stretches them first, and a line search does not allow that. With a barrier between surfaces full steps are
    left out: they jump into each other, where the search for collisions takes 40 times as long. The result of the full steps is
    accepted if it meets three conditions. It is a stable equilibrium. It has at most `most_inside_out` inverted elements. No
    element would become flat on the straight line from `u` to the result.

    Otherwise the method restarts from `u` with the line search. The line search is exact where W is a quartic along any line and
    loads are dead. If the exact tangent gives no direction of descent, a positive definite tangent replaces it. Steps end before
    elements invert, unless some elements are inverted already. Starting states with inverted elements lie among saddle points. An
    indefinite tangent leads to the saddle points, and the positive definite tangent leads past them.
    """
    record = Iterations()
    if options.full_first and not problem.has_barrier:
        found, end = _Descent(problem, t, options, record, search=False).from_state(u)
        stable = end.converged and not record.negative_pivots
        if stable and len(problem.inside_out(found)) <= options.most_inside_out and problem.way_is_free(u, found, t):
            return found, end, record
        record.restarted = len(record)
    found, end = _Descent(problem, t, options, record, search=True).from_state(u)
    if end.converged and len(still_inverted := problem.inside_out(found)) > options.most_inside_out:
        record.detail = problem.named(still_inverted)
        return found, End.INSIDE_OUT, record
    return found, end, record


@dataclass(frozen=True)
class _Descent:
    """Newton's iterations at one load, with the line search or with full steps."""

    problem: Problem
    t: Time
    options: NewtonOptions
    record: Iterations
    search: bool

    def from_state(self, u: Array) -> tuple[Array, End]:
        problem, t, record, rtol = self.problem, self.t, self.record, self.options.rtol
        forcing, before, inverted = LOOSEST, None, len(problem.inside_out(u)) > 0
        most = len(record) + (MOST_FULL if not self.search else MOST_INVERTED if inverted else MOST_ITERATIONS)
        try:
            residual = problem.residual(u, t)
            while True:
                record.residuals.append(residual.relative)
                self.options.watch(record)
                end = equilibrium_end(problem, u, t, residual, before, rtol)
                if end is not None:
                    record.detail = ""
                    if len(record):  # each iteration has factorised an exact tangent, even if the step used another tangent
                        record.negative_pivots = problem.negative_pivots()
                    return u, end
                if len(record) == most:
                    if record.tangents[-1] != "exact":
                        record.detail = "K is not positive definite there: the body gives way or buckles"
                        record.detail += ", or it is too ill-conditioned for CG: try solver='superlu'" * problem.iterative
                    return u, End.OUT_OF_ITERATIONS
                v = self._direction(u, residual, max(forcing, 0.3 * rtol / residual.relative), inverted)
                if v is None:
                    return u, End.NO_DESCENT
                moved = self._moved(u, v, residual, inverted)
                if isinstance(moved, End):
                    if moved is End.NO_LENGTH and residual.size <= problem.round_off(u, t):
                        moved, record.negative_pivots = End.AT_ROUND_OFF, problem.negative_pivots()
                    return u, moved
                u, before = moved, residual
                residual = problem.residual(u, t)
                forcing = _forcing(forcing, residual, before)
        except StateError:
            return u, End.OVERFLOW

    def _direction(self, u: Array, residual: Residual, rtol: float, inverted: bool) -> Array | None:
        """Return Newton's direction for the first tangent that gives a direction of descent; None if no tangent does.

        Full steps use the exact tangent only.

        If elements are inverted, an exact tangent with negative eigenvalues is skipped.
        """
        problem, t, record = self.problem, self.t, self.record
        for tangent in Tangent if self.search else (Tangent.EXACT,):
            factors = problem.factorise(u, t, tangent)
            if inverted and tangent is Tangent.EXACT and problem.negative_pivots():
                continue  # it would lead to a saddle point
            solution = problem.solve(factors, -residual.vector, rtol)
            if not usable(solution) and tangent is Tangent.EXACT and problem.switch_to_direct(u, t):
                solution = problem.solve(problem.factorise(u, t), -residual.vector, rtol)
            if not usable(solution):
                record.detail = solution.outcome.value
                continue
            v = problem.space.expand(solution.x)
            if slope(problem, residual, v) < 0:
                record.tangents.append(tangent.value)
                record.linear.append(solution.iterations)
                record.detail = ""
                return v
            record.detail = "the direction is no direction of descent"
        return None

    def _moved(self, u: Array, v: Array, residual: Residual, inverted: bool) -> Array | End:
        """Return `u + s v` for a full step, or for a step that ends before elements invert.

        If `inverted` (elements are inverted already), the step may pass through zero volume.
        """
        if not self.search:
            self.record.lengths.append(1.0)
            return u + v
        limit = np.inf if inverted else self.problem.step_limit(u, v)
        through, contact = self.problem.contact_limit(u, v, self.t)
        limit = min(limit, through)
        s = length(self.problem, u, v, self.t, residual, BEFORE_THE_LIMIT * limit)
        if s is None:
            return End.NO_LENGTH
        if s < SHORTEST and s == BEFORE_THE_LIMIT * limit:
            if limit == through:
                self.record.detail = f"{contact!r}"
                return End.CONTACT
            self.record.detail = self.problem.named(self.problem.inside_out(u + 1.01 * limit * v))
            return End.INSIDE_OUT
        self.record.lengths.append(s)
        return u + s * v


def equilibrium_end(problem: Problem, u: Array, t: Time, residual: Residual, before: Residual | None, rtol: float) -> End | None:
    """Return why the state counts as an equilibrium, or None if it is not an equilibrium.

    `before` is the residual of the previous iteration.
    """
    if residual.size <= rtol * residual.scale:
        return End.CONVERGED
    # the estimate is an upper bound, so the residual must also have stopped falling
    stalled = before is None or residual.size > before.size / 2
    return End.AT_ROUND_OFF if stalled and residual.size <= problem.round_off(u, t) else None


def _forcing(last: float, now: Residual, before: Residual) -> float:
    """Return the relative tolerance of the next linear solve of an iterative solver."""
    new = 0.9 * min(now.size / before.size, 1.0) ** 2  # residuals may grow by 1e200
    safeguard = 0.9 * last**2
    return min(LOOSEST, max(new, safeguard) if safeguard > 0.1 else new)


def usable(solution: Solution, singular: bool = False) -> bool:
    """Return whether Newton's method can use a solution.

    A solution of reduced precision is usable if its relative residual is at most `LOOSEST`.

    Set `singular` if K is expected to be nearly singular. Then the error of the solution lies along the mode in which the body
    gives way. In this case an inaccurate solution of a direct solver is usable.
    """
    imprecise = solution.outcome in (Outcome.INACCURATE, Outcome.OUT_OF_ITERATIONS)
    enough = solution.residual <= LOOSEST or (singular and solution.outcome is Outcome.INACCURATE)
    return solution.outcome is Outcome.SOLVED or (imprecise and enough)


def length(problem: Problem, u: Array, v: Array, t: Time, at_zero: Residual, longest: float) -> float | None:
    """Return the factor `s <= longest` of the direction `v` from `u`; None if no factor is found.

    `at_zero` is the residual at `u`.
    """
    at_start = slope(problem, at_zero, v)
    if not problem.quartic:
        return root_of_slope(lambda s: slope(problem, problem.residual(u + s * v, t), v), at_start, longest)
    c = problem.energy_along(u, v, t)
    if abs(c[1] - at_start) > 0.1 * abs(at_start):  # round-off is as large as the possible decrease
        return min(1.0, longest)
    s = min(quartic_minimum(c), longest)
    return s if np.isfinite(s) else None


def quartic_minimum(c: Array) -> float:
    """Return the first minimum at `s > 0` of `c0 + c1 s + ... + c4 s^4`; infinity if the polynomial never stops falling.

    The polynomial must fall at 0. Later minima belong to other states, including mirrored ones.

    >>> round(quartic_minimum(np.array([0, -1, 0.5, 0, 0])), 12)
    1.0
    >>> quartic_minimum(np.array([0, -1.0, 0, 0, 0]))
    inf
    """
    k = np.array([4, 3, 2])
    slope = k * c[k]
    if not slope.any():
        return np.inf
    with np.errstate(divide="ignore"):
        unit = float(((np.abs(c[1] / slope)) ** (1 / (k - 1))).min())  # scaling of `s` in which no term exceeds the first one
    scaled = np.append(slope * unit ** (k - 1.0), c[1]) / abs(c[1])
    roots = np.roots(scaled)
    real = np.sort(roots.real[(np.abs(roots.imag) <= 1e-7 * np.abs(roots)) & (roots.real > 0)])
    return unit * float(real[0]) if len(real) else np.inf


def root_of_slope(slope: Callable[[float], float], at_zero: float, longest: float = np.inf, most: int = 12) -> float | None:
    """Return a length `s` with `|slope(s)| <= 0.1 |slope(0)|`; None if none is found within the evaluation limit.

    The method is doubling, then safeguarded secants.

    `slope(s)` is the residual times the direction, and is negative at zero. It is not evaluated beyond `longest`. If the slope is
    still negative at `longest`, the result is `longest`.

    >>> round(root_of_slope(lambda s: s**3 - 8, -8.0), 1)
    2.0
    >>> root_of_slope(lambda s: s**3 - 8, -8.0, longest=1.5)
    1.5
    """
    enough = GOOD_ENOUGH * abs(at_zero)
    low, f_low, high = 0.0, at_zero, min(1.0, longest)
    f_high = slope(high)
    while f_high < -enough:
        if high == longest:
            return longest
        low, f_low, high = high, f_high, min(2 * high, longest)
        if high > 2**most:
            return None
        f_high = slope(high)
    if f_high <= enough:
        return high
    for _ in range(most):
        margin = 0.1 * (high - low)
        s = float(np.clip((low * f_high - high * f_low) / (f_high - f_low), low + margin, high - margin))
        f = slope(s)
        if abs(f) <= enough:
            return s
        if f < 0:
            low, f_low = s, f
        else:
            high, f_high = s, f
    return None
