"""Conversion of user-supplied arguments to numbers, arrays, names and paths; invalid ones are refused with the argument's name.

The first argument of every function is the argument's name as shown in messages, and the second is the user-supplied value. `error`
is the class of the error that is raised for an invalid value.
"""

from __future__ import annotations

import os
import reprlib
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from inspect import signature
from math import inf, isfinite
from numbers import Integral, Real
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from .errors import MaterialError, MeshError, StateError, StvkError, name_ids, name_known

#: Array of numbers, mostly in double precision: docstrings give the shape.
Array = NDArray[Any]

#: Longest path that operating systems accept [characters], and longest name of a file or folder in it [bytes].
LONGEST_PATH, LONGEST_NAME = 4096, 255
#: Largest integer of 64 bits.
LARGEST_INT64 = int(np.iinfo(np.int64).max)
#: Largest index of 32 bits.
LARGEST_INDEX = np.iinfo(np.int32).max
_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = 80

#: Environment variables that set the number of threads of a new process.
THREAD_LIMITS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")


@dataclass(frozen=True)
class Quantity:
    """Declaration of a parameter in the annotation of a field; the keys of scenes are derived from it.

    Attributes
    ----------
    dimension
        Dimension of its values, as in `skfem_stvk.units.DIMENSIONS`; None for pure numbers, texts and locations.
    sentence
        Sentence that describes the quantity.
    gt, ge, lt, le
        Limits of each of its numbers.
    values
        Permitted texts, if these are few.
    components
        Whether it is a vector: one to three numbers.
    otherwise
        Meaning of a default of None; None if the default means no value.
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


class Specification:
    """Base of laws, materials and contacts. An unknown argument is refused with the argument that is probably meant.

    >>> from skfem_stvk import StVK
    >>> StVK(E=1e5, nu=0.3)
    Traceback (most recent call last):
    skfem_stvk.errors.MaterialError: StVK(E=...): there is no such argument; known: 'area', ... Did you mean 'young'?
    """

    #: Class of the error for an unknown argument.
    error: ClassVar[type[StvkError]] = MaterialError

    def __new__(cls: type[Specified], *values: Any, **named: Any) -> Specified:
        known = signature(cls.__init__).parameters
        takes_all = any(one.kind is one.VAR_KEYWORD for one in known.values())
        unknown = [] if takes_all else [name for name in named if name not in known]
        if unknown:
            names = name_known(unknown[0], (name for name in known if name != "self"))
            raise cls.error(f"{cls.__name__}({unknown[0]}=...): there is no such argument; {names}")
        return super().__new__(cls)


Specified = TypeVar("Specified", bound=Specification)


def shown(value: Any) -> str:
    """Return a value as text for a message: on one line and short, even if its `repr` is long or fails.

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
    """Return a finite number strictly between `low` and `high`, or with `closed` one of the limits.

    Bools and complex numbers are refused.

    >>> number("rtol", np.float32(0.5), low=0, high=1)
    0.5
    >>> number("rtol", "1e-8", "a number between 0 and 1, such as 1e-8")
    Traceback (most recent call last):
    skfem_stvk.errors.StvkError: rtol = '1e-8'; expected a number between 0 and 1, such as 1e-8.
    """
    if type(given) is float and low < given < high and isfinite(given):
        return given  # the most frequent case in the loops of solvers
    value = _real(given)
    inside = value is not None and (low < value < high or (closed and value in (low, high)))
    if value is None or not inside or not isfinite(value):
        raise error(f"{name} = {shown(given)}; expected {expected}.")
    return value


def whole(
    name: str,
    given: Any,
    expected: str = "a whole number",
    least: int = 0,
    most: int = LARGEST_INT64,
    error: type[StvkError] = StvkError,
) -> int:
    """Return a whole number from `least` to `most`; a bool or 2.5 is refused.

    >>> whole("steps", np.int32(4), least=1)
    4
    """
    if isinstance(given, np.ndarray) and given.ndim == 0:
        given = given[()]
    if isinstance(given, bool | np.bool_) or not isinstance(given, Integral) or not least <= int(given) <= most:
        raise error(f"{name} = {shown(given)}; expected {expected}.")
    return int(given)


def flag(name: str, given: Any, error: type[StvkError] = StvkError) -> bool:
    """Return True or False; refuse any other object, even if Python could use it as a truth value.

    >>> flag("quiet", "yes")
    Traceback (most recent call last):
    skfem_stvk.errors.StvkError: quiet = 'yes'; expected True or False.
    """
    if not isinstance(given, bool | np.bool_):
        raise error(f"{name} = {shown(given)}; expected True or False.")
    return bool(given)


def choice(name: str, given: Any, known: Iterable[str], error: type[StvkError] = StvkError) -> str:
    """Return one of the known names; an error lists them and suggests the most similar one.

    >>> choice("kind", "barier", ["barrier", "quadratic"])
    Traceback (most recent call last):
    skfem_stvk.errors.StvkError: kind = 'barier'; known: 'barrier', 'quadratic'. Did you mean 'barrier'?
    """
    names = list(known)
    if not isinstance(given, str) or given not in names:
        raise error(f"{name} = {shown(given)}; {name_known(given if isinstance(given, str) else '', names)}")
    return str(given)


def text(name: str, given: Any) -> str:
    """Return text that can be displayed: at most 1000 characters, without control characters.

    >>> text("label", "stress" + chr(0))
    Traceback (most recent call last):
    skfem_stvk.errors.StvkError: label = 'stress\\x00'; expected a text of at most 1000 characters that can be printed.
    """
    if not isinstance(given, str) or len(given) > 1000 or not given.replace("\n", "").isprintable():
        raise StvkError(f"{name} = {shown(given)}; expected a text of at most 1000 characters that can be printed.")
    return str(given)


def path(name: str, given: Any, expected: str = "a path", error: type[StvkError] = StvkError) -> Path:
    """Return a path that the operating system accepts: not empty, without NUL, and without names that are too long.

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
    """Return the number of bytes of a file name; infinity if the name cannot be encoded."""
    try:
        return len(os.fsencode(part))
    except UnicodeEncodeError:  # an unpaired surrogate
        return inf


def array(
    name: str, given: Any, shape: tuple[int | None, ...], expected: str, error: type[StvkError] = StvkError, what: str = "entry"
) -> NDArray[np.float64]:
    """Return finite numbers in double precision, as an array of this shape; None in `shape` means any length.

    The result may be the user-supplied array itself.

    Text, bools, complex numbers, objects, ragged lists, masked entries and numbers that are not finite are refused. The message
    names numbers that are not finite by their index along the last axis, called `what`.

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
    """Return a vector (n,) of numbers in single or double precision, whichever it has.

    `each` names the objects with one number each in messages.

    The numbers need not be finite. Contiguous floating-point arrays are not copied. `kinds` are NumPy's letters of the accepted
    types, "fiuc" with complex numbers. All other types raise StateError, and so do masked entries.

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
        hint = flat if values.ndim > 1 and values.size == n else "The mesh or its degree may differ."
        raise StateError(f"{name} has shape {values.shape}; expected ({n},), one number for each {each}. {hint}")
    precision = values.dtype.newbyteorder("=") if values.dtype.char in "fdFD" else np.float64  # single and double, real and complex
    return np.ascontiguousarray(values, precision)


def points(kind: str, given: Mapping[str, Any], error: type[StvkError] = StvkError) -> dict[str, tuple[float, ...]]:
    """Return points or directions with one to three finite components, as many in each; errors name their `kind` of object.

    >>> points("RigidPlane", {"point": (0, 0), "normal": np.array([0, 1])})
    {'point': (0.0, 0.0), 'normal': (0.0, 1.0)}
    """
    expected, found = "one to three coordinates, as many as the mesh has dimensions", {}
    for name, value in given.items():
        point = array(f"{kind}: {name}", value, (None,), expected, error)
        if not 1 <= len(point) <= 3:
            raise error(f"{kind}: {name} = {shown(value)}; expected {expected}.")
        found[name] = tuple(point.tolist())
    if len({len(point) for point in found.values()}) > 1:
        (one, n), (other, m) = ((name, len(point)) for name, point in found.items())
        raise error(f"{kind}: {one} has {n} components and {other} {m}; expected as many of both.")
    return found


def real_array(given: Any) -> NDArray[np.float64] | None:
    """Return an array in double precision, possibly the argument itself.

    Return None if the argument does not hold real numbers, or has masked entries.

    >>> real_array([1, 2]), real_array([1, "2"]), real_array(np.ma.masked_equal([1, 2], 2))
    (array([1., 2.]), None, None)
    """
    values = plain_array(given)
    return values.astype(np.float64, copy=False) if values is not None and values.dtype.kind in "fiu" else None


def whole_array(given: Any) -> NDArray[Any] | None:
    """Return an array of whole numbers or bools, such as ids or a mask; None for any other object.

    The result may be the argument itself.

    Empty lists count as empty arrays of ids.

    >>> whole_array([3, 1]), whole_array([]), whole_array([0.5]), whole_array({3, 1})
    (array([3, 1]), array([], dtype=int64), None, None)
    """
    values = plain_array(given)
    if values is None or not (values.dtype.kind in "iub" or (values.shape == (0,) and values.dtype.kind == "f")):
        return None
    return values if values.size else values.astype(bool if values.dtype.kind == "b" else np.int64)


def plain_array(given: Any) -> NDArray[Any] | None:
    """Return the array that NumPy makes of an object; None for masked entries, ragged lists and failing conversions.

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
    """Replace the fields of a frozen dataclass by copies, so that later changes of the originals have no effect."""
    for field in fields(specification):
        object.__setattr__(specification, field.name, frozen(getattr(specification, field.name)))


def frozen(given: Any, depth: int = 8) -> Any:
    """Return a copy that is independent of the original: read-only arrays, and lists and dicts with copied contents.

    A pandas series becomes an array, as does any other object that NumPy converts. Other objects, such as functions, are returned
    unchanged. Contents deeper than `depth` are also returned unchanged, because a list may contain itself.

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
    if "skfem" in sys.modules and isinstance(given, sys.modules["skfem"].DofsView):  # exists only if skfem is imported
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
    """Return the argument as a float; None if it is not a number."""
    if isinstance(given, np.ndarray) and given.ndim == 0:
        given = given[()]
    if isinstance(given, bool | np.bool_) or not isinstance(given, Real):
        return None
    try:
        return float(given)
    except (OverflowError, ValueError):  # 10**400
        return None


def check_index_range(count: int, what: str) -> None:
    """Refuse a count beyond 32-bit indices, before any array of that size is made.

    >>> check_index_range(3 * 10**9, "non-zeros of K")
    Traceback (most recent call last):
    skfem_stvk.errors.MeshError: 3000000000 non-zeros of K are more than 32-bit indices can count (2147483647). ...
    """
    if count > LARGEST_INDEX:
        raise MeshError(
            f"{count} {what} are more than 32-bit indices can count ({LARGEST_INDEX}). Split the body, or coarsen the mesh."
        )
