"""Sequential reader of a mesh file that does not trust the file's declarations."""

from __future__ import annotations

import os
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import name_ids

#: Maximum depth of included files, and their maximum number.
DEEPEST, MOST_FILES = 8, 100
#: Most bytes of a line of text.
LONGEST = 1_000_000
#: Declared numbers of nodes and of elements; None for an undeclared number.
Counts = tuple[int | None, int | None]


class Damaged(Exception):
    """A fault of a mesh file, as a clause that follows the name of the file."""


class CutOff(Damaged):
    """A fault of a file of which something is missing, such as numbers of a count that it declares."""


class Source:
    """File of text or of binary numbers, read from its beginning to its end.

    The lines between binary `numbers` are always text. Lines that begin with one of the `comments` are left out.
    """

    def __init__(self, path: Path, binary: bool = False, comments: tuple[str, ...] = ()) -> None:
        regular(path)
        self.file = path.open("rb")
        self.size = os.fstat(self.file.fileno()).st_size
        self.binary, self.comments = binary, comments

    def __enter__(self) -> Source:
        return self

    def __exit__(self, *error: object) -> None:
        self.file.close()

    @property
    def left(self) -> int:
        """Number of bytes that are not read yet."""
        return self.size - self.file.tell()

    def raw_line(self) -> bytes:
        """Return the next line with its end, empty at the end of the file; `Damaged` if it is too long."""
        raw = self.file.readline(LONGEST + 1)
        if len(raw) > LONGEST:
            raise Damaged(f"it has a line of more than {LONGEST} bytes; expected lines of text")
        return raw

    def line(self) -> str:
        """Return the next line that is not blank, without blanks around it; empty at the end of the file."""
        for raw in iter(self.raw_line, b""):
            text = raw.decode(errors="replace").strip()
            if text and not text.startswith(self.comments or "\0"):
                return text
        return ""

    def numbers(self, what: str, rows: int, columns: int = 1, dtype: Any = np.float64) -> NDArray[Any]:
        """Return numbers (rows, columns); `Damaged` if there are fewer, or the file is too short for as many."""
        dtype = np.dtype(dtype)
        self.fits(what, rows, columns * (dtype.itemsize if self.binary else 2))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # older NumPy versions warn of text among the numbers
            try:
                values = np.fromfile(self.file, dtype, rows * columns, "" if self.binary else " ")
            except ValueError as error:
                raise Damaged(f"{rows} {what} are declared, but their numbers contain other text") from error
        if len(values) < rows * columns:
            raise CutOff(f"{rows} {what} are declared, {len(values) // columns} were found")
        return values.reshape(rows, columns)

    def fits(self, what: str, rows: int, width: int) -> None:
        """Refuse a number of rows, each of at least `width` bytes, that the rest of the file cannot hold."""
        if rows < 0 or rows * width > self.left + 1:
            raise CutOff(f"{rows} {what} are declared, more than its {self.size} bytes can hold")

    def rows(self, what: str, count: int) -> list[list[str]]:
        """Return the words of the next lines that are not blank, one line for each row."""
        self.fits(what, count, 2)
        rows: list[list[str]] = []
        while len(rows) < count and (line := self.line()):
            rows.append(line.split())
        if len(rows) < count:
            raise CutOff(f"{count} {what} are declared, {len(rows)} were found")
        return rows

    def columns(self) -> int:
        """Return the number of words of the next line, which is not read; at least 1."""
        start = self.file.tell()
        words = self.line().split()
        self.file.seek(start)
        return max(len(words), 1)

    def expect(self, word: str, after: str) -> None:
        """Refuse anything but `word` as the next line."""
        found = self.line()
        if found != word:
            raise Damaged(f"{found[:60] or 'nothing'} follows {after}; expected {word or 'nothing'}")


class Included:
    """Files that a mesh file includes: from its folder or below, with limits on their depth and number."""

    def __init__(self, path: Path) -> None:
        self._folder, self._count = path.resolve().parent, 0

    def enter(self, path: Path, depth: int) -> None:
        """Count a file, and refuse files that are included too deep, or too many."""
        self._count += 1
        if depth > DEEPEST or self._count > MOST_FILES:
            raise Damaged(f"it includes files more than {DEEPEST} deep, or more than {MOST_FILES}: itself? {path.name[:60]}")

    def path(self, name: str) -> Path:
        """Return the path of an included file."""
        path = (self._folder / name).resolve()
        if not name or not path.is_relative_to(self._folder):
            raise Damaged(f"it includes {name[:80]!r}, which is not in its folder {self._folder}: copy it there")
        return path


def real(word: str) -> float:
    """Return a number, 0 for a blank one; the letter of its exponent may be D, or missing as in files of Nastran.

    >>> real("1.5-3"), real("-2.D+1"), real("")
    (0.0015, -20.0, 0.0)
    """
    try:
        return float(re.sub(r"(?<=[\d.])(?:[DE]([+-]?\d+)|([+-]\d+))$", r"E\1\2", word.upper()) or 0)
    except ValueError as error:
        raise Damaged(f"{word[:40]!r} was found; expected a number") from error


def regular(path: Path) -> None:
    """Refuse a file that is not regular, such as a pipe or a device, which may never end."""
    if not path.is_file():
        raise Damaged(f"{str(path)[-80:]!r}, which it needs, is missing or not a regular file")


def check_last_line(file: Any) -> None:
    """Refuse a text file whose last line does not end, since it may be cut within a number."""
    if not file.seek(0, os.SEEK_END):
        return
    file.seek(-1, os.SEEK_END)
    if file.read(1) not in b"\n\r\x1a\0":
        raise CutOff("its last line has no end, so it may be cut within a number (end it with a newline if it is complete)")


def count_of(text: str, what: str) -> int:
    """Return a count that a file declares."""
    if not text.isascii() or not text.isdigit() or len(text) > 18:
        raise Damaged(f"number of {what} = {text[:40]!r}; expected a whole number")
    return int(text)


def check_unique(ids: ArrayLike, what: str) -> None:
    """Refuse ids that occur more than once."""
    unique, counts = np.unique(ids, return_counts=True)
    if len(unique) < np.size(ids):
        raise Damaged(f"{name_ids(_plain(unique[counts > 1]), what)} more than once")


def check_known(ids: NDArray[Any], known: NDArray[Any], what: str, of: str) -> None:
    """Refuse ids that are not among the known ones, which are ascending."""
    at = np.minimum(np.searchsorted(known, ids), len(known) - 1)
    if len(missing := np.unique(ids[known[at] != ids] if len(known) else ids)):
        raise Damaged(f"{of}: {name_ids(_plain(missing), what)} not defined")


def _plain(ids: NDArray[Any]) -> NDArray[Any]:
    """Return whole numbers without the decimal point of real ones."""
    return ids.astype(np.int64) if np.all(np.abs(ids) < 2.0**53) and np.all(ids == np.floor(ids)) else ids
