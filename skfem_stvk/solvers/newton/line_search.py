"""Line search along a direction of descent."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...arguments import Array
from ...terms.loads.load import Time
from .problem import Problem, Residual, slope

#: The slope along the line counts as zero below this fraction of its initial value.
GOOD_ENOUGH = 0.1


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
