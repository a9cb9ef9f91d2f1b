"""One writer at a time for a folder or a series of files."""

from __future__ import annotations

import errno
import json
import os
import socket
import time
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

from ..errors import StvkError, warn
from ..space import ONE_PROCESS, Communicator
from .complete_files import content_of, in_all_parts

#: Error numbers by which systems report that a disk has no locks, such as some network disks.
NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOTSUP)

Entered = TypeVar("Entered", bound="OneWriter")


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
