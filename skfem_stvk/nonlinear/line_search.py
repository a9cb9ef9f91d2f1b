"""How far to go along a direction of descent."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..arguments import Array
from ..terms.load import Time
from .problem import Problem, Residual, slope

#: A residual along the line is as good as zero below this part of what it was.
GOOD_ENOUGH = 0.1


def length(problem: Problem, u: Array, v: Array, t: Time, at_zero: Residual, longest: float) -> float | None:
    """The factor `s` of the direction `v` from `u`, where the residual is `at_zero`: `longest` at most; None if there is none."""
    at_start = slope(problem, at_zero, v)
    if not problem.quartic:
        return root_of_slope(lambda s: slope(problem, problem.residual(u + s * v, t), v), at_start, longest)
    c = problem.energy_along(u, v, t)
    if abs(c[1] - at_start) > 0.1 * abs(at_start):  # rounding is as large as what there is to gain
        return min(1.0, longest)
    s = min(quartic_minimum(c), longest)
    return s if np.isfinite(s) else None


def quartic_minimum(c: Array) -> float:
    """The first minimum at `s > 0` of `c0 + c1 s + ... + c4 s^4`, which falls at 0; infinite if it never ceases to fall.

    Those behind it belong to other states, mirrored ones among them.

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
        unit = float(((np.abs(c[1] / slope)) ** (1 / (k - 1))).min())  # in which no term is larger than the first
    scaled = np.append(slope * unit ** (k - 1.0), c[1]) / abs(c[1])
    roots = np.roots(scaled)
    real = np.sort(roots.real[(np.abs(roots.imag) <= 1e-7 * np.abs(roots)) & (roots.real > 0)])
    return unit * float(real[0]) if len(real) else np.inf


def root_of_slope(slope: Callable[[float], float], at_zero: float, longest: float = np.inf, most: int = 12) -> float | None:
    """A length `s` with `|slope(s)| <= 0.1 |slope(0)|`, by doubling and safeguarded secants; None if it is not found.

    `slope(s)` is the residual times the direction, negative at zero; it is not asked for beyond `longest`, which is the answer if
    the slope is negative there still.

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
