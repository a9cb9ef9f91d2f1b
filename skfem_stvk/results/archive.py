"""Archives: arrays with a header in one .npz file, whole or not there, checked by a schema; and checkpoints made of them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
from pydantic import ValidationError

from ..arguments import Array
from ..npz import arrays_of
from ..system.records import Record, Signature, in_words
from ..system.signature import Fingerprint
from .files import NotOurs, output_folder, replacing
from .one_writer import OneWriter

Header = TypeVar("Header", bound="ArchiveHeader")
ProblemHeader = TypeVar("ProblemHeader", bound="CheckpointHeader")
Opened = TypeVar("Opened", bound="Checkpoint[Any]")

#: Before the names of arrays, so that no name is taken for another thing.
ARRAY = "array "


class ArchiveHeader(Record):
    """Entries of each header, by which a file is known as one of ours."""

    format: str
    version: int


class CheckpointHeader(ArchiveHeader):
    """Entries of the header of each file of a checkpoint: also of which problem it is."""

    problem: Signature


def write_archive(path: Path, header: Mapping[str, Any], arrays: Mapping[str, Array]) -> None:
    """Replace the file, as `replacing` does."""
    text = json.dumps(header)
    packed = {"header": np.array(text), "digest": np.array(_digest(text, arrays))}
    packed |= {ARRAY + name: array for name, array in arrays.items()}
    with replacing(path) as part, part.open("wb") as file:
        np.savez(file, **packed)  # type: ignore[arg-type]


class Checkpoint(Generic[ProblemHeader]):
    """Archives in a folder, from which a later run goes on. It is used in a `with` block, during which nobody else can write them.

    The folder is made if it is not there; its parent must be. Each file carries the signature of its problem.
    """

    known: ClassVar[tuple[str, int]]  # format and version
    remedy: ClassVar[str]  # what to do with a file that cannot be read
    schema: type[ProblemHeader]
    problem: Fingerprint

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._writer: OneWriter | None = None

    def writable(self) -> Path:
        """The folder, or a file, that nobody else is to write."""
        return output_folder(self.folder)

    def __enter__(self: Opened) -> Opened:
        try:
            self._writer = OneWriter(self.writable())
            self._writer.__enter__()
            self.opened()
            return self
        except BaseException:
            self.__exit__(None, None, None)
            raise

    def __exit__(self, *error: object) -> None:
        if self._writer is not None:
            self._writer.__exit__(*error)

    def opened(self) -> None:
        """Look at the files that are there: a subclass may."""

    def write_file(self, file: Path, about: Mapping[str, Any], arrays: Mapping[str, Array]) -> None:
        """Replace a file; `about` is what its header has beside the format and the problem."""
        header = {"format": self.known[0], "version": self.known[1], **about, "problem": self.problem.signature.model_dump()}
        write_archive(file, header, arrays)

    @classmethod
    def read_file(cls, file: Path) -> tuple[ProblemHeader, dict[str, Array]]:
        """Header and arrays of a file."""
        return read_archive(file, cls.schema, cls.known, cls.remedy)

    def refuse_to_replace(self, file: Path) -> None:
        """Refuse to replace a file that is of another problem, or none of ours."""
        remedy = "Name another folder, or replace it with overwrite=True."
        header, _ = read_archive(file, self.schema, self.known, remedy, only_header=True)
        self.problem.refuse_other(header.problem, file, remedy)


def read_archive(
    path: Path, schema: type[Header], known: tuple[str, int], remedy: str, only_header: bool = False
) -> tuple[Header, dict[str, Array]]:
    """Header and arrays of a file of the `known` format and version; without arrays if `only_header`.

    NotOurs, with the remedy, is raised if it is incomplete, was not written here or says what cannot be.
    """
    try:
        text, digest, arrays = _unpacked(path, only_header)
        header = json.loads(text)
        _check_known(header, known)
        if not only_header and digest != _digest(text, arrays):
            raise NotOurs("was changed after it was written.")
    except NotOurs as error:
        raise NotOurs(f"{path} {error} {remedy}") from None
    except (OSError, ValueError, KeyError, TypeError, MemoryError, RuntimeError) as error:
        why = f"it is incomplete, or was not written here ({type(error).__name__}: {error})"
        raise NotOurs(f"{path} cannot be read as a {known[0]}: {why}. {remedy}") from error
    try:
        return schema.model_validate(header), arrays
    except ValidationError as error:
        raise NotOurs(f"{path} is damaged: {in_words(error)}. {remedy}") from error


def _unpacked(path: Path, only_header: bool) -> tuple[str, str, dict[str, Array]]:
    """Header, digest and arrays as they stand in the file."""
    named = arrays_of(path, lambda name: name in ("header", "digest") or (name.startswith(ARRAY) and not only_header))
    text, digest = str(named.pop("header")), str(named.pop("digest"))
    return text, digest, {name.removeprefix(ARRAY): array for name, array in named.items()}


def _digest(header: str, arrays: Mapping[str, Array]) -> str:
    """A digest of header and arrays, by which it is noticed that one of them has changed."""
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
        raise NotOurs(
            f"is of version {header.get('version')!r} of the format '{kind}'; this release reads version {version}: resume it "
            "with the release that wrote it."
        )


def finite(arrays: Mapping[str, Array], name: str, shape: tuple[int, ...]) -> Array:
    """An array of finite numbers in double precision; raises KeyError or ValueError in words if it is none of this shape."""
    if name not in arrays:
        raise KeyError(f"it has no array '{name}'")
    array = arrays[name]
    if array.dtype != np.float64 or array.shape != shape or not np.isfinite(array).all():
        raise ValueError(f"the array '{name}' is {array.dtype} of shape {array.shape}; expected finite float64 of shape {shape}")
    return array
