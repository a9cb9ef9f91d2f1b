"""Stores: files .npz of a header and arrays, each whole or absent, checked by a schema; and folders of files with one writer."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError

from ..arguments import Array
from ..npz import arrays_of
from ..system.signature import Fingerprint, Signature
from .files import ForeignFile, replacing
from .one_writer import OneWriter


class Record(BaseModel):
    """Entries of a file: exactly these names, of these types, with finite numbers."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)


class Header(Record):
    """Entries of the header of each file: its format, and the problem of its results."""

    format: str
    version: int
    problem: Signature


OfHeader = TypeVar("OfHeader", bound=Header)

#: Prefix of the names of arrays in a file.
ARRAY = "array "


class Store(Generic[OfHeader]):
    """Files of one format. Each subclass declares the format, the schema of its headers, and the remedy for unreadable files."""

    known: ClassVar[tuple[str, int]]  # format and version
    remedy: ClassVar[str]
    schema: type[OfHeader]

    @classmethod
    def write_file(cls, file: Path, problem: Fingerprint, about: Mapping[str, Any], arrays: Mapping[str, Array]) -> None:
        """Replace a file; `about` is the rest of its header."""
        header = {"format": cls.known[0], "version": cls.known[1], **about, "problem": vars(problem.signature)}
        write_archive(file, header, arrays)

    @classmethod
    def read_file(cls, file: Path) -> tuple[OfHeader, dict[str, Array]]:
        """Return header and arrays of a file; raise ForeignFile if it is not one of this format."""
        return read_archive(file, cls.schema, cls.known, cls.remedy)


class FolderStore(Store[OfHeader], OneWriter):
    """Folder of files, from which a later run continues. It is used in a `with` block, during which no other process can write.

    `folder` is writable, see `output_folder`. Each file has the signature of its problem.
    """

    problem: Fingerprint
    name: ClassVar[str]  # of a file, such as "state_{:05d}.npz" with a number

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.folder = folder

    def existing(self) -> list[Path]:
        """Return the existing files in ascending order."""
        return sorted(self.folder.glob(pattern(self.name)))

    def numbered(self, number: int) -> Path:
        """Return the path of the file of a number."""
        return self.folder / self.name.format(number)

    def read_own(self, file: Path, remedy: str) -> tuple[OfHeader, dict[str, Array]]:
        """Return header and arrays of a file; refuse one of another problem with the remedy."""
        header, arrays = self.read_file(file)
        self.problem.refuse_other(header.problem, file, remedy)
        return header, arrays

    def refuse_to_replace(self, file: Path) -> None:
        """Refuse to replace a file of another problem, or of another format."""
        remedy = "Choose another folder, or replace it with overwrite=True."
        header, _ = read_archive(file, self.schema, self.known, remedy, only_header=True)
        self.problem.refuse_other(header.problem, file, remedy)


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
    packed = {"header": np.array(text), "digest": np.array(_digest(text, arrays))}
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
        if not only_header and digest != _digest(text, arrays):
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


def _digest(header: str, arrays: Mapping[str, Array]) -> str:
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
