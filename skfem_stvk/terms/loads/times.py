"""Functions of time as data: a value times a factor that ramps, oscillates or follows a table."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from math import pi, sin
from typing import Annotated, Any

import numpy as np

from ...arguments import Quantity, array, number, real_array, shown
from ...errors import LoadError, name_ids

NUMBER = "a finite number"


@dataclass(frozen=True)
class InTime(ABC):
    """A value times a factor of time: a function of `t`, for all loads and prescribed displacements that take one.

    In statics `t` is the load factor, in dynamics the time [s]. The factor replaces the ramp that constants have in statics.
    """

    value: Any

    def __post_init__(self) -> None:
        object.__setattr__(self, "value", _checked_value(type(self).__name__, self.value))

    @abstractmethod
    def factor(self, t: float) -> float:
        """Return the factor of the value at `t`."""

    def __call__(self, t: float) -> float | tuple[float, ...]:
        factor = self.factor(number("t", t, "a finite load factor or time", error=LoadError))
        return tuple(factor * one for one in self.value) if isinstance(self.value, tuple) else factor * self.value

    def _store_number(self, name: str, expected: str = NUMBER, low: float = -np.inf) -> None:
        """Store an attribute as a number, and refuse anything else."""
        value = number(f"{type(self).__name__}: {name}", getattr(self, name), expected, low, error=LoadError)
        object.__setattr__(self, name, value)


@dataclass(frozen=True)
class Ramp(InTime):
    """A value that grows from 0 to its full size at a constant rate, and keeps it.

    ::

        f(t) = value min(1, max(0, (t - start)/(until - start)))

    Parameters
    ----------
    value
        Value, a number or one to three components.
    until
        Time at which it reaches its full size [s].
    start
        Time until which it is 0 [s], before `until`.

    Raises
    ------
    LoadError
        for values that are not finite numbers, and for `until` that is not after `start`.

    Examples
    --------
    >>> push = Ramp((0, 0, -2e6), until=0.1)
    >>> push(0.05), push(1.0)
    ((0.0, 0.0, -1000000.0), (0.0, 0.0, -2000000.0))
    >>> push
    Ramp(value=(0.0, 0.0, -2000000.0), until=0.1, start=0.0)
    """

    until: Annotated[float, Quantity("time", "When it is 1.")]
    start: Annotated[float, Quantity("time", "Until when it is 0.")] = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._store_number("start")
        self._store_number("until", f"a finite number after start = {self.start:g}", self.start)

    def factor(self, t: float) -> float:
        if t >= self.until:
            return 1.0
        return 0.0 if t <= self.start else (t - self.start) / (self.until - self.start)


@dataclass(frozen=True)
class Sine(InTime):
    """A value that oscillates: `f(t) = value sin(2 pi frequency t + phase)`.

    Parameters
    ----------
    value
        Amplitude, a number, or one to three components.
    frequency
        Number of cycles per time [Hz], positive.
    phase
        Angle at t = 0 [rad]; pi/2 makes it a cosine.

    Raises
    ------
    LoadError
        for values that are not finite numbers, and a frequency that is not positive.

    Examples
    --------
    >>> shake = Sine(0.01, frequency=2.0)
    >>> shake(0.125), round(shake(0.25), 12)
    (0.01, 0.0)
    """

    frequency: Annotated[float, Quantity("frequency", "Cycles per time.", gt=0)]
    phase: Annotated[float, Quantity(None, "Angle at time 0 in radians: pi/2 makes it a cosine.")] = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._store_number("frequency", "a positive number, cycles per time", 0.0)
        self._store_number("phase", "a finite number, an angle in radians")

    def factor(self, t: float) -> float:
        return sin(2 * pi * self.frequency * t + self.phase)


@dataclass(frozen=True)
class Table(InTime):
    """A value times factors at given times, linear between them, and constant before the first and after the last.

    Parameters
    ----------
    value
        Value, a number or one to three components.
    times
        (n,) ascending times, n >= 1 [s].
    factors
        (n,) factors of the value at these times.

    Raises
    ------
    LoadError
        for values that are not finite numbers, times that do not ascend, and a number of factors other than that of times.

    Examples
    --------
    >>> knock = Table(5.0, times=[0.0, 1e-3, 2e-3], factors=[0, 1, 0])
    >>> knock(5e-4), knock(2.0)
    (2.5, 0.0)
    >>> Table(5.0, times=[0, 2, 1], factors=[0, 1, 0])
    Traceback (most recent call last):
    skfem_stvk.errors.LoadError: Table: times do not ascend after 1 entry (1). Sort them, with their factors; for a jump give two
    times that are near each other.
    """

    times: Annotated[tuple[float, ...], Quantity("time", "Times, ascending.")]
    factors: Annotated[tuple[float, ...], Quantity(None, "The factor at each of these times.")]

    def __post_init__(self) -> None:
        super().__post_init__()
        times = array("Table: times", self.times, (None,), "a list of numbers that ascend", LoadError)
        if not len(times):
            raise LoadError("Table: times are empty; expected at least one, and as many factors.")
        if len(bad := np.flatnonzero(np.diff(times) <= 0)):
            raise LoadError(
                f"Table: times do not ascend after {name_ids(bad, 'entry')}. Sort them, with their factors; for a jump give two "
                "times that are near each other."
            )
        expected = f"({len(times)},) numbers, one for each of the times"
        factors = array("Table: factors", self.factors, (len(times),), expected, LoadError)
        object.__setattr__(self, "times", tuple(times.tolist()))
        object.__setattr__(self, "factors", tuple(factors.tolist()))

    def factor(self, t: float) -> float:
        return float(np.interp(t, self.times, self.factors))


def _checked_value(name: str, value: Any) -> float | tuple[float, ...]:
    """Return a finite number, or a tuple of at most three."""
    expected = "a number, or one to three components (x, y, z); for values that depend on the place write a function of (x, t)"
    values = real_array(value)
    if values is None or values.shape not in ((), (1,), (2,), (3,)):
        raise LoadError(f"{name}: value = {shown(value)}; expected {expected}.")
    if not np.isfinite(values).all():
        raise LoadError(f"{name}: value = {shown(value)} is not finite; expected {expected}.")
    return tuple(values.tolist()) if values.ndim else float(values)
