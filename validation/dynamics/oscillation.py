"""Mean, amplitude and frequency of an oscillation, period by period."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from skfem_stvk.arguments import Array


class Oscillation(NamedTuple):
    """Half the sum and half the difference of the largest and the smallest value of a period, and its frequency [Hz].

    >>> t = np.arange(0, 4, 0.01)
    >>> [round(float(value), 4) for value in Oscillation.last(t, 3 + 2 * np.cos(2 * np.pi * 1.3 * t))]
    [3.0, 2.0, 1.3]
    """

    mean: float
    amplitude: float
    frequency: float

    @classmethod
    def by_period(cls, t: Array, x: Array) -> list[Oscillation]:
        """Return the oscillation of each whole period, from one upward crossing of the mid-range value to the next."""
        rises = _rises(t, x - (_extreme(x, 1) + _extreme(x, -1)) / 2)
        periods = []
        for begin, end in pairwise(rises):
            within = x[(t >= begin) & (t <= end)]
            largest, smallest = _extreme(within, 1), _extreme(within, -1)
            periods.append(cls((largest + smallest) / 2, (largest - smallest) / 2, float(1 / (end - begin))))
        return periods

    @classmethod
    def last(cls, t: Array, x: Array) -> Oscillation:
        """Return the oscillation of the last whole period."""
        return cls.by_period(t, x)[-1]

    @classmethod
    def averaged(cls, t: Array, x: Array) -> Oscillation:
        """Return the means over all whole periods."""
        return cls(*map(float, np.mean(cls.by_period(t, x), axis=0)))


def _rises(t: Array, x: Array) -> Array:
    """Return the times at which `x` rises through zero, by linear interpolation."""
    (k,) = np.nonzero((x[:-1] < 0) & (x[1:] >= 0))
    times: Array = t[k] - x[k] * (t[k + 1] - t[k]) / (x[k + 1] - x[k])
    return times


def _extreme(x: Array, sign: int) -> float:
    """Return the largest value, or the smallest for the sign -1, of the parabola through three neighbouring values."""
    k = int(np.argmax(sign * x))
    if k in (0, len(x) - 1):
        return float(x[k])
    rise, bend = (x[k + 1] - x[k - 1]) / 2, x[k + 1] - 2 * x[k] + x[k - 1]
    return float(x[k] - (rise**2 / (2 * bend) if bend else 0.0))
