"""Archives: files .npz of a record and its arrays, each whole or absent; and folders of them, of which one run is the writer.

The dataclass of a record is the schema of its file: a file has exactly its fields, of their types. Arrays have the names of their
fields, such as "now state u".
"""

from __future__ import annotations

import hashlib
import json
import re
import secrets
from collections.abc import Callable, Container, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, is_dataclass
from enum import Enum
from functools import cache, partial
from glob import escape
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar, cast, get_type_hints

import numpy as np
from numpy.typing import NDArray

from ...arguments import Array
from ...npz import Stored, arrays_of
from ...results.complete_files import ForeignFile, OneWriter, in_all_parts, of_leader, replacing
from ...space import ONE_PROCESS, Space
from ...system.signature import Fingerprint, Signature

#: Configuration of the outermost dataclass of a record: exactly its fields, of their types, with finite numbers.
STRICT: dict[str, Any] = {"strict": True, "extra": "forbid", "allow_inf_nan": False}
#: Prefix of the names of arrays in a file.
ARRAY = "array "
#: Format and version of the file of a part of a divided body, and its array of the numbers of degrees of freedom.
PART, NUMBERS = ("part of skfem-stvk", 1), "numbers"

OfRecord = TypeVar("OfRecord")


@dataclass(frozen=True)
class FileHeader:
    """Header of a file: its format, the problem of its results, its record, and for a divided body the files of its parts."""

    __pydantic_config__: ClassVar[dict[str, Any]] = STRICT

    format: str
    version: int
    problem: Signature
    record: dict[str, Any]
    parts: list[str] = field(default_factory=list)


class Store(Generic[OfRecord]):
    """Files of one format. Each subclass declares the format, the dataclass of its records, and the remedy for unreadable files."""

    known: ClassVar[tuple[str, int]]  # format and version
    remedy: ClassVar[str]
    schema: type[OfRecord]

    @classmethod
    def write_file(cls, file: Path, problem: Fingerprint, record: OfRecord, space: Space | None = None) -> None:
        """Replace a file. Arrays by degree of freedom are those of vectors of the `space`.

        In a divided body, each part writes these arrays to a file of its own before. The names of these files are new each time, so
        that the previous ones remain valid if writing is interrupted.
        """
        content, names, comm = _Content(), [], ONE_PROCESS if space is None else space.comm
        header: dict[str, Any] = {"format": cls.known[0], "version": cls.known[1], "record": content.plain(record)}
        header["problem"], arrays = vars(problem.signature), content.others
        if space is not None and comm.divided:
            stamp = comm.each(secrets.token_hex(4))[0]
            header["parts"] = names = [f"rank{rank:04d}_{file.stem}_{stamp}.npz" for rank in range(comm.size)]
            with in_all_parts(comm):
                part = {NUMBERS: space.numbers, **content.vectors}
                write_archive(file.with_name(names[comm.rank]), {"format": PART[0], "version": PART[1]}, part)
        else:
            arrays |= {name: _in_order(array, space) for name, array in content.vectors.items()}

        def finish() -> None:
            write_archive(file, header, arrays)
            _remove_parts(file, names)

        of_leader(comm, finish)

    @classmethod
    def read_header(cls, file: Path, remedy: str) -> FileHeader:
        """Return the header of a file, without its arrays."""
        return checked_header(file, read_archive(file, cls.known, remedy, only_header=True)[0], remedy)

    @classmethod
    def read_file(cls, file: Path, space: Space | None = None, remedy: str = "") -> tuple[Signature, OfRecord]:
        """Return the problem and the record of a file. Arrays by degree of freedom are those of the `space`, which may be of
        another division of the body than when the file was written.

        Raises ForeignFile if it is not one of this format; StvkError in all parts of a divided body if one part cannot read it.
        """
        comm, remedy = ONE_PROCESS if space is None else space.comm, remedy or cls.remedy
        with in_all_parts(comm):
            plain, arrays = read_archive(file, cls.known, remedy)
            header = checked_header(file, plain, remedy)
        vectors = {} if space is None else of_parts(file, header.parts, space, remedy)
        with in_all_parts(comm), refusing_damage(file, remedy):
            record = validated(cls.schema, header.record, partial(_found, arrays, vectors, space))
            if missing := "; ".join(f"{name}: Field required" for name in _missing(_Content().plain(record), header.record)):
                raise ValueError(missing)
            return header.problem, record


class FolderStore(Store[OfRecord], OneWriter):
    """Folder of files, from which a later run continues. It is used in a `with` block, during which no other process can write.

    `folder` is writable, see `output_folder`. Each file has the signature of its problem. States in the files are vectors of the
    space `states`, if that is not None.
    """

    problem: Fingerprint
    name: ClassVar[str]  # of a file, such as "state_{:05d}.npz" with a number

    def __init__(self, folder: Path, space: Space | None = None) -> None:
        super().__init__(folder, ONE_PROCESS if space is None else space.comm)
        self.folder, self.states = folder, space

    def existing(self) -> list[Path]:
        """Return the existing files in ascending order."""
        return sorted(self.folder.glob(pattern(self.name)))

    def numbered(self, number: int) -> Path:
        """Return the path of the file of a number."""
        return self.folder / self.name.format(number)

    def write(self, file: Path, record: OfRecord) -> None:
        """Replace a file of the folder."""
        self.write_file(file, self.problem, record, self.states)

    def read_own(self, file: Path, remedy: str) -> OfRecord:
        """Return the record of a file; refuse one of another problem with the remedy."""
        problem, record = self.read_file(file, self.states)
        self.problem.refuse_other(problem, file, remedy)
        if self.states is not None:
            with refusing_damage(file, self.remedy):
                check_lengths(record, self.states.n)
        return record

    def refuse_to_replace(self, file: Path) -> None:
        """Refuse to replace a file of another problem, or of another format."""
        remedy = "Choose another folder, or replace it with overwrite=True."
        self.problem.refuse_other(self.read_header(file, remedy).problem, file, remedy)


@dataclass(frozen=True)
class _Content:
    """Arrays of a record by name: those by degree of freedom, and the others."""

    vectors: dict[str, Array] = field(default_factory=dict)
    others: dict[str, Array] = field(default_factory=dict)

    def plain(self, value: Any, name: str = "", by_dof: bool = False) -> Any:
        """Return a value in the form that JSON can write, with names in the place of its arrays, and collect these."""
        if isinstance(value, np.ndarray):
            (self.vectors if by_dof else self.others)[name] = value
            return name
        if isinstance(value, Enum):
            return value.value
        if is_dataclass(value):
            schema: Any = type(value)
            own, vectors = vars(value), _vectors_of(schema)
            return {
                one.name: self.plain(own[one.name], f"{name} {one.name}".lstrip(), one.name in vectors) for one in fields(value)
            }
        if isinstance(value, Mapping):
            return {key: self.plain(one, f"{name} {key}") for key, one in value.items()}
        if isinstance(value, list | tuple):
            return [self.plain(one, f"{name} {i}") for i, one in enumerate(value)]
        return value


@cache
def _vectors_of(schema: Any) -> set[str]:
    """Return the names of the fields of a dataclass that are arrays by degree of freedom."""
    hints = get_type_hints(schema, include_extras=True).items()
    return {
        name for name, hint in hints if any(isinstance(one, Stored) and one.by_dof for one in getattr(hint, "__metadata__", ()))
    }


def validated(schema: type[OfRecord], plain: Any, found: Callable[[str, Stored], Array] | None = None) -> OfRecord:
    """Return the record of these entries; `found` returns its arrays by name. Raises ValueError for entries of other types."""
    kind: Any = schema
    return cast(OfRecord, _adapter(kind).validate_json(json.dumps(plain), context=found))


def _missing(whole: Any, part: Any, name: str = "") -> Iterator[str]:
    """Yield the names of the fields of a record that the entries of a file lack, because the dataclass has a default."""
    if isinstance(whole, dict):
        for key, value in whole.items():
            inner = f"{name}.{key}".lstrip(".")
            yield from _missing(value, part[key], inner) if key in part else (inner,)
    elif isinstance(whole, list):
        for i, (value, entry) in enumerate(zip(whole, part, strict=True)):
            yield from _missing(value, entry, f"{name}.{i}")


@cache
def _adapter(schema: Any) -> Any:
    from pydantic import TypeAdapter  # imported only for files

    return TypeAdapter(schema)


def _found(arrays: Mapping[str, Array], vectors: Mapping[str, Array], space: Space | None, name: str, stored: Stored) -> Array:
    """Return the array of a name; raises ValueError, with a message, if there is none of this type.

    `vectors` are the arrays of the `space` from files of parts. In `arrays`, those by degree of freedom are of the whole body.
    """
    if not isinstance(name, str) or (name not in vectors and name not in arrays):
        raise ValueError(f"it has no array {name!r}")
    array = vectors[name] if name in vectors else arrays[name]
    stored.check(name, array)
    if space is not None and stored.by_dof and name not in vectors and array.shape[-1] == space.count:
        array = array[..., space.numbers]
    return array


def check_lengths(record: Any, n: int) -> None:
    """Raise ValueError if an array by degree of freedom is not of `n` degrees of freedom, which are those of another problem."""
    content = _Content()
    content.plain(record)
    for name, array in content.vectors.items():
        if array.shape[-1] != n:
            raise ValueError(f"the array '{name}' has shape {array.shape}; expected a length of {n}")


def _in_order(array: Array, space: Space | None) -> Array:
    """Return the array with its last axis in the order of the user's mesh."""
    found = np.empty_like(array)
    found[..., slice(None) if space is None else space.numbers] = array
    return found


def remove_file(file: Path) -> None:
    """Remove a file, and those of the parts of a divided body."""
    file.unlink(missing_ok=True)
    _remove_parts(file)


def _remove_parts(file: Path, but: Container[str] = ()) -> None:
    for part in file.parent.glob(f"rank[0-9]*_{escape(file.stem)}_*.npz"):
        if part.name not in but:
            part.unlink(missing_ok=True)


def of_parts(file: Path, parts: list[str], space: Space, remedy: str) -> dict[str, Array]:
    """Return the arrays by degree of freedom in the files of the parts of a body, which was divided in any way when it was written.

    Entries that are missing are NaN. All parts of the body call this. Each reads some files, and all exchange the arrays.
    """
    found: dict[str, Array] = {}
    order = np.argsort(space.numbers)
    ascending = space.numbers[order]
    for begin in range(0, len(parts), space.comm.size):
        names = parts[begin : begin + space.comm.size]
        with in_all_parts(space.comm):
            own = _part_of(file, names[space.comm.rank], remedy) if space.comm.rank < len(names) else None
        if len(parts) == space.comm.size and not space.comm.any(own is None or not np.array_equal(own[0], space.numbers)):
            return own[1] if own else {}
        for turn in range(len(names)):
            numbers, vectors = cast(
                "tuple[Array, dict[str, Array]]", space.comm.each(own if turn == space.comm.rank else None)[turn]
            )
            index = np.minimum(np.searchsorted(ascending, numbers), len(order) - 1)
            here = ascending[index] == numbers
            for one, values in vectors.items():
                found.setdefault(one, np.full((*values.shape[:-1], space.n), np.nan))[..., order[index[here]]] = values[..., here]
    return found


def _part_of(file: Path, name: str, remedy: str) -> tuple[NDArray[np.int64], dict[str, Array]]:
    """Return the numbers of the degrees of freedom in the file of a part, and its arrays."""
    with refusing_damage(file, remedy):
        path = file.with_name(name)
    arrays = read_archive(path, PART, remedy)[1]
    with refusing_damage(path, remedy):
        numbers = arrays.pop(NUMBERS)
        Stored(1, (np.int64,)).check(NUMBERS, numbers)
        for one, array in arrays.items():
            Stored(None).check(one, array)
            if array.shape[-1:] != numbers.shape:
                raise ValueError(f"the array '{one}' has shape {array.shape}; expected a length of {len(numbers)}")
        return numbers, arrays


def pattern(name: str) -> str:
    """Return the pattern of the names of files with any number.

    >>> pattern("state_{:05d}.npz")
    'state_*.npz'
    """
    return re.sub(r"\{.*\}", "*", name)


def write_archive(path: Path, header: Mapping[str, Any], arrays: Mapping[str, Array]) -> None:
    """Replace the file, as `replacing` does."""
    text = json.dumps(header)
    packed = {"header": np.array(text), "digest": np.array(digest_of(text, arrays))}
    packed |= {ARRAY + name: array for name, array in arrays.items()}
    with replacing(path) as part, part.open("wb") as file:
        np.savez(file, **packed)  # type: ignore[arg-type]


def read_archive(
    path: Path, known: tuple[str, int], remedy: str, only_header: bool = False
) -> tuple[dict[str, Any], dict[str, Array]]:
    """Return header and arrays of a file of the `known` format and version; without arrays if `only_header`.

    Raises ForeignFile, with the remedy, if it is incomplete or was not written here.
    """
    try:
        named = arrays_of(path, lambda name: name in ("header", "digest") or (name.startswith(ARRAY) and not only_header))
        text, digest = str(named.pop("header")), str(named.pop("digest"))
        header, arrays = json.loads(text), {name.removeprefix(ARRAY): array for name, array in named.items()}
        _check_known(header, known)
        if not only_header and digest != digest_of(text, arrays):
            raise ForeignFile("was changed after it was written.")
        return header, arrays
    except ForeignFile as error:
        raise ForeignFile(f"{path} {error} {remedy}") from None
    except (OSError, ValueError, KeyError, TypeError, MemoryError, RuntimeError) as error:
        why = f"it is incomplete, or was not written by this package ({type(error).__name__}: {error})"
        raise ForeignFile(f"{path} cannot be read as a {known[0]}: {why}. {remedy}") from error


def checked_header(path: Path, plain: dict[str, Any], remedy: str) -> FileHeader:
    """Return the header of a file; raises ForeignFile, with the remedy, if it has impossible entries."""
    with refusing_damage(path, remedy):
        return validated(FileHeader, plain)


@contextmanager
def refusing_damage(file: Path, remedy: str) -> Iterator[None]:
    """Raise ForeignFile with file and remedy if the block raises a ValueError or a KeyError, or entries violate their schema."""
    try:
        yield
    except ForeignFile:
        raise
    except (ValueError, KeyError) as error:
        raise ForeignFile(f"{file} is damaged: {_in_words(error)}. {remedy}") from None


def digest_of(header: str, arrays: Mapping[str, Array]) -> str:
    """Return a digest that depends on the header and all arrays."""
    digest = hashlib.blake2b(header.encode(), digest_size=16)
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {array.dtype.str} {array.shape} ".encode())
        digest.update(array.view(np.uint8).data if array.size else b"")
    return digest.hexdigest()


def _check_known(header: Any, known: tuple[str, int]) -> None:
    kind, version = known
    if not isinstance(header, dict) or header.get("format") != kind:
        raise ValueError(f"the format is {header.get('format')!r}" if isinstance(header, dict) else "it has no header")
    if header.get("version") != version:
        raise ForeignFile(
            f"is of version {header.get('version')!r} of the format '{kind}'; this release reads version {version}: resume it "
            "with the release that wrote it."
        )


def _in_words(error: Exception, most: int = 3) -> str:
    """Return the message of an error; for entries of other types the first few faults, and the number of the others."""
    if not hasattr(error, "errors"):  # of pydantic
        return str(error.args[0])
    found = [
        f"{'.'.join(map(str, one['loc'])) or 'it'}: {one['msg'].removeprefix('Value error, ')}"
        for one in error.errors(include_input=False, include_url=False)
    ]
    return "; ".join(found[:most]) + (f"; and {len(found) - most} more" if len(found) > most else "")
