"""Conversion of results to plain numbers, arrays and names, and their comparison."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import fields, is_dataclass
from numbers import Number
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import issparse

from skfem_stvk import StvkError, System


def comparable(result: Any, depth: int = 4) -> Any:
    """Return a result as plain numbers, arrays, names, lists and dicts."""
    if result is None or isinstance(result, str | bool | np.bool_ | Path | type):
        return result
    if isinstance(result, Number):
        return complex(result) if isinstance(result, complex) else float(result)  # type: ignore[arg-type]
    if isinstance(result, np.ma.MaskedArray):
        return result.filled(np.nan) if result.dtype.kind == "f" else result.filled()
    if isinstance(result, np.ndarray):
        return np.array(result)
    if issparse(result):
        return result.toarray()
    if isinstance(result, Mapping):
        return {str(name): comparable(value, depth - 1) for name, value in result.items()}
    if isinstance(result, list | tuple):
        return [comparable(value, depth - 1) for value in result]
    return {"type": type(result).__name__} | _inside(result, depth)


def _inside(result: Any, depth: int) -> dict[str, Any]:
    """Return the attributes of an object in plain form; for a system its F, K, W and supports."""
    if depth == 0:
        return {}
    if isinstance(result, System):
        u = 0.01 * np.cos(np.arange(result.ndofs))
        found: dict[str, Any] = {"F": result.residual(u, 0.5), "K": result.jacobian(u, 0.5)}
        if not result.without_energy:
            found["W"] = result.energy(u)
        with suppress(StvkError):
            found |= {"held": result.supports.held, "moved": result.supports.values(0.5)}
        return {name: comparable(value) for name, value in found.items()}
    if is_dataclass(result):
        return {one.name: comparable(getattr(result, one.name), depth - 1) for one in fields(result)}
    return {name: comparable(value, depth - 1) for name, value in getattr(result, "__dict__", {}).items() if name[0] != "_"}


def same(one: Any, other: Any) -> bool:
    """Return whether two results agree to single precision."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(same(one[name], other[name]) for name in one)
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, np.ndarray | float | complex) and isinstance(other, np.ndarray | float | complex):
        if np.shape(one) != np.shape(other):
            return False
        if np.asarray(one).dtype.kind in "fiuc":
            size = np.abs(np.nan_to_num(other, posinf=0, neginf=0)).max(initial=0.0)
            return bool(np.allclose(one, other, rtol=1e-5, atol=1e-5 * size, equal_nan=True))
        return bool(np.array_equal(one, other))
    return type(one) is type(other) and bool(one == other)
