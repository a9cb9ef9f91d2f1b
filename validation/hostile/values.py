"""Hostile values of arguments: wrong values, good values with a fault, and good values in unusual types."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np


class Nothing:
    """Type of the marker for a missing value."""


NOTHING = Nothing()


@dataclass(frozen=True)
class Hostile:
    """Value that replaces a good value of an argument.

    Attributes
    ----------
    name
        Name of the value in tables and messages.
    make
        Function that returns the value for a good value of the argument, or NOTHING if it does not apply.
    plain
        Function that returns a plain value with the same meaning, or NOTHING if there is none. The plain value must give the same
        result.
    """

    name: str
    make: Callable[[Any], Any]
    plain: Callable[[Any], Any] = lambda good: NOTHING


class Subclass(np.ndarray):
    """Subclass of NumPy's array."""


class Text(str):
    """Subclass of `str`."""


class Awkward:
    """Object that raises an error when it is shown, compared or converted."""

    def __repr__(self) -> str:
        raise RuntimeError("repr")

    def __array__(self, dtype: Any = None, copy: Any = None) -> Any:
        raise RuntimeError("array")

    def __eq__(self, other: object) -> bool:
        raise RuntimeError("eq")

    __hash__ = None  # type: ignore[assignment]


def _fixed(name: str, make: Callable[[], Any], plain: Callable[[], Any] = lambda: NOTHING) -> Hostile:
    return Hostile(name, lambda good: make(), lambda good: plain())


def _holds_itself() -> Any:
    rows: list[Any] = [1.0]
    rows.append(rows)
    return rows


def _ragged_objects() -> Any:
    rows = np.empty(2, dtype=object)
    rows[:] = [[1.0], [1.0, 2.0]]
    return rows


def _is_array(good: Any) -> bool:
    """Return whether `good` is an array or a list of numbers."""
    if not isinstance(good, np.ndarray | list | tuple):
        return False
    try:
        return np.ndim(good) > 0 and np.asarray(good).dtype.kind in "fiu"
    except ValueError:  # pairs of unlike things
        return False


def _of_array(change: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Return a function that applies `change` to a copy of an array of numbers."""
    return lambda good: change(np.array(good)) if _is_array(good) else NOTHING


def _of_floats(change: Callable[[Any], Any]) -> Callable[[Any], Any]:
    return lambda good: change(np.array(good, dtype=np.float64)) if _is_array(good) and len(good) else NOTHING


def _of_number(change: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Return a function that applies `change` to a plain number."""
    return lambda good: change(good) if type(good) in (int, float) else NOTHING


def _with(entry: Any) -> Callable[[Any], Any]:
    """Return a function that sets the first entry of an array to `entry`."""

    def change(array: Any) -> Any:
        array.flat[0] = entry
        return array

    return _of_floats(change)


def _masked(array: Any) -> Any:
    mask = np.zeros(array.shape, dtype=bool)
    mask.flat[0] = True
    return np.ma.MaskedArray(array, mask)


def _with_gaps(array: Any) -> Any:
    """Return the same numbers in an array that is not contiguous."""
    doubled = np.empty((*array.shape, 2), dtype=array.dtype)
    doubled[..., 0] = array
    return doubled[..., 0]


def _read_only(array: Any) -> Any:
    array.flags.writeable = False
    return array


def _objects_with_none(array: Any) -> Any:
    objects = array.astype(object)
    objects.flat[0] = None
    return objects


def _self(good: Any) -> Any:
    return good


#: Values that are wrong for every argument, unless a table lists them as legal for it.
WRONG = (
    _fixed("None", lambda: None),
    _fixed("nan", lambda: float("nan")),
    _fixed("inf", lambda: float("inf")),
    _fixed("-inf", lambda: -np.inf),
    _fixed("-1", lambda: -1),
    _fixed("0", lambda: 0),
    _fixed("0.5", lambda: 0.5),
    _fixed("True", lambda: True),
    _fixed("text", lambda: "a"),
    _fixed("number as text", lambda: "1e5"),
    _fixed("empty text", lambda: ""),
    _fixed("long text", lambda: "x" * 100_000),
    _fixed("NUL", lambda: "a\0b"),
    _fixed("control characters", lambda: "a\x1b[31m\nb"),
    _fixed("bytes", lambda: b"x"),
    _fixed("empty list", list),
    _fixed("empty dict", dict),
    _fixed("dict", lambda: {"a": 1}),
    _fixed("set", lambda: {1.0, 2.0}),
    _fixed("object", object),
    _fixed("awkward object", Awkward),
    _fixed("class", lambda: dict),
    _fixed("function", lambda: lambda x, t: None),
    _fixed("generator", lambda: (i for i in range(3))),
    _fixed("1j", lambda: 1j),
    _fixed("10**400", lambda: 10**400),
    _fixed("-10**400", lambda: -(10**400)),
    _fixed("list of 10**400", lambda: [10**400, 1]),
    _fixed("list of None", lambda: [None, None]),
    _fixed("list of text", lambda: ["1", "2"]),
    _fixed("ragged list", lambda: [[1.0], [1.0, 2.0]]),
    _fixed("ragged objects", _ragged_objects),
    _fixed("list that holds itself", _holds_itself),
    _fixed("one bool in an array", lambda: np.array([True])),
    _fixed("date", lambda: np.datetime64("2026-01-01")),
    _fixed("0-d complex", lambda: np.array(1j)),
    _fixed("0-d nan", lambda: np.array(np.nan)),
    _fixed("masked", lambda: np.ma.masked),
    _fixed("empty array", lambda: np.empty(0)),
    _fixed("array of shape (2, 3, 4)", lambda: np.ones((2, 3, 4))),
    _fixed("lone surrogate", lambda: "\udcff"),
)

#: Good arrays with a fault.
SPOILT = (
    Hostile("NaN in it", _with(np.nan)),
    Hostile("inf in it", _with(np.inf)),
    Hostile("one masked", _of_floats(_masked)),
    Hostile("complex", _of_floats(lambda array: array + 1j)),
    Hostile("complex without imaginary part", _of_floats(lambda array: array + 0j)),
    Hostile("as text", _of_floats(lambda array: array.astype(str))),
    Hostile("as bool", _of_floats(lambda array: array.astype(bool))),
    Hostile("objects with None", _of_floats(_objects_with_none)),
    Hostile("one longer", _of_array(lambda array: np.concatenate([array, array[-1:]]))),
    Hostile("one axis more", _of_array(lambda array: array[..., None])),
    Hostile("transposed", lambda good: np.array(good).T.copy() if _is_array(good) and len({*np.shape(good)}) > 1 else NOTHING),
    Hostile("0-d array of it", lambda good: _zero_d(good) if _is_array(good) else NOTHING),
    Hostile("dates", _of_array(lambda array: array.astype("datetime64[s]") if array.dtype.kind in "iu" else NOTHING)),
)


def _zero_d(good: Any) -> Any:
    box = np.empty((), dtype=object)
    box[()] = good
    return box


#: Good values in unusual types: the function must refuse them with a readable message, or return the same result.
DISGUISED = (
    Hostile("fraction", _of_number(Fraction), _self),
    Hostile("decimal", _of_number(Decimal), _self),
    Hostile("float16", _of_number(lambda good: np.float16(good) if abs(good) < 6e4 else NOTHING), _self),
    Hostile("float32", _of_number(np.float32), _self),
    Hostile("longdouble", _of_number(np.longdouble), _self),
    Hostile("int8", _of_number(lambda good: np.int8(good) if good == int(good) and abs(good) < 128 else NOTHING), _self),
    Hostile("uint8", _of_number(lambda good: np.uint8(good) if good == int(good) and 0 <= good < 256 else NOTHING), _self),
    Hostile("0-d array", _of_number(np.array), _self),
    Hostile("read-only array", _of_array(_read_only), _self),
    Hostile("array with gaps", _of_array(_with_gaps), _self),
    Hostile("reversed twice", _of_array(lambda array: array[::-1].copy()[::-1]), _self),
    Hostile("Fortran order", _of_array(np.asfortranarray), _self),
    Hostile("subclass of array", _of_array(lambda array: array.view(Subclass)), _self),
    Hostile("mask that masks nothing", _of_array(np.ma.MaskedArray), _self),
    Hostile("bytes swapped", _of_array(lambda array: array.astype(array.dtype.newbyteorder(">"))), _self),
    Hostile("array of float32", _of_floats(lambda array: array.astype(np.float32)), _self),
    Hostile("array of longdouble", _of_floats(lambda array: array.astype(np.longdouble)), _self),
    Hostile("array of objects", _of_array(lambda array: array.astype(object)), _self),
    Hostile("nested list", _of_array(lambda array: array.tolist()), _self),
    Hostile("subclass of text", lambda good: Text(good) if isinstance(good, str) else NOTHING, _self),
    Hostile("NumPy's text", lambda good: np.str_(good) if isinstance(good, str) else NOTHING, _self),
    Hostile("path", lambda good: Path(good) if isinstance(good, str) else NOTHING, _self),
    Hostile("NumPy's bool", lambda good: np.bool_(good) if isinstance(good, bool) else NOTHING, _self),
)

EVERY = (*WRONG, *SPOILT, *DISGUISED)
