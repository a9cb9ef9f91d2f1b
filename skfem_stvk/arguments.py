"""Arguments of users, turned into numbers, arrays, names and paths; or refused with the argument's name.

Every function takes the argument's name first, as it stands in messages, then what was given, and the class of the `error` that it
raises for anything but what it is named for.
"""

from __future__ import annotations

import os
import reprlib
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from math import inf, isfinite
from numbers import Integral, Real
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import StateError, StvkError, name_ids, name_known

#: Numbers in an array, mostly of double precision: docstrings say the shape.
Array = NDArray[Any]

#: The longest path that systems take [characters], and the longest name of a file or folder in it [bytes].
LONGEST_PATH, LONGEST_NAME = 4096, 255
#: The largest whole number of 64 bits.
MOST = int(np.iinfo(np.int64).max)
_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = 80

#: Variables of the environment by which a process that starts learns how many threads it has.
THREAD_LIMITS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")


@dataclass(frozen=True)
class Quantity:
    """Declaration of a parameter in the annotation of a field, from which the keys of scenes are derived.

    Attributes
    ----------
    dimension : dimension of its values, as in `skfem_stvk.scene.units.DIMENSIONS`; None for pure numbers, texts and places.
    sentence : one sentence about it.
    gt, ge, lt, le : limits of each of its numbers.
    values : the texts that it may be, if these are few.
    components : whether it is a vector: one to three numbers.
    otherwise : the value that a default of None stands for; None if it stands for no value.
    """

    dimension: str | None
    sentence: str
    gt: float | None = None
    ge: float | None = None
    lt: float | None = None
    le: float | None = None
    values: tuple[str, ...] = ()
    components: bool = False
    otherwise: Any = None


def shown(value: Any) -> str:
    """A value as a message shows it: on one line, never long, whatever its own `repr` does.

    >>> shown("a" * 500) == repr("a" * 500), len(shown(10 ** 10000)) < 90
    (False, True)
    """
    if isinstance(value, np.ndarray) and value.ndim:
        return f"an array of shape {value.shape} and dtype {value.dtype}"
    try:
        return " ".join(_SHORT.repr(value).split())
    except Exception:
        return f"an object of type {type(value).__name__}"


def number(
    name: str,
    given: Any,
    expected: str = "a number",
    low: float = -inf,
    high: float = inf,
    *,
    error: type[StvkError] = StvkError,
    closed: bool = False,
) -> float:
    """A finite number strictly between `low` and `high`; `closed`: or one of them. Bools and complex numbers are none.

    >>> number("rtol", np.float32(0.5), low=0, high=1)
    0.5
    >>> number("rtol", "1e-8", "a number between 0 and 1, such as 1e-8")
    Traceback (most recent call last):
    skfem_stvk.errors.StvkError: rtol = '1e-8'; expected a number between 0 and 1, such as 1e-8.
    """
    if type(given) is float and low < given < high and isfinite(given):
        return given  # in the loops of solvers, most often
    value = _real(given)
    inside = value is not None and (low < value < high or (closed and value in (low, high)))
    if value is None or not inside or not isfinite(value):
        raise error(f"{name} = {shown(given)}; expected {expected}.")
    return value


def whole(
    name: str, given: Any, expected: str = "a whole number", least: int = 0, most: int = MOST, error: type[StvkError] = StvkError
) -> int:
    """A whole number from `least` to `most`; neither a bool nor 2.5 is one.

    >>> whole("steps", np.int32(4), least=1)
    4
    """
    if isinstance(given, np.ndarray) and given.ndim == 0:
        given = given[()]
    if isinstance(given, bool | np.bool_) or not isinstance(given, Integral) or not least <= int(given) <= most:
        raise error(f"{name} = {shown(given)}; expected {expected}.")
    return int(given)


def flag(name: str, given: Any, error: type[StvkError] = StvkError) -> bool:
    """True or False, and nothing else that Python would take for one of them.

    >>> flag("quiet", "yes")
    Traceback (most recent call last):
    skfem_stvk.errors.StvkError: quiet = 'yes'; expected True or False.
    """
    if not isinstance(given, bool | np.bool_):
        raise error(f"{name} = {shown(given)}; expected True or False.")
    return bool(given)


def choice(name: str, given: Any, known: Iterable[str], error: type[StvkError] = StvkError) -> str:
    """One of the known names, which an error names, with the one that was probably meant.

    >>> choice("kind", "barier", ["barrier", "quadratic"])
    Traceback (most recent call last):
    skfem_stvk.errors.StvkError: kind = 'barier'; known: 'barrier', 'quadratic'. Did you mean 'barrier'?
    """
    names = list(known)
    if not isinstance(given, str) or given not in names:
        raise error(f"{name} = {shown(given)}; {name_known(given if isinstance(given, str) else '', names)}")
    return str(given)


def text(name: str, given: Any) -> str:
    """Return text that can be shown: at most 1000 characters, none of them for control.

    >>> text("label", "stress" + chr(0))
    Traceback (most recent call last):
    skfem_stvk.errors.StvkError: label = 'stress\\x00'; expected a text of at most 1000 characters that can be printed.
    """
    if not isinstance(given, str) or len(given) > 1000 or not given.replace("\n", "").isprintable():
        raise StvkError(f"{name} = {shown(given)}; expected a text of at most 1000 characters that can be printed.")
    return str(given)


def path(name: str, given: Any, expected: str = "a path", error: type[StvkError] = StvkError) -> Path:
    """A path that the system's functions take: not empty, without NUL, and with no name that is too long.

    >>> path("save", 3, "the path of a .pvd file")
    Traceback (most recent call last):
    skfem_stvk.errors.StvkError: save = 3; expected the path of a .pvd file.
    """
    text = os.fspath(given) if isinstance(given, str | os.PathLike) else None
    if not isinstance(text, str) or not text.strip() or "\0" in text or len(text) > LONGEST_PATH:
        raise error(f"{name} = {shown(given)}; expected {expected}.")
    if max((_bytes(part) for part in Path(text).parts), default=0) > LONGEST_NAME:
        raise error(
            f"{name} = {shown(given)}; expected {expected}, in which names can be encoded, in at most {LONGEST_NAME} bytes."
        )
    return Path(text)


def _bytes(part: str) -> float:
    """Number of bytes of a name of a file; infinite if no file can have it."""
    try:
        return len(os.fsencode(part))
    except UnicodeEncodeError:  # half of a pair of surrogates
        return inf


def array(
    name: str, given: Any, shape: tuple[int | None, ...], expected: str, error: type[StvkError] = StvkError, what: str = "entry"
) -> NDArray[np.float64]:
    """Finite numbers in double precision, as an array of this shape; None stands for any length. It may be the given array itself.

    Text, bools, complex numbers, objects, ragged lists and masked entries are refused, and numbers that are not finite, which are
    named by their place along the last axis as `what`.

    >>> array("force", [[1, 2], [3]], (2, None), "(2, n) numbers")
    Traceback (most recent call last):
    skfem_stvk.errors.StvkError: force = [[1, 2], [3]]; expected (2, n) numbers.
    >>> array("v", [0.0, np.nan, 1.0], (3,), "3 numbers")
    Traceback (most recent call last):
    skfem_stvk.errors.StvkError: v is not finite in 1 entry (1); expected 3 numbers.
    """
    values = real_array(given)
    if values is None:
        raise error(f"{name} = {shown(given)}; expected {expected}.")
    if values.ndim != len(shape) or any(n not in (None, m) for n, m in zip(shape, values.shape, strict=True)):
        raise error(f"{name} has shape {values.shape}; expected {expected}.")
    bad = ~np.isfinite(values)
    if bad.any():
        where = f" in {name_ids(np.unique(np.nonzero(bad)[-1]), what)}" if values.ndim else ""
        raise error(f"{name} is not finite{where}; expected {expected}.")
    return values


def vector(name: str, given: Any, n: int, each: str = "degree of freedom", *, kinds: str = "fiu") -> Array:
    """A vector (n,) of numbers, one for each of what `each` names, in single or double precision as given.

    The numbers need not be finite, and are not copied if they are floating-point numbers and contiguous. `kinds` are NumPy's
    letters of the types that are taken, "fiuc" with complex numbers. All else raises StateError, masked entries too.

    >>> vector("u", [1, 2], 2)
    array([1., 2.])
    >>> vector("u", np.zeros((2, 2)), 4)
    Traceback (most recent call last):
    skfem_stvk.errors.StateError: u has shape (2, 2); expected (4,), one number for each degree of freedom. Flatten it: ...
    """
    values = given if type(given) is np.ndarray else plain_array(given)
    if values is None or values.dtype.kind not in kinds:
        what = f"= {shown(given)}" if values is None or not values.ndim else f"has dtype {values.dtype}"
        masked = ", without masked entries" if isinstance(given, np.ma.MaskedArray) else ""
        of_result = " Of a result, take its .u." if values is not None and not values.ndim else ""
        raise StateError(f"{name} {what}; expected ({n},) real numbers, one for each {each}{masked}.{of_result}")
    if values.shape != (n,):
        flat = f"Flatten it: {name}.ravel(), if its rows are vertices."
        hint = flat if values.ndim > 1 and values.size == n else "Is it of another mesh or of second order?"
        raise StateError(f"{name} has shape {values.shape}; expected ({n},), one number for each {each}. {hint}")
    precision = values.dtype.newbyteorder("=") if values.dtype.char in "fdFD" else np.float64  # single and double, real and complex
    return np.ascontiguousarray(values, precision)


def real_array(given: Any) -> NDArray[np.float64] | None:
    """An array in double precision, possibly the given one itself; None for what holds no real numbers, or masked ones.

    >>> real_array([1, 2]), real_array([1, "2"]), real_array(np.ma.masked_equal([1, 2], 2))
    (array([1., 2.]), None, None)
    """
    values = plain_array(given)
    return values.astype(np.float64, copy=False) if values is not None and values.dtype.kind in "fiu" else None


def whole_array(given: Any) -> NDArray[Any] | None:
    """An array of whole numbers or of bools, such as ids or a mask, possibly the given one itself; None for what is neither.

    Empty lists are ids, of which there are none.

    >>> whole_array([3, 1]), whole_array([]), whole_array([0.5]), whole_array({3, 1})
    (array([3, 1]), array([], dtype=int64), None, None)
    """
    values = plain_array(given)
    if values is None or not (values.dtype.kind in "iub" or (values.shape == (0,) and values.dtype.kind == "f")):
        return None
    return values if values.size else values.astype(bool if values.dtype.kind == "b" else np.int64)


def plain_array(given: Any) -> NDArray[Any] | None:
    """An array as NumPy makes it; None for masked entries, ragged lists, and objects whose own conversion fails.

    >>> plain_array([[1], [2, 3]]), plain_array("a")
    (None, array('a', dtype='<U1'))
    """
    try:
        if isinstance(given, list | tuple) and any(isinstance(one, np.ma.MaskedArray) for one in given):
            given = np.ma.stack(given)
        return None if isinstance(given, np.ma.MaskedArray) and np.ma.is_masked(given) else np.asarray(given)
    except Exception:
        return None


def own(specification: Any) -> None:
    """Let a frozen dataclass keep copies of what it was given, so that it stays what it is whatever becomes of the originals."""
    for field in fields(specification):
        object.__setattr__(specification, field.name, frozen(getattr(specification, field.name)))


def frozen(given: Any, depth: int = 8) -> Any:
    """A copy that does not change with the original: arrays that cannot be written to, lists and dicts with all that is in them.

    A series of pandas becomes an array, as does whatever else NumPy takes for one. Other objects, such as functions, are handed
    back, and so is what lies deeper than `depth`: nothing of use does, and a list may hold itself.

    >>> values = np.array([1.0, 2.0])
    >>> kept = frozen([values, "x"])
    >>> values[0] = 9
    >>> kept
    [array([1., 2.]), 'x']
    """
    if isinstance(given, np.ndarray):
        copy = np.array(given, subok=True)
        copy.flags.writeable = False
        return copy
    if "skfem" in sys.modules and isinstance(given, sys.modules["skfem"].DofsView):  # whoever has one has imported it
        return replace(given, nodal_ix=frozen(given.nodal_ix), nodal_rows=frozen(given.nodal_rows))
    if depth and isinstance(given, Mapping):
        return {key: frozen(value, depth - 1) for key, value in given.items()}
    if depth and type(given) in (list, tuple):
        return type(given)(frozen(one, depth - 1) for one in given)
    if hasattr(given, "__array__") and not callable(given) and not isinstance(given, np.generic):
        values = plain_array(given)
        return given if values is None else frozen(values)
    return set(given) if isinstance(given, set) else given


def _real(given: Any) -> float | None:
    """The argument as a float; None if it is no number."""
    if isinstance(given, np.ndarray) and given.ndim == 0:
        given = given[()]
    if isinstance(given, bool | np.bool_) or not isinstance(given, Real):
        return None
    try:
        return float(given)
    except (OverflowError, ValueError):  # 10**400
        return None
