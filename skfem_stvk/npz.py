"""Arrays and numbers in files: NPZ files from untrusted sources, and the types of the fields of records in them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import IO, Annotated, Any, TypeAlias
from zipfile import ZipFile

import numpy as np
from numpy.typing import NDArray

from .arguments import Array
from .errors import StvkError


class NotArrays(StvkError):
    """Fault of an NPZ file; the message is a clause that follows the file name."""


def arrays_of(file: Path | IO[bytes], wanted: Callable[[str], bool] = lambda name: True, largest: int = 0) -> dict[str, Array]:
    """Return the requested arrays by name. The memory of each array is limited by its size in the file.

    Parameters
    ----------
    file
        Path of a regular file, or a binary stream with its content.
    wanted
        Function that returns whether to read the array of a name; it may raise a StvkError.
    largest
        Limit on the bytes of an array in a compressed file. By default compressed files are refused, because a small one may unpack
        to a large one.

    Raises
    ------
    NotArrays
        if the file is damaged, is not an NPZ file, or declares more numbers than it holds.

    Examples
    --------
    >>> import io
    >>> content = io.BytesIO()
    >>> np.savez(content, u=np.ones(2))
    >>> arrays_of(content)
    {'u': array([1., 1.])}
    >>> arrays_of(io.BytesIO(b"hello"))
    Traceback (most recent call last):
    skfem_stvk.npz.NotArrays: it is not a complete .npz file (BadZipFile: File is not a zip file)
    """
    if isinstance(file, Path) and not file.is_file():
        raise NotArrays("it is missing or not a regular file")
    try:
        with ZipFile(file) as archive:
            return {
                name: _array(archive, member, largest)
                for member in archive.infolist()
                if wanted(name := member.filename.removesuffix(".npy"))
            }
    except StvkError:
        raise
    except Exception as error:  # zipfile, its decoders, NumPy and Python's tokenizer raise many types for damaged bytes
        raise NotArrays(f"it is not a complete .npz file ({type(error).__name__}: {error})") from error


def _array(archive: ZipFile, member: Any, largest: int) -> Array:
    """Return one array, after its declared size was compared with the size of its archive member."""
    if member.file_size != member.compress_size and member.file_size > largest:
        raise NotArrays(
            f"{member.filename} is compressed, and unpacks to {member.file_size} bytes; expected at most {largest}"
            if largest
            else f"{member.filename} is compressed; expected arrays as np.savez writes them"
        )
    with archive.open(member) as content:
        if _declared(content) > member.file_size:
            raise NotArrays(f"{member.filename} declares more numbers than there are")
    with archive.open(member) as content:
        return np.lib.format.read_array(content, allow_pickle=False)


def _declared(content: IO[bytes]) -> int:
    """Return the bytes of the array at the position of the stream, according to its header in NumPy's format."""
    old = np.lib.format.read_magic(content) == (1, 0)
    shape, _, dtype = (np.lib.format.read_array_header_1_0 if old else np.lib.format.read_array_header_2_0)(content)
    return prod(shape) * int(dtype.itemsize)


@dataclass(frozen=True)
class Within:
    """Bounds of a number in the file of a record. It is finite, unless `finite` is False."""

    least: float | None = None
    most: float | None = None
    finite: bool = True

    def __get_pydantic_core_schema__(self, source: Any, handler: Callable[[Any], dict[str, Any]]) -> dict[str, Any]:
        limits = {"ge": self.least, "le": self.most, "allow_inf_nan": None if self.finite else True}
        return handler(source) | {name: limit for name, limit in limits.items() if limit is not None}


@dataclass(frozen=True)
class Stored:
    """Type of an array in the file of a record.

    It has `ndim` axes (None for any number) and entries of one of the `types`, which are finite, unless `finite` is False. With
    `by_dof`, its last axis has one entry for each degree of freedom. The file of the record has the name of the array in its place.
    """

    ndim: int | None
    types: tuple[type, ...] = (np.float64,)
    finite: bool = True
    by_dof: bool = False

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        from pydantic_core import core_schema  # imported only for files

        return core_schema.with_info_plain_validator_function(lambda name, info: info.context(name, self))

    def check(self, name: str, array: Array) -> None:
        """Raise ValueError, with a message, if an array is not of this type."""
        if array.dtype in self.types and self.ndim in (None, array.ndim) and not (self.finite and not np.isfinite(array).all()):
            return
        axes = "" if self.ndim is None else f" with {self.ndim} axes"
        expected = f"{'finite ' * self.finite}{' or '.join(one.__name__ for one in self.types)}{axes}"
        raise ValueError(f"the array '{name}' is {array.dtype} of shape {array.shape}; expected {expected}")


#: Number of things in the file of a record, and a measured value, which may be infinite or NaN.
Count: TypeAlias = Annotated[int, Within(0)]
Measured: TypeAlias = Annotated[float, Within(finite=False)]
#: Vector (ndofs,) and vectors (n, ndofs) of the space of a body in the file of a record, numbers (n,), and ids (n,).
Vector: TypeAlias = Annotated[Array, Stored(1, by_dof=True)]
Vectors: TypeAlias = Annotated[Array, Stored(2, by_dof=True)]
Numbers: TypeAlias = Annotated[Array, Stored(1)]
Ids: TypeAlias = Annotated[NDArray[np.int64], Stored(1, (np.int64,))]
