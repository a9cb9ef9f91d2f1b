"""Stores: files .npz of a header and arrays, each whole or absent, checked by a schema; and folders of files with one writer."""

from __future__ import annotations

import hashlib
import json
import re
import secrets
from collections.abc import Callable, Container, Iterator, Mapping
from contextlib import contextmanager
from glob import escape
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeAlias, TypeVar, cast

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError

from ..arguments import Array
from ..npz import arrays_of
from ..space import ONE_PROCESS, Space
from ..system.signature import Fingerprint, Signature
from .complete_files import ForeignFile, in_all_parts, of_leader, replacing
from .one_writer import OneWriter


class Record(BaseModel):
    """Entries of a file: exactly these names, of these types, with finite numbers."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)


class FileFormat(Record):
    """Format of a file, and its version."""

    format: str
    version: int


class Header(FileFormat):
    """Entries of the header of each file: its format, the problem of its results, and for a divided body the files of its parts."""

    problem: Signature
    parts: list[str] = []


OfHeader = TypeVar("OfHeader", bound=Header)

#: Prefix of the names of arrays in a file.
ARRAY = "array "
#: Format and version of the file of a part of a divided body, and its array of the numbers of degrees of freedom.
PART, NUMBERS = ("part of skfem-stvk", 1), "numbers"
#: Numbers of the degrees of freedom of a part, and its arrays by degree of freedom.
OfPart: TypeAlias = "tuple[Array, dict[str, Array]]"


class Store(Generic[OfHeader]):
    """Files of one format. Each subclass declares the format, the schema of its headers, and the remedy for unreadable files."""

    known: ClassVar[tuple[str, int]]  # format and version
    remedy: ClassVar[str]
    schema: type[OfHeader]

    @staticmethod
    def by_dof(name: str) -> bool:
        """Return whether the array of this name has one entry for each degree of freedom, along its last axis."""
        return False

    @classmethod
    def write_file(
        cls, file: Path, problem: Fingerprint, about: Mapping[str, Any], arrays: Mapping[str, Array], space: Space | None = None
    ) -> None:
        """Replace a file; `about` is the rest of its header. Arrays `by_dof` are those of vectors of the `space`."""
        header = {"format": cls.known[0], "version": cls.known[1], **about, "problem": vars(problem.signature)}
        if space is None:
            write_archive(file, header, arrays)
        else:
            _write_of_parts(file, header, arrays, cls.by_dof, space)

    @classmethod
    def read_file(cls, file: Path, space: Space | None = None) -> tuple[OfHeader, dict[str, Array]]:
        """Return header and arrays of a file. Arrays `by_dof` are those of the `space`, which may be of another division of the
        body than when the file was written.

        Raises ForeignFile if it is not one of this format; StvkError in all parts of a divided body if one part cannot read it.
        """
        with in_all_parts(ONE_PROCESS if space is None else space.comm):
            header, arrays = read_archive(file, cls.schema, cls.known, cls.remedy)
        return header, arrays if space is None else of_part(file, header, arrays, cls.by_dof, space, cls.remedy)


class FolderStore(Store[OfHeader], OneWriter):
    """Folder of files, from which a later run continues. It is used in a `with` block, during which no other process can write.

    `folder` is writable, see `output_folder`. Each file has the signature of its problem. States in the files are vectors of the
    space `states`, if that is not None.
    """

    problem: Fingerprint
    name: ClassVar[str]  # of a file, such as "state_{:05d}.npz" with a number

    def __init__(self, folder: Path, space: Space | None = None) -> None:
        super().__init__(folder, space)
        self.folder, self.states = folder, space

    def existing(self) -> list[Path]:
        """Return the existing files in ascending order."""
        return sorted(self.folder.glob(pattern(self.name)))

    def numbered(self, number: int) -> Path:
        """Return the path of the file of a number."""
        return self.folder / self.name.format(number)

    def read_own(self, file: Path, remedy: str) -> tuple[OfHeader, dict[str, Array]]:
        """Return header and arrays of a file; refuse one of another problem with the remedy."""
        header, arrays = self.read_file(file, self.states)
        self.problem.refuse_other(header.problem, file, remedy)
        return header, arrays

    def refuse_to_replace(self, file: Path) -> None:
        """Refuse to replace a file of another problem, or of another format."""
        remedy = "Choose another folder, or replace it with overwrite=True."
        header, _ = read_archive(file, self.schema, self.known, remedy, only_header=True)
        self.problem.refuse_other(header.problem, file, remedy)


def _write_of_parts(
    file: Path, header: Mapping[str, Any], arrays: Mapping[str, Array], by_dof: Callable[[str], bool], space: Space
) -> None:
    """Replace a file. In a divided body, each part writes its arrays `by_dof` to a file of its own before.

    The names of these files are new each time, so that the previous ones remain valid if writing is interrupted.
    """
    vectors = {name: array for name, array in arrays.items() if by_dof(name)}
    others, names = {name: array for name, array in arrays.items() if not by_dof(name)}, []
    if space.comm.divided:
        stamp = space.comm.each(secrets.token_hex(4))[0]
        names = [f"rank{rank:04d}_{file.stem}_{stamp}.npz" for rank in range(space.comm.size)]
        with in_all_parts(space.comm):
            part = {NUMBERS: space.numbers, **vectors}
            write_archive(file.with_name(names[space.comm.rank]), {"format": PART[0], "version": PART[1]}, part)
        header = {**header, "parts": names}
    else:
        others |= {name: _in_order(array, space) for name, array in vectors.items()}

    def finish() -> None:
        write_archive(file, header, others)
        _remove_parts(file, names)

    of_leader(space.comm, finish)


def _in_order(array: Array, space: Space) -> Array:
    """Return the array with its last axis in the order of the user's mesh."""
    found = np.empty_like(array)
    found[..., space.numbers] = array
    return found


def remove_file(file: Path) -> None:
    """Remove a file, and those of the parts of a divided body."""
    file.unlink(missing_ok=True)
    _remove_parts(file)


def _remove_parts(file: Path, but: Container[str] = ()) -> None:
    for part in file.parent.glob(f"rank[0-9]*_{escape(file.stem)}_*.npz"):
        if part.name not in but:
            part.unlink(missing_ok=True)


def of_part(
    file: Path, header: Header, arrays: Mapping[str, Array], by_dof: Callable[[str], bool], space: Space, remedy: str
) -> dict[str, Array]:
    """Return the arrays of a file, with those `by_dof` for a part of a body that was divided in any way when they were written.

    Entries that are missing are NaN. All parts of the body call this. Each reads some files, and all exchange the arrays.
    """
    whole = [name for name in arrays if by_dof(name) and arrays[name].shape[-1:] == (space.count,)]
    found = dict(arrays) | {name: arrays[name][..., space.numbers] for name in whole}
    order = np.argsort(space.numbers)
    ascending = space.numbers[order]
    for begin in range(0, len(header.parts), space.comm.size):
        names = header.parts[begin : begin + space.comm.size]
        with in_all_parts(space.comm):
            own = _vectors_of_part(file, names[space.comm.rank], by_dof, remedy) if space.comm.rank < len(names) else None
        if len(header.parts) == space.comm.size and not space.comm.any(own is None or not np.array_equal(own[0], space.numbers)):
            return found | (own[1] if own else {})
        for turn in range(len(names)):
            numbers, vectors = cast(OfPart, space.comm.each(own if turn == space.comm.rank else None)[turn])
            index = np.minimum(np.searchsorted(ascending, numbers), len(order) - 1)
            here = ascending[index] == numbers
            for one, values in vectors.items():
                found.setdefault(one, np.full((*values.shape[:-1], space.n), np.nan))[..., order[index[here]]] = values[..., here]
    return found


def _vectors_of_part(file: Path, name: str, by_dof: Callable[[str], bool], remedy: str) -> OfPart:
    """Return the numbers of the degrees of freedom in the file of a part, and its arrays `by_dof`."""
    with refusing_damage(file, remedy):
        path = file.with_name(name)
    part = read_archive(path, FileFormat, PART, remedy)[1]
    with refusing_damage(path, remedy):
        numbers = expect(part, NUMBERS, (None,), (np.int64,))
        return numbers, {one: expect(part, one, (*part[one].shape[:-1], len(numbers))) for one in part if by_dof(one)}


def pattern(name: str) -> str:
    """Return the pattern of the names of files with any number.

    >>> pattern("state_{:05d}.npz")
    'state_*.npz'
    """
    return re.sub(r"\{.*\}", "*", name)


OfRecord = TypeVar("OfRecord", bound=Record)


def write_archive(path: Path, header: Mapping[str, Any], arrays: Mapping[str, Array]) -> None:
    """Replace the file, as `replacing` does."""
    text = json.dumps(header)
    packed = {"header": np.array(text), "digest": np.array(digest_of(text, arrays))}
    packed |= {ARRAY + name: array for name, array in arrays.items()}
    with replacing(path) as part, part.open("wb") as file:
        np.savez(file, **packed)  # type: ignore[arg-type]


def read_archive(
    path: Path, schema: type[OfRecord], known: tuple[str, int], remedy: str, only_header: bool = False
) -> tuple[OfRecord, dict[str, Array]]:
    """Return header and arrays of a file of the `known` format and version; without arrays if `only_header`.

    Raises ForeignFile, with the remedy, if it is incomplete, was not written here or has impossible entries.
    """
    try:
        text, digest, arrays = _unpacked(path, only_header)
        _check_known(json.loads(text), known)
        if not only_header and digest != digest_of(text, arrays):
            raise ForeignFile("was changed after it was written.")
    except ForeignFile as error:
        raise ForeignFile(f"{path} {error} {remedy}") from None
    except (OSError, ValueError, KeyError, TypeError, MemoryError, RuntimeError) as error:
        why = f"it is incomplete, or was not written by this package ({type(error).__name__}: {error})"
        raise ForeignFile(f"{path} cannot be read as a {known[0]}: {why}. {remedy}") from error
    with refusing_damage(path, remedy):
        return schema.model_validate_json(text), arrays


@contextmanager
def refusing_damage(file: Path, remedy: str) -> Iterator[None]:
    """Raise ForeignFile with file and remedy if the block raises a ValueError or a KeyError, or entries violate their schema."""
    try:
        yield
    except ForeignFile:
        raise
    except ValidationError as error:
        raise ForeignFile(f"{file} is damaged: {_in_words(error)}. {remedy}") from error
    except (ValueError, KeyError) as error:
        raise ForeignFile(f"{file} is damaged: {error.args[0]}. {remedy}") from None


def expect(arrays: Mapping[str, Array], name: str, shape: tuple[int | None, ...], types: tuple[type, ...] = (np.float64,)) -> Array:
    """Return the array of finite numbers of one of these types and of this shape, in which None stands for any length.

    Raises KeyError or ValueError, with a message, if there is no such array.
    """
    if name not in arrays:
        raise KeyError(f"it has no array '{name}'")
    array = arrays[name]
    fits = array.ndim == len(shape) and all(want in (None, got) for want, got in zip(shape, array.shape, strict=True))
    if array.dtype not in types or not fits or not np.isfinite(array).all():
        expected = f"{' or '.join(one.__name__ for one in types)} of shape {shape}".replace("None", "any")
        raise ValueError(f"the array '{name}' is {array.dtype} of shape {array.shape}; expected finite {expected}")
    return array


def _unpacked(path: Path, only_header: bool) -> tuple[str, str, dict[str, Array]]:
    """Return header, digest and arrays of the file."""
    named = arrays_of(path, lambda name: name in ("header", "digest") or (name.startswith(ARRAY) and not only_header))
    text, digest = str(named.pop("header")), str(named.pop("digest"))
    return text, digest, {name.removeprefix(ARRAY): array for name, array in named.items()}


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


def _in_words(error: ValidationError, most: int = 3) -> str:
    """Return the first few faults of a record, and the number of the others."""
    found = [
        f"{'.'.join(map(str, one['loc'])) or 'it'}: {one['msg']}" for one in error.errors(include_input=False, include_url=False)
    ]
    return "; ".join(found[:most]) + (f"; and {len(found) - most} more" if len(found) > most else "")
