"""How kernels are compiled: by numba, once a machine."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias, TypeVar

import numba
import numpy as np
from numba.core.event import Listener, register
from numpy.typing import NDArray
from rich.console import Console

from .cache import keep_with_care

Ids: TypeAlias = NDArray[Any]
Reals: TypeAlias = NDArray[np.floating[Any]]
Function = TypeVar("Function", bound=Callable[..., Any])

#: Sums may be reordered and contracted; NaN and infinity keep their meaning, so that what overflows is seen. A difference that must be taken first,
#: as that of displacements before it is added to that of coordinates, is stored in an array: in one expression LLVM may turn the two round.
FASTMATH = {"reassoc", "contract", "nsz", "arcp"}


class _Announcement(Listener):
    """Says once a process why a first call takes long."""

    kept = "for their first use; they are kept on disk"

    def __init__(self) -> None:
        self.made = False

    def on_start(self, event: Any) -> None:
        package = __name__.partition(".")[0]
        if not self.made and event.data["dispatcher"].py_func.__module__.startswith(package):
            self.made = True
            text = f"{package}: compiling kernels {self.kept}"
            Console(stderr=True, highlight=False).print(f"[dim]{text}[/]", soft_wrap=True)

    def on_end(self, event: Any) -> None:
        pass


def kernel(function: Function, **more: Any) -> Function:
    """Compile at the first call with arguments of a type, keep the machine code on disk, and let go of the GIL.

    The code on disk is keyed by the file of the function alone: callees stand in the caller's file. Where no folder can be written
    to, every process compiles anew.
    """
    options: dict[str, Any] = {"fastmath": FASTMATH, "nogil": True, "error_model": "numpy", **more}
    try:
        compiled: Function = numba.njit(cache=True, **options)(function)
    except RuntimeError:  # no folder for the cache
        compiled = numba.njit(**options)(function)
        _Announcement.kept = "in every process: no folder can be written to. Set NUMBA_CACHE_DIR to one that can"
    else:
        if compiled is not function:  # as it is where numba is switched off
            keep_with_care(compiled)
    return compiled


def inlined(function: Function) -> Function:
    """A piece of a kernel's innermost loop: a loop with a call in it is not vectorised."""
    return kernel(function, forceinline=True)


register("numba:compile", _Announcement())
