"""Reading of NPZ files from untrusted sources: their arrays, or an error message."""

from __future__ import annotations

from collections.abc import Callable
from math import prod
from pathlib import Path
from typing import IO, Any
from zipfile import ZipFile

import numpy as np

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
