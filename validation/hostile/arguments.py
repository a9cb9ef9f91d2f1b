"""Calls of the public functions with hostile values of each argument: an error names the argument, or the result is correct."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from decimal import Decimal
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from skfem_stvk import StvkError

from .calls import Call, calls
from .case import Case, Verdict, Wrong

NOTHING = object()


class Hostile(NamedTuple):
    """Value that replaces a good value of an argument.

    Attributes
    ----------
    make
        Function that returns the value for a good value of the argument, or NOTHING if it does not apply.
    same
        Whether it means the same as the good value, so that a result must be the same.
    """

    make: Callable[[Any], Any]
    same: bool = False


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


def _holds_itself() -> Any:
    rows: list[Any] = [1.0]
    rows.append(rows)
    return rows


#: Values that are wrong for every argument.
WRONG: dict[str, Callable[[], Any]] = {
    "nan": lambda: float("nan"),
    "bytes": lambda: b"x",
    "set": lambda: {1.0, 2.0},
    "object": object,
    "awkward object": Awkward,
    "generator": lambda: (i for i in range(3)),
    "1j": lambda: 1j,
    "10**400": lambda: 10**400,
    "list of 10**400": lambda: [10**400, 1],
    "list of None": lambda: [None, None],
    "list that holds itself": _holds_itself,
    "date": lambda: np.datetime64("2026-01-01"),
    "0-d complex": lambda: np.array(1j),
    "0-d nan": lambda: np.array(np.nan),
    "masked": lambda: np.ma.masked,
    "array of shape (2, 3, 4)": lambda: np.ones((2, 3, 4)),
}


def _of_array(change: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Return a function that applies `change` to a copy of an array of numbers, or of a list of numbers."""

    def changed(good: Any) -> Any:
        if not isinstance(good, np.ndarray | list | tuple):
            return NOTHING
        try:
            array = np.array(good)
        except ValueError:  # pairs of unlike things
            return NOTHING
        return change(array) if array.ndim and array.size and array.dtype.kind in "fiu" else NOTHING

    return changed


def _of(kind: Any, change: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Return a function that applies `change` to values of this type alone."""
    return lambda good: change(good) if type(good) in kind else NOTHING


def _masked(array: Any) -> Any:
    return np.ma.MaskedArray(array.astype(float), np.arange(array.size).reshape(array.shape) == 0)


def _with_none(array: Any) -> Any:
    objects = array.astype(object)
    objects.flat[0] = None
    return objects


def _read_only(array: Any) -> Any:
    array.flags.writeable = False
    return array


def _made(make: Callable[[], Any], good: Any) -> Any:
    return make()


NUMBER = (int, float)
EVERY: dict[str, Hostile] = {
    **{name: Hostile(partial(_made, make)) for name, make in WRONG.items()},
    # good arrays with a fault
    "one masked": Hostile(_of_array(_masked)),
    "complex": Hostile(_of_array(lambda array: array + 1j)),
    "as text": Hostile(_of_array(lambda array: array.astype(str))),
    "objects with None": Hostile(_of_array(_with_none)),
    # good values in unusual types
    "fraction": Hostile(_of(NUMBER, Fraction), same=True),
    "decimal": Hostile(_of(NUMBER, Decimal), same=True),
    "float32": Hostile(_of(NUMBER, np.float32), same=True),
    "longdouble": Hostile(_of(NUMBER, np.longdouble), same=True),
    "0-d array": Hostile(_of(NUMBER, np.array), same=True),
    "read-only array": Hostile(_of_array(_read_only), same=True),
    "reversed twice": Hostile(_of_array(lambda array: array[::-1].copy()[::-1]), same=True),
    "Fortran order": Hostile(_of_array(np.asfortranarray), same=True),
    "subclass of array": Hostile(_of_array(lambda array: array.view(Subclass)), same=True),
    "mask that masks nothing": Hostile(_of_array(np.ma.MaskedArray), same=True),
    "bytes swapped": Hostile(_of_array(lambda array: array.astype(array.dtype.newbyteorder(">"))), same=True),
    "array of longdouble": Hostile(_of_array(lambda array: array.astype(np.longdouble)), same=True),
    "array of objects": Hostile(_of_array(lambda array: array.astype(object)), same=True),
    "nested list": Hostile(_of_array(lambda array: array.tolist()), same=True),
    "subclass of text": Hostile(_of((str,), Text), same=True),
    "NumPy's text": Hostile(_of((str,), np.str_), same=True),
    "path": Hostile(_of((str,), Path), same=True),
    "NumPy's bool": Hostile(_of((bool,), np.bool_), same=True),
}
#: Expressions for the words by which messages name these arguments, if they do not use the name.
PLACE = r"where|no vertex|ubdomain|the vertices|the place|There is|the predicate| on |names|boundary|region"
CALLED = {
    **dict.fromkeys(("where", "region", "first", "second", "handle", "fixed", "prescribed", "simplices", "elements"), PLACE),
    **dict.fromkeys(("path", "save", "folder"), r"path|does not end in|is a folder|The folder|results"),
    **dict.fromkeys(("system", "body"), "System"),
    **dict.fromkeys(("mesh", "p", "t"), r"mesh|\b[pt] (=|has)|vert|element"),
    "boundaries": "boundar",
    "fields": "field",
    "field": "field",
    "probes": "probe",
    "reactions": "reaction",
    "poisson": r"Poisson|poisson_\d\d",
    "kind": "mass",
    "measure": "field",
    "displacements": "displacement|axis",
    "displacement": "displacement|place|vert",
    "file": "RigidMesh",
    "damping": "damping",
    "elements": "region|element|subdomain",
    "directions": "direction",
    "name": "peer|field|column|contact|vectors|place|boundary|There is",
    "law": "law|material",
    "t0": r"after t =",
    "at": "where",
}


def cases() -> Iterator[Case]:
    """Yield all calls with all hostile values."""
    return cases_of(calls())


def cases_of(chosen: Iterable[Call]) -> Iterator[Case]:
    """Yield a case for each hostile value of each argument of each call."""
    for call in chosen:
        for argument, good in call.make()[1].items():
            for name, value in EVERY.items():
                if value.make(good) is not NOTHING:
                    yield _case(call, argument, name, value)


def _case(call: Call, argument: str, name: str, value: Hostile) -> Case:
    """Return the case of a call with a hostile value for one argument."""

    def result(change: Callable[[Any], Any]) -> Any:
        function, good = call.make()
        with np.errstate(all="ignore"):
            return plain(function(**good | {argument: change(good[argument])}))

    def judge(found: Any) -> None:
        if not value.same:
            raise Wrong(Verdict.SILENT, f"accepted: {found!r:.200}")
        expected = result(lambda good: good)
        if not np.array_equal(found, expected, equal_nan=True) and not np.allclose(found, expected, 1e-5, 1e-5):
            raise Wrong(Verdict.SILENT, f"{found!r:.200} instead of {expected!r:.200}")

    names = re.compile(rf"\b{argument}\b|{CALLED.get(argument, argument)}")
    return Case(
        f"{call.name}({argument}={name})", lambda folder: result(value.make), judge, partial(_refused, names), quick=name == "1j"
    )


def _refused(names: re.Pattern[str], error: BaseException) -> bool:
    """Return whether an error of this package names the argument, or Python itself refuses the call."""
    if isinstance(error, TypeError):
        trace = error.__traceback__
        while trace is not None and trace.tb_next is not None:
            trace = trace.tb_next
        return trace is not None and trace.tb_frame.f_code.co_filename == __file__
    return isinstance(error, StvkError) and names.search(str(error)) is not None


def plain(result: Any) -> Any:
    """Return all numbers of a result in one array: of arrays, matrices, and tuples and attributes of these."""
    if result is None or isinstance(result, str | Path):
        return np.zeros(0)
    if isinstance(result, dict):
        result = list(result.values())
    if isinstance(result, list | tuple):
        return np.concatenate([np.zeros(0), *(plain(one) for one in result)])
    if hasattr(result, "toarray"):
        result = result.toarray()
    if isinstance(result, np.ndarray | float | int | np.generic):
        return np.ravel(np.asarray(result, dtype=complex))
    return plain([value for value in vars(result).values() if isinstance(value, np.ndarray | float | int | tuple)])
