"""Named arrays in plain text files, which any language reads in a few lines, and in NPZ files. All content is validated.

The first line of a text file gives its kind and version, by default `skfem-stvk vectors 1`. Each array begins with a line `NAME
TYPE RANK N1 ... NRANK`, where TYPE is real, int or text. Its N1 x ... x NRANK values follow in C order (the last index runs
fastest), separated by white space. An array of text has one line for each of its N1 entries. Numbers are written with as many
digits as a double needs.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..errors import name_known
from ..npz import NotArrays, arrays_of
from .complete_files import ForeignFile, content_of, replacing

FIRST_LINE = "skfem-stvk vectors 1"
TYPES = {"real": np.dtype(np.float64), "int": np.dtype(np.int64), "text": np.dtype(str)}
#: Largest number of bytes of an array that is read.
LARGEST = 2**33
RANKS = 5


def type_of(array: NDArray[np.generic]) -> str:
    """Return the key of `TYPES` for an array."""
    return {"f": "real", "i": "int", "U": "text"}[array.dtype.kind]


def write_text(path: Path, arrays: Mapping[str, Array], first_line: str = FIRST_LINE) -> None:
    """Write the arrays to a plain text file."""
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        file.write(first_line + "\n")
        for name, array in arrays.items():
            file.write(" ".join([name, type_of(array), str(array.ndim), *map(str, array.shape)]) + "\n")
            rows = array.reshape(-1, 1) if array.ndim < 2 else array.reshape(-1, array.shape[-1])
            file.writelines(" ".join(map(str, row)) + "\n" for row in rows.tolist())


def write_npz(path: Path, arrays: Mapping[str, Array]) -> None:
    """Write the arrays to a compressed NPZ file."""
    with replacing(path) as temporary, temporary.open("wb") as file:
        named: dict[str, Any] = dict(arrays)
        np.savez_compressed(file, **named)


def read(path: Path, wanted: Iterable[str]) -> dict[str, Array]:
    """Return the arrays of a text file or an NPZ file, in double precision, 64-bit integers or as text.

    `wanted` holds the allowed names.

    Raises
    ------
    ForeignFile
        if the file is damaged, of another format, or has an array of another name. The message gives the line, the fault and the
        expected content.
    """
    try:
        return _read_npz(path, list(wanted)) if path.suffix == ".npz" else _read_text(path, list(wanted))
    except OSError as error:
        raise ForeignFile(f"{path} cannot be read: {error.strerror or error}.") from error
    except MemoryError as error:
        raise ForeignFile(f"{path} holds more than fits into memory.") from error


def _read_npz(path: Path, wanted: list[str]) -> dict[str, Array]:
    def known(name: str) -> bool:
        _refuse_unknown(f"{path}", name, wanted)
        return True

    try:
        return {name: _plain(path, name, array) for name, array in arrays_of(path, known, LARGEST).items()}
    except NotArrays as error:
        raise ForeignFile(f"{path} is no NPZ file of numbers and texts: {error}. Write it again.") from error


def _plain(path: Path, name: str, array: Array) -> Array:
    kind = {"f": "real", "i": "int", "u": "int", "U": "text"}.get(array.dtype.kind)
    if kind is None:
        raise ForeignFile(f"{path}: {name} is of {array.dtype}; expected real numbers, whole numbers or text.")
    return array if kind == "text" else array.astype(TYPES[kind])


def _read_text(path: Path, wanted: list[str]) -> dict[str, Array]:
    lines = content_of(path, LARGEST).decode(errors="replace").splitlines()
    if not lines or lines[0].split() != FIRST_LINE.split():
        got = repr(lines[0][:80]) if lines else "an empty file"
        raise ForeignFile(f"{path}: the first line is {FIRST_LINE!r}; got {got}. Is it another file, or of another version?")
    arrays: dict[str, Array] = {}
    at = 1
    while at < len(lines):
        if not lines[at].strip():
            at += 1
            continue
        name, kind, shape = _header(f"{path}, line {at + 1}", lines[at], wanted)
        if name in arrays:
            raise ForeignFile(f"{path}, line {at + 1}: {name} is there twice.")
        start, count = at + 1, math.prod(shape)
        if kind == "text":
            entries, at = lines[start : start + count], start + count
        else:
            at, entries = start, []
            while len(entries) < count and at < len(lines):
                entries += lines[at].split()
                at += 1
        if len(entries) != count:
            few = len(entries) < count
            raise ForeignFile(
                f"{path}, line {start}: {name} has {len(entries)} values, expected {count}, {' x '.join(map(str, shape))}. "
                + ("Did the program end before the file was whole?" if few else "Begin each array on a line of its own.")
            )
        arrays[name] = _values(f"{path}: {name}, which begins on line {start}", entries, kind).reshape(shape)
    return arrays


def _header(where: str, line: str, wanted: list[str]) -> tuple[str, str, tuple[int, ...]]:
    """Return name, type and shape from the first line of an array. Raise ForeignFile if the line is invalid."""
    name, *words = line.split()
    kind, numbers = (words[0], words[1:]) if words else ("", [])
    whole = all(word.isascii() and word.isdigit() and len(word) < 12 for word in numbers)
    shape = tuple(map(int, numbers[1:])) if whole else ()
    if kind not in TYPES or not whole or not numbers or int(numbers[0]) != len(shape) or not 1 <= len(shape) <= RANKS:
        raise ForeignFile(
            f"{where}: got {line[:80]!r}; expected an array: its name, one of {', '.join(TYPES)}, its number of dimensions (1 to "
            f"{RANKS}), and as many sizes. Has the array before it more values than its sizes say?"
        )
    if kind == "text" and len(shape) != 1:
        raise ForeignFile(f"{where}: {name} is a text of {len(shape)} dimensions; expected 1.")
    _refuse_unknown(where, name, wanted)
    return name, kind, shape


def _refuse_unknown(where: str, name: str, wanted: list[str]) -> None:
    if name not in wanted:
        raise ForeignFile(f"{where}: there is an array {name[:80]!r}; {name_known(name[:80], wanted)}")


def _values(where: str, entries: list[str], kind: str) -> Array:
    if kind == "text":
        return np.array(entries, dtype=str)
    try:
        return np.array(entries, dtype=str).astype(TYPES[kind])
    except (ValueError, OverflowError):
        number = {"real": float, "int": int}[kind]
        raise ForeignFile(f"{where}: {_first_wrong(entries, number)!r} is no {kind} number that C would read.") from None


def _first_wrong(entries: list[str], number: type[float] | type[int]) -> str:
    for entry in entries:
        try:
            number(entry)
        except (ValueError, OverflowError):
            return entry[:80]
    return entries[0][:80]
