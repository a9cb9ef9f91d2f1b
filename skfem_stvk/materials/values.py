"""Material constants: a number for all elements, or one an element; checked with the ids of the bad ones."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arguments import real_array, shown
from ..errors import MaterialError, name_ids

Values: TypeAlias = NDArray[np.float64]


def constant(value: ArrayLike, name: str, low: float = -np.inf, high: float = np.inf, shape: tuple[int, ...] = ()) -> Values:
    """The constant as an array of the given shape, or with one more axis in front for one value an element.

    Raises
    ------
    MaterialError
        if it has another shape, is not finite, or not strictly between `low` and `high`; with the ids.
    """
    given = real_array(value)
    if given is None:
        raise MaterialError(f"{name} = {shown(value)} is not a number, nor an array with one value per element.")
    array = np.array(given)  # a copy: materials are frozen
    if not array.size or array.shape not in (shape, (len(array) if array.ndim else 0, *shape)):
        raise MaterialError(
            f"{name} has shape {array.shape}; expected {shape or 'a number'}, or one value an element: {('n', *shape)}."
        )
    _refuse(array, ~np.isfinite(array), name, "not finite", shape)
    array.flags.writeable = False
    _refuse(array, ~((array > low) & (array < high)), name, f"outside ({low:g}, {high:g})", shape)
    return array


def _refuse(array: Values, bad: NDArray[np.bool_], name: str, what: str, shape: tuple[int, ...]) -> None:
    if not bad.any():
        return
    if array.ndim == len(shape):
        raise MaterialError(f"{name} = {np.array2string(array)} is {what}.")
    ids = np.flatnonzero(bad.reshape(len(array), -1).any(axis=1))
    raise MaterialError(f"{name} is {what} in {name_ids(ids, 'element')}, first value {array[bad][0]:g}. Was it filled for all?")


def check_length(array: Values, n: int, name: str, shape: tuple[int, ...] = ()) -> None:
    """Refuse an array with one value an element if there are not `n` elements.

    Raises
    ------
    MaterialError
    """
    if array.ndim > len(shape) and len(array) != n:
        raise MaterialError(
            f"{name} has {len(array)} values; expected a single one, or one for each of the {n} elements of its region, in their order."
        )
