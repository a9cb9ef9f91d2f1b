"""One writer at a time for a folder or a series of files."""

from __future__ import annotations

import errno
import json
import os
import socket
import time
import warnings
from contextlib import suppress
from pathlib import Path
from weakref import WeakSet

from filelock import FileLock, SoftFileLock, Timeout

from ..errors import StvkError, warn
from .files import content_of

#: What systems say where a disk has no locks, such as some network disks.
NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOTSUP)


class OneWriter:
    """The right to write a folder, or a file and what belongs to it, while a `with` block lasts.

    It is a lock on `.lock` in the folder, or on `.NAME.lock` beside the file, by the real path of the folder. It ends with the
    process that holds it, however that ends; forked children do not hold it. Who holds it is said in `.writer` or `.NAME.writer`.
    Another writer is refused by `with`. Where the disk has no locks, which is warned of, two writers are not noticed.
    """

    def __init__(self, path: Path) -> None:
        self.path, folder = path, path.is_dir()
        place = Path(os.path.realpath(path if folder else path.parent))
        name = "." if folder else f".{path.name}."
        self._lock_path, self._holder = place / f"{name}lock", place / f"{name}writer"
        self._lock: FileLock | None = None
        self._process = 0

    @property
    def held(self) -> bool:
        """Whether this process may write."""
        return self._process == os.getpid()

    def __enter__(self) -> OneWriter:
        self._lock = FileLock(self._lock_path, thread_local=False)
        try:
            self._process = os.getpid()
            if self._acquire(self._lock):
                _HELD.add(self)
                with suppress(OSError):  # it is a courtesy: the lock is what counts
                    self._holder.unlink(missing_ok=True)  # a symbolic link would have its target overwritten
                    now = time.strftime("%Y-%m-%d %H:%M:%S")
                    self._holder.write_text(json.dumps({"host": socket.gethostname(), "process": os.getpid(), "since": now}))
            return self
        except BaseException:
            self.__exit__(None, None, None)
            raise

    def __exit__(self, *error: object) -> None:
        try:
            self._release()
        finally:
            self._release()  # again, where Ctrl-C has interrupted it

    def _release(self) -> None:
        if self.held and self._lock is not None and self._lock.is_locked:
            for file in (self._holder, self._lock_path):  # while the lock is held: whoever comes next makes a new one
                with suppress(OSError):
                    file.unlink()
            self._lock.release(force=True)
        self._lock, self._process = None, 0

    def _acquire(self, lock: FileLock) -> bool:
        """Whether there is a lock, and it is held now; False where there are none."""
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # of filelock, where there are none
                lock.acquire(blocking=False)
        except Timeout:
            if _can_lock(self._lock_path.with_name(f"{self._lock_path.name}.{os.getpid()}")):
                remedy = "Wait until that has ended, or name another."
                raise StvkError(f"{self.path} is being written by {self._named()}. {remedy}") from None
        except NotImplementedError:
            pass
        except OSError as error:
            if error.errno not in NO_LOCKS:
                remedy = "Choose another folder, or change its permissions."
                raise StvkError(f"{self.path} cannot be locked: {error.strerror}. {remedy}") from error
        else:
            if not isinstance(lock, SoftFileLock):
                return True
            lock.release()
        warn(f"The disk of {self.path} has no locks: see to it that no other run writes there at the same time.")
        return False

    def _named(self) -> str:
        """The holder, as far as it has said who it is."""
        try:
            holder = json.loads(content_of(self._holder, 600))
            here = holder["process"] == os.getpid() and holder["host"] == socket.gethostname()
            process = "another run in this process" if here else f"process {int(holder['process'])} on {str(holder['host'])[:99]!r}"
            return f"{process} since {str(holder['since'])[:20]}"
        except (OSError, ValueError, KeyError, TypeError):
            return "another process"

    def _forget(self) -> None:
        """Let a forked child close its copy of the lock, without opening that of its parent."""
        context = getattr(self._lock, "_context", None)
        descriptor = getattr(context, "lock_file_fd", None)
        if context is not None and isinstance(descriptor, int):  # older releases of filelock; newer ones have closed it
            context.lock_file_fd = None
            with suppress(OSError):
                os.close(descriptor)


def _can_lock(probe: Path) -> bool:
    """Whether a lock that nobody else asks for can be had: older releases of filelock do not say why they fail."""
    lock = FileLock(probe, thread_local=False)
    try:
        lock.acquire(blocking=False)
        lock.release()
    except Timeout:
        return False
    finally:
        probe.unlink(missing_ok=True)
    return True


_HELD: WeakSet[OneWriter] = WeakSet()


def _forget_all() -> None:
    for writer in list(_HELD):
        writer._forget()
    _HELD.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_all)
