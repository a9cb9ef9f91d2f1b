"""Calls of C functions in the process of a `SharedLibrary`, which needs NumPy alone.

Arrays that a function writes have guards on both sides and begin with a mark in every entry, so that writing too much or too little
is seen.
"""

from __future__ import annotations

import ctypes
import platform
from collections.abc import Callable
from typing import Any

import numpy as np

from ...arguments import Array
from .process import LONGEST, answer_questions

#: Mark of an entry that is not written yet: a NaN that no computation makes.
UNSET = np.uint64(0x7FF8_5E7F_EA5E_7000)
#: Number of marks on either side of an array.
GUARD = 64
#: Largest number of triplets, of which each has 24 bytes.
MOST = LONGEST // 32


class CallFailed(Exception):
    """Error of a C function. The message is a clause that follows the name of the function."""


def serve() -> None:
    """Answer the questions on standard input until it ends. The first one loads the library."""
    functions: dict[str, Any] = {}
    body: dict[str, Array] = {}

    def answer_to(question: dict[str, Array]) -> dict[str, Array]:
        role = str(question.pop("role"))
        try:
            if role == "library":
                functions.update(_loaded(**question))
                return {}
            if role == "body":
                body.update(question)  # the arrays stay valid until the next body
                return _set_body(functions[role], body)
            return CALLS[role](functions[role], **question)
        except CallFailed as failed:
            return {"failed": np.array(str(failed))}

    answer_questions(answer_to)


def _loaded(path: Array, **names: Array) -> dict[str, Any]:
    """Return the functions of a library by role."""
    try:
        library = ctypes.CDLL(str(path))
    except OSError as error:
        raise CallFailed(
            f"cannot be loaded: {error}. Expected a shared library for {platform.machine()}, such as cc -shared -fPIC makes it"
        ) from error
    missing = [str(name) for name in names.values() if not hasattr(library, str(name))]
    if missing:
        raise CallFailed(
            f"has no function {' and no '.join(missing)}. Compare the spelling with the output of `nm -D`; functions in C++ need "
            'extern "C", and on Windows __declspec(dllexport)'
        )
    return {role: getattr(library, str(name)) for role, name in names.items()}


def _set_body(function: Any, body: dict[str, Array]) -> dict[str, Array]:
    (nv, d), (nt, n) = body["nodes"].shape, body["elements"].shape
    _call(
        function,
        ctypes.c_int64(nv),
        ctypes.c_int32(d),
        body["nodes"],
        ctypes.c_int64(nt),
        ctypes.c_int32(n),
        *list(body.values())[1:],
    )
    return {}


def _energy(function: Any, u: Array) -> dict[str, Array]:
    return {"value": _written(function, 1, "W", u=u)[0]}


def _force(function: Any, u: Array) -> dict[str, Array]:
    return {"value": _written(function, u.size, "F", u=u)}


def _product(function: Any, u: Array, v: Array) -> dict[str, Array]:
    return {"value": _written(function, u.size, "Kv", u=u, v=v)}


def _tangent(function: Any, u: Array) -> dict[str, Array]:
    count = ctypes.c_int64(-1)
    types: dict[str, Any] = {"rows": ctypes.c_int64, "columns": ctypes.c_int64, "values": ctypes.c_double}
    pointers = {name: ctypes.POINTER(of)() for name, of in types.items()}
    _call_unchanged(function, {"u": u}, ctypes.byref(count), *map(ctypes.byref, pointers.values()))
    if not 0 <= count.value <= MOST:
        raise CallFailed(f"set count = {count.value}; expected the number of its triplets, from 0 to {MOST}")
    if count.value and not all(pointers.values()):
        null = ", ".join(name for name, pointer in pointers.items() if not pointer)
        raise CallFailed(f"set count = {count.value} and left {null} NULL; expected a pointer to as many entries")
    arrays = {
        name: np.ctypeslib.as_array(pointer, (count.value,)) if count.value else np.zeros(0, types[name])
        for name, pointer in pointers.items()
    }
    for name in ("rows", "columns"):
        out = np.flatnonzero((arrays[name] < 0) | (arrays[name] >= u.size))
        if len(out):
            raise CallFailed(
                f"set {name}[{out[0]}] = {arrays[name][out[0]]}, and {len(out)} of {count.value} {name} are out of range; expected "
                f"0 to {u.size - 1}: d * node + component, both from 0"
            )
    return arrays


#: Functions that call a C function, by its role.
CALLS: dict[str, Callable[..., dict[str, Array]]] = {
    "energy": _energy,
    "force": _force,
    "tangent": _tangent,
    "product": _product,
}


def _written(function: Any, size: int, name: str, **given: Array) -> Array:
    """Return the array of `size` entries that a function writes after the `given` ones, which it must not change."""
    whole = np.full(size + 2 * GUARD, UNSET)
    _call_unchanged(function, given, whole[GUARD:-GUARD])
    marked = whole == UNSET
    if not (marked[:GUARD].all() and marked[-GUARD:].all()):
        raise CallFailed(f"wrote outside of {name}, which has {size} {'entry' if size == 1 else 'entries'}")
    left = np.flatnonzero(marked[GUARD:-GUARD])
    if len(left):
        raise CallFailed(
            f"left {len(left)} of {size} entries of {name} unset, the first of them [{left[0]}]; expected all to be written. "
            f"Before the call {name} is not zero"
        )
    return whole[GUARD:-GUARD].view(np.float64)


def _call_unchanged(function: Any, given: dict[str, Array], *others: Any) -> None:
    copies = {name: array.copy() for name, array in given.items()}
    _call(function, *copies.values(), *others)
    for name, array in copies.items():
        if (array != given[name]).any():
            raise CallFailed(f"changed {name}, which is const")


def _call(function: Any, *given: Any) -> None:
    code = function(*(ctypes.c_void_p(one.ctypes.data) if isinstance(one, np.ndarray) else one for one in given))
    if code:
        raise CallFailed(f"returned {code}; expected 0, which means success")
