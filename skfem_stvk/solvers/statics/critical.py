"""Limit points and bifurcations: states on a path at which the tangent is singular."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal, TypeAlias

import numpy as np

from ...arguments import Array
from ...npz import Vector
from ..newton.stability import lowest_mode, nearest_mode
from .equilibrium import Equilibrium, Hyperplane, correct, path_tangent

CriticalKind: TypeAlias = Literal["limit point", "bifurcation"]
#: Relative precision of the location of a critical point on its step; factor by which residuals there are smaller than elsewhere.
TOLERANCE, TIGHTER = 1e-10, 1e-3
#: A test value below this fraction of its values at the ends of the step is zero. On large meshes round-off is not far below.
NOISE = 1e-9
#: Where K is too singular for a solve, the state is moved by this fraction of the step.
OFFSET = 1e-8


@dataclass(frozen=True)
class Point:
    """State on a path, with the number of negative eigenvalues of K and the lowest eigenvalue [N/m], if they are known."""

    u: Array
    t: float
    negative: int | None = None
    lowest: float | None = None

    @property
    def unstable(self) -> bool:
        """Whether a negative eigenvalue is known."""
        return bool(self.negative) or (self.lowest is not None and self.lowest < 0)


@dataclass(frozen=True, eq=False)
class CriticalPoint:
    """State with a singular tangent, at which the body begins or ceases to give way.

    Attributes
    ----------
    kind
        Kind of the point. "limit point": the load factor reverses, and under more load the body snaps. "bifurcation": another path
        crosses this path, and the body buckles into it.
    t, u
        Load factor and displacements (ndofs,) [m].
    mode
        (ndofs,) eigenvector of K for the eigenvalue zero, scaled to a largest entry of 1: the motion in which the body gives way. A
        small multiple of it, added to the mesh, is the imperfection that leads to the other path.
    resolved
        Whether the point was located to 1e-8 of its step. If not, `t` and `u` are interpolated linearly between two states of the
        path. The interpolation uses the zero of the lowest eigenvalue, where that is known.
    """

    kind: CriticalKind
    t: float
    u: Vector
    mode: Vector
    resolved: bool

    def __str__(self) -> str:
        return f"{self.kind} at t = {self.t:.8g}" if self.resolved else f"{self.kind} near t = {self.t:.4g}"

    __repr__ = __str__


class _PathLost(Exception):
    """Failure to find the path between two states, or unexpected behaviour of the path."""


def find(problem: Equilibrium, before: Point, after: Point, reverses: bool, rtol: float) -> tuple[CriticalPoint, ...]:
    """Return the critical points on the step from `before` to `after`.

    `reverses` says whether the load factor reverses on the step.

    At a limit point `dt/ds` has a root. At a bifurcation an eigenvalue of K changes its sign and has a root.
    """
    if before.lowest is not None and after.lowest is not None:
        if (before.lowest < 0) == (after.lowest < 0):
            return ()
        part = before.lowest / (before.lowest - after.lowest)
        mode = lowest_mode(problem, after.u, after.t).vector
        return (_on_mesh(problem, _unresolved("bifurcation", before, after, part, mode)),)
    changed = before.negative is not None and after.negative is not None and before.negative != after.negative
    if not (changed or reverses):
        return ()
    chord, points = _Chord(problem, before, after, rtol), []
    changes = chord.sign_changes() if changed else 0
    fractions: list[float | None] = []
    if reverses:
        fractions.append(chord.root(chord.rate))
        points.append(_point("limit point", chord, fractions[0], ()))
    if changes > reverses:
        roots = [chord.root(partial(chord.eigenvalue, passed)) for passed in range(changes)]
        if reverses:  # one of them is the limit point
            top = 0.5 if fractions[0] is None else fractions[0]
            roots.remove(min(roots, key=lambda f: np.inf if f is None else abs(f - top)))
        for f in roots:
            points.append(_point("bifurcation", chord, f, [point.mode for point in points]))
            fractions.append(f)
    order = np.argsort([0.5 if f is None else f for f in fractions], kind="stable")
    return tuple(_on_mesh(problem, points[i]) for i in order)


def _on_mesh(problem: Equilibrium, point: CriticalPoint) -> CriticalPoint:
    """Return the point with displacements and mode on the mesh instead of states of the problem."""
    return replace(point, u=problem.states.expand(point.u), mode=_scaled(problem.states.expand(point.mode)))


def turning_point(problem: Equilibrium, before: Point, after: Point, rtol: float) -> tuple[Array, float] | None:
    """Return the state between two others at which the load factor reverses; None if it is not found."""
    chord = _Chord(problem, before, after, rtol)
    f = chord.root(chord.rate)
    try:
        return None if f is None else chord.at(f)
    except _PathLost:
        return None


def _point(kind: CriticalKind, chord: _Chord, f: float | None, without: Sequence[Array]) -> CriticalPoint:
    """Return the critical point at the fraction `f` of the step; its mode is orthogonal to the modes `without` of the others."""
    if f is None:
        return _unresolved(kind, chord.before, chord.after, 0.5, chord.direction)
    try:
        (u, t), mode = chord.at(f), chord.mode(f, without)
    except _PathLost:
        return _unresolved(kind, chord.before, chord.after, f, chord.direction)
    return CriticalPoint(kind, t, u, _scaled(chord.direction if mode is None else mode), mode is not None)


def _unresolved(kind: CriticalKind, before: Point, after: Point, part: float, mode: Array) -> CriticalPoint:
    t, u = before.t + part * (after.t - before.t), before.u + part * (after.u - before.u)
    return CriticalPoint(kind, t, u, _scaled(mode), False)


def _scaled(mode: Array) -> Array:
    largest = mode[np.abs(mode).argmax()]
    return mode / largest if largest else mode


class _Chord:
    """Path between two states, computed as equilibria in planes orthogonal to the straight line between them."""

    def __init__(self, problem: Equilibrium, before: Point, after: Point, rtol: float) -> None:
        self._problem, self.before, self.after, self._rtol = problem, before, after, rtol
        self.direction, self._fewest_negative = after.u - before.u, 0

    def at(self, f: float) -> tuple[Array, float]:
        """Return the state at the fraction `f` of the line, or very close to it where K is singular."""
        if f in (0.0, 1.0):
            point = self.after if f else self.before
            return point.u, point.t
        for nearby in (f, f + OFFSET, f - OFFSET):
            found = self._corrected(nearby)
            if found is not None:
                return found
        raise _PathLost

    def _corrected(self, f: float) -> tuple[Array, float] | None:
        """Return the equilibrium in the plane at the fraction `f` of the line; None if Newton's method fails.

        It may fail because K may be singular to the last digit.
        """
        dot, length = self._problem.states.dot, self._problem.states.norm(self.direction)
        if not length:
            return None
        u = self.before.u + f * self.direction
        t = self.before.t + f * (self.after.t - self.before.t)
        normal = self.direction / length
        plane = Hyperplane(normal, 0.0, dot(normal, u), length)
        u, t, end, record = correct(self._problem, u, t, plane, TIGHTER * self._rtol, lambda t, record: None)
        close = bool(record.residuals) and record.residuals[-1] <= self._rtol
        return (u, t) if end.converged or close else None

    def root(self, test: Callable[[float], float]) -> float | None:
        """Return the fraction of the line at which a test function changes its sign; None if it is not found."""
        try:
            ends = test(0.0), test(1.0)
            if not ends[0] * ends[1] < 0:
                return None
            noise = NOISE * max(map(abs, ends))
            values = {0.0: ends[0], 1.0: ends[1]}

            def tested(f: float) -> float:
                value = values[f] if f in values else test(f)
                return 0.0 if abs(value) < noise else value

            from scipy.optimize import brentq  # slow to import, and rarely needed

            return float(brentq(tested, 0.0, 1.0, xtol=TOLERANCE, rtol=4 * np.finfo(float).eps))
        except _PathLost:
            return None

    def sign_changes(self) -> int:
        """Return the number of eigenvalues that change their sign on the step, from the tangents at both ends; 0 if unknown."""
        first, last = self._negative(0.0), self._negative(1.0)
        if first is None or last is None:
            return 0
        self._fewest_negative = min(first, last)
        return abs(last - first)

    def _negative(self, f: float) -> int | None:
        self._problem.factorise(*self.at(f))
        return self._problem.negative_pivots()

    def rate(self, f: float) -> float:
        """Return `dt/ds`, which is zero at a limit point. It is also 0 where K is too singular for a solve."""
        found = path_tangent(self._problem, *self.at(f), singular=True)
        return 0.0 if isinstance(found, str) else found.along(self.direction, self._problem).rate

    def eigenvalue(self, passed: int, f: float) -> float:
        """Return the eigenvalue nearest to zero; zero if a pivot is too small.

        The sign is negative where more than `passed` eigenvalues have changed sign.
        """
        mode = nearest_mode(self._problem, *self.at(f))
        negative = self._problem.negative_pivots()
        if mode is None or negative is None:
            return 0.0
        return abs(mode.value) * (1 if negative <= self._fewest_negative + passed else -1)

    def mode(self, f: float, without: Sequence[Array]) -> Array | None:
        """Return the mode (ndofs,) in which the body gives way at the fraction `f`; None if none is found.

        Where K is too singular for a solve, the mode is computed at a state very close to `f`.
        """
        for nearby in (f, f + OFFSET, f - OFFSET):
            mode = nearest_mode(self._problem, *self.at(nearby), without)
            if mode is not None:
                return mode.vector
        return None
