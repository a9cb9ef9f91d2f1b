"""Numbers that count the operations done with them.

A run with such numbers gives the number of operations of an algorithm, and its result for a check. Additions (including
subtractions), multiplications and divisions count. A change of sign does not count, because it merges into the addition that
follows. Comparisons, copies and indices do not count either.

>>> tally = Tally()
>>> a, b, c = counted([2.0, 3.0, 4.0], tally)
>>> (a * b - c) / a, tally
(1.0, 1 additions, 1 multiplications, 1 divisions)
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


class Tally:
    """Numbers of additions, multiplications and divisions so far."""

    def __init__(self) -> None:
        self.additions = self.multiplications = self.divisions = 0

    @property
    def operations(self) -> int:
        """Total number of operations."""
        return self.additions + self.multiplications + self.divisions

    def __repr__(self) -> str:
        return f"{self.additions} additions, {self.multiplications} multiplications, {self.divisions} divisions"


class Counted:
    """Real number that adds each of its operations to its `tally`."""

    __slots__ = ("tally", "value")
    __array_ufunc__ = None  # so that NumPy's scalars leave mixed operations to this class

    def __init__(self, value: float, tally: Tally) -> None:
        self.value, self.tally = value, tally

    def __add__(self, other: Any) -> Counted:
        self.tally.additions += 1
        return Counted(self.value + _value(other), self.tally)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Counted:
        self.tally.additions += 1
        return Counted(self.value - _value(other), self.tally)

    def __rsub__(self, other: Any) -> Counted:
        self.tally.additions += 1
        return Counted(_value(other) - self.value, self.tally)

    def __mul__(self, other: Any) -> Counted:
        self.tally.multiplications += 1
        return Counted(self.value * _value(other), self.tally)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Counted:
        self.tally.divisions += 1
        return Counted(self.value / _value(other), self.tally)

    def __rtruediv__(self, other: Any) -> Counted:
        self.tally.divisions += 1
        return Counted(_value(other) / self.value, self.tally)

    def __neg__(self) -> Counted:
        return Counted(-self.value, self.tally)

    def __repr__(self) -> str:
        return repr(self.value)


def counted(values: ArrayLike, tally: Tally) -> NDArray[Any]:
    """Return an array of the same shape with counted real numbers. Integer arrays (indices) are returned unchanged."""
    array = np.asarray(values)
    if array.dtype.kind != "f":
        return array
    numbers = np.empty(array.shape, dtype=object)
    numbers.ravel()[:] = [Counted(value, tally) for value in array.ravel().tolist()]
    return numbers


def plain(numbers: NDArray[Any]) -> NDArray[np.float64]:
    """Return the values of an array of counted numbers."""
    return np.array([_value(number) for number in numbers.ravel()]).reshape(numbers.shape)


def _value(number: Any) -> Any:
    return number.value if isinstance(number, Counted) else number
