"""Decorators for sources that serve for counting and for timing: plain Python that Numba can compile."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

Function = TypeVar("Function", bound=Callable[..., Any])

#: Sums may be reordered and multiplications fused with additions, as C compilers do with -ffast-math. NaN and infinity keep their
#: meaning.
FASTMATH = {"reassoc", "contract", "nsz", "arcp"}


def jitable(function: Function) -> Function:
    """Return the function unchanged, but callable from compiled functions."""
    try:
        from numba.extending import register_jitable
    except ImportError:
        return function
    same: Function = register_jitable(function)
    return same


def compiled(function: Function) -> Function:
    """Return the function compiled to machine code for one thread."""
    try:
        from numba import njit
    except ImportError as error:
        raise ImportError("Numba is not installed; times need it: pip install numba") from error
    fast: Any = njit(fastmath=FASTMATH, error_model="numpy")(function)
    same: Function = fast
    return same
