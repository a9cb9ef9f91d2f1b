"""Files that are complete or absent: written under a temporary name, flushed to the disk, and renamed; by one writer at a time."""

from __future__ import annotations

import errno
import json
import os
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, TypeVar, cast

from .. import arguments
from ..errors import StvkError, warn
from ..space import ONE_PROCESS, Communicator

Result = TypeVar("Result")
Entered = TypeVar("Entered", bound="OneWriter")

#: Error numbers by which systems report that a disk has no locks, such as some network disks.
NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOTSUP)


class WriteError(StvkError, OSError):
    """Error for a file that could not be written, for example because the disk is full. An earlier file still exists."""


class ForeignFile(StvkError):
    """Error for a file that is not of the expected format."""


def output_path(path: str | os.PathLike[str], *suffixes: str) -> Path:
    """Return the path if it is writable and has one of the suffixes; call this before expensive work.

    >>> output_path("missing/bracket.vtu", ".vtu")
    Traceback (most recent call last):
    skfem_stvk.errors.StvkError: The folder missing of bracket.vtu does not exist. Create it first, or correct the path.
    """
    path = arguments.path("path", path, f"the path of a file that ends in {' or '.join(suffixes)}")
    if path.suffix.lower() not in suffixes:
        named = path.with_suffix(suffixes[0]).name if path.name else f"result{suffixes[0]}"
        raise StvkError(
            f"path = {arguments.shown(str(path))}; expected a path that ends in {' or '.join(suffixes)}, such as {named}."
        )
    if not path.name.isprintable():
        raise StvkError(
            f"{ascii(path.name)[:200]} contains characters that cannot be printed or stored in lists of files. Rename it."
        )
    if not path.parent.is_dir():
        raise StvkError(f"The folder {path.parent} of {path.name} does not exist. Create it first, or correct the path.")
    if path.exists() and not path.is_file():
        raise StvkError(f"{path} is {'a folder' if path.is_dir() else 'not a regular file'}; expected the path of a file.")
    try:
        try_to_write(path.parent, f".{path.name}.part")
    except OSError as error:
        raise StvkError(f"{path} cannot be written: {error.strerror}. Choose another folder, or change its permissions.") from error
    return path


def content_of(path: Path, largest: int) -> bytes:
    """Return the content of a regular file of at most `largest` bytes; raise an OSError for a larger one, a pipe or a device."""
    if path.exists() and not path.is_file():
        raise OSError(errno.EINVAL, "it is not a regular file")
    with path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        if size > largest:
            raise OSError(errno.EFBIG, f"it has more than {largest} bytes")
        return file.read(size)  # a read of `largest` bytes would allocate as many


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path next to `path`; it is renamed to `path` at the end, or removed on an error.

    A reader of `path` finds the old file or the new one, never a part of it, even if the program is killed. A killed program leaves
    `.NAME.part`, which the next writer removes. If the file cannot be written, a WriteError states the remedy. If `path` or
    `.NAME.part` is a symbolic link, its target is not changed.
    """
    part = path.with_name(f".{path.name}.part")
    try:
        part.unlink(missing_ok=True)
        yield part
        with part.open("rb") as file:
            os.fsync(file.fileno())
        os.replace(part, path)
    except BaseException as error:
        with suppress(OSError):
            part.unlink()
        if isinstance(error, OSError) and not isinstance(error, StvkError):
            raise cannot_write(path, error) from error
        raise
    _sync_folder(path.parent)


def cannot_write(path: Path, error: OSError) -> WriteError:
    """Return the error for a file that could not be written, with the system's error number."""
    if isinstance(error, WriteError) and isinstance(error.__cause__, OSError):
        error = error.__cause__
    why = error.strerror or str(error) or type(error).__name__
    failure = WriteError(
        f"{path} could not be written: {why}. Its previous content is unchanged. Free disk space, or choose another folder."
    )
    failure.errno = error.errno
    return failure


def try_to_write(folder: Path, name: str = "") -> None:
    """Raise the OSError that writing a file of this name to the folder would raise.

    The test file has no name, so that nothing is left if the program is killed.
    """
    with suppress(FileNotFoundError):
        (folder / name).lstat()  # a name may be too long
    with TemporaryFile(dir=folder):
        pass


@contextmanager
def in_all_parts(comm: Communicator) -> Iterator[None]:
    """Raise the error of the first part of a divided body whose block raises one, in all parts.

    The block is for one part: it does not combine results.
    """
    raised: Exception | None = None
    try:
        yield
    except Exception as error:
        raised = error
    errors = comm.each(None if raised is None else (isinstance(raised, OSError), str(raised)))
    first = next((rank for rank, error in enumerate(errors) if error is not None), None)
    if first == comm.rank and raised is not None:
        raise raised
    if first is not None:
        disk, text = cast(tuple[bool, str], errors[first])
        raise (WriteError if disk else StvkError)(text) from raised


def of_leader(comm: Communicator, work: Callable[[], Result]) -> Result:
    """Return `work()` of the leading part of a divided body, in all parts, or raise its error in all of them.

    The leading part is the only one that writes files which all parts share, and the one to read them while they change.
    """
    found: Result | None = None
    with in_all_parts(comm):
        if comm.leads:
            found = work()
    return cast(Result, comm.each(found)[0])


def _sync_folder(folder: Path) -> None:
    """Flush the new name to the disk too, where the system can do this for folders (not on Windows)."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def output_folder(path: Path) -> Path:
    """Return the path as a writable folder, which is made if it is missing; call this before expensive work."""
    try:
        path.mkdir(exist_ok=True)
        try_to_write(path)
    except OSError as error:
        raise StvkError(
            f"The checkpoint {path} cannot be written: {error.strerror}. Its parent must be an existing folder."
        ) from error
    return path


class OneWriter:
    """Exclusive right to write a folder, or a file and the files that belong to it, during a `with` block.

    The right is a lock on `.lock` in the folder, or on `.NAME.lock` next to the file, by the real path of the folder. The lock ends
    with the process that holds it, in any case; forked children do not hold it. The holder writes its name to `.writer` or
    `.NAME.writer`. `with` refuses another writer. On a disk without locks, two writers are not detected, and a warning says so.

    In a divided body, whose parts communicate by `comm`, the leading part has the lock for all parts.
    """

    def __init__(self, path: Path, comm: Communicator = ONE_PROCESS) -> None:
        self.path, self.comm = path, comm
        self._lock: Any = None  # of filelock
        self._process = 0

    def opened(self) -> None:
        """Read the existing files, if a subclass needs them: no other process can write now."""

    @property
    def held(self) -> bool:
        """Whether this process may write."""
        return self._process == os.getpid()

    def __enter__(self: Entered) -> Entered:
        try:
            with in_all_parts(self.comm):
                if self.comm.leads:
                    self._acquire()
            self._process = os.getpid()
            self.opened()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *error: object) -> None:
        try:
            self._release()
        finally:
            self._release()  # again, if Ctrl-C interrupted it

    def _acquire(self) -> None:
        """Lock the path, and name the holder."""
        from filelock import FileLock, Timeout  # imported only for writing

        path = self.path
        folder, name = Path(os.path.realpath(path if path.is_dir() else path.parent)), "." if path.is_dir() else f".{path.name}."
        self._holder_file, self._file = folder / f"{name}writer", folder / f"{name}lock"
        self._lock = FileLock(self._file, thread_local=False, fallback_to_soft=False)
        try:
            self._lock.acquire(blocking=False)
            self._process = os.getpid()
            with suppress(OSError):  # only the lock decides
                self._holder_file.unlink(missing_ok=True)  # a symbolic link would have its target overwritten
                now = time.strftime("%Y-%m-%d %H:%M:%S")
                self._holder_file.write_text(json.dumps({"host": socket.gethostname(), "process": os.getpid(), "since": now}))
        except Timeout:
            remedy = "Wait until it has ended, or choose another path."
            raise StvkError(f"{path} is being written by {self._holder()}. {remedy}") from None
        except OSError as error:
            if error.errno not in NO_LOCKS:
                remedy = "Choose another folder, or change its permissions."
                raise StvkError(f"{path} cannot be locked: {error.strerror}. {remedy}") from error
            warn(f"The disk of {path} has no locks. Make sure that no other run writes there at the same time.")
            self._process = os.getpid()

    def _release(self) -> None:
        if self._lock is not None and (self.held or self._lock.is_locked):
            for file in (self._holder_file, self._file):  # while the lock is held: the next writer makes a new one
                with suppress(OSError):
                    file.unlink()
            self._lock.release(force=True)
        self._process = 0

    def _holder(self) -> str:
        """Return the name of the holder, as far as it has written it."""
        try:
            holder = json.loads(content_of(self._holder_file, 600))
            same_process = holder["process"] == os.getpid() and holder["host"] == socket.gethostname()
            process = (
                "another run in this process"
                if same_process
                else f"process {int(holder['process'])} on {str(holder['host'])[:99]!r}"
            )
            return f"{process} since {str(holder['since'])[:20]}"
        except (OSError, ValueError, KeyError, TypeError):
            return "another process"
