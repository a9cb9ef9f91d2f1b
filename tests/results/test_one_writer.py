"""A folder or a series has one writer, and its lock ends with its process."""

import errno
import json
import os
import signal
import socket
import threading
from pathlib import Path

import pytest

from skfem_stvk import StvkError, StvkWarning
from skfem_stvk.results.complete_files import OneWriter

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="no forks")


class Holder:
    """Process that holds the lock of `path` until its end, and that may have a child process."""

    def __init__(self, path, forks=False):
        there, self._end = os.pipe()
        heard, here = os.pipe()
        self.pid = os.fork()
        if not self.pid:
            os.close(self._end)
            with OneWriter(path):
                child = os.fork() if forks else 0
                if child or not forks:
                    os.write(here, f"{child}\n".encode())
                os.read(there, 1)
            os._exit(0)
        os.close(there)
        os.close(here)
        self.child = int(os.read(heard, 99))
        os.close(heard)

    def end(self, by=None):
        """Let the process end, or kill it."""
        if by is not None:
            os.kill(self.pid, by)
            os.waitpid(self.pid, 0)
        os.close(self._end)
        if by is None:
            os.waitpid(self.pid, 0)


def is_free(path):
    try:
        with OneWriter(path):
            return True
    except StvkError:
        return False


@pytest.fixture(params=["folder", "flag.pvd"])
def path(request, tmp_path):
    if request.param == "folder":
        (tmp_path / "folder").mkdir()
    return tmp_path / request.param


def test_a_second_writer_is_refused_with_the_name_of_the_first(path):
    holder = Holder(path)
    with pytest.raises(StvkError) as caught:
        OneWriter(path).__enter__()
    message = str(caught.value)
    assert (
        f"{path} is being written by process {holder.pid} on {socket.gethostname()!r} since 20" in message
        and "Wait until" in message
    )
    holder.end()
    assert is_free(path) and [file.name for file in path.parent.rglob("*")] == (["folder"] if path.is_dir() else [])


def test_a_second_writer_in_the_same_process_or_in_another_thread_is_refused(path):
    refused = []

    def other():
        with pytest.raises(StvkError, match=r"written by another run in this process since \d{4}-\d\d-\d\d \d\d:"):
            OneWriter(path).__enter__()
        refused.append(threading.get_ident())

    with OneWriter(path):
        other()
        thread = threading.Thread(target=other)
        thread.start()
        thread.join()
    assert len(set(refused)) == 2 and is_free(path)


def test_different_paths_to_one_file_have_one_lock(tmp_path, monkeypatch):
    (tmp_path / "folder").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "folder")
    monkeypatch.chdir(tmp_path)
    for one, other in ((tmp_path / "folder", Path("link")), (Path("folder/a.pvd"), tmp_path / "link" / "a.pvd")):
        with OneWriter(one):
            assert not is_free(other)
        assert is_free(other)
    with OneWriter(Path("folder/a.pvd")):
        assert is_free(Path("folder/b.pvd")) and is_free(Path("folder"))


@pytest.mark.parametrize("forked", [False, True])
def test_the_lock_ends_with_a_killed_process_even_if_a_child_is_alive(path, forked):
    holder = Holder(path, forks=forked)
    assert not is_free(path)
    holder.end(by=signal.SIGKILL)
    if forked:
        os.kill(holder.child, 0)  # the child is alive
    assert is_free(path)


def test_a_child_that_ends_does_not_end_the_lock_of_its_parent(path):
    with OneWriter(path) as writer:
        child = os.fork()
        if not child:
            code = 1
            try:
                code = int(writer.held)  # the copy in the child is not a lock
                writer.__exit__(None, None, None)
            finally:
                os._exit(code)
        assert os.waitpid(child, 0)[1] == 0
        other = os.fork()
        if not other:
            os._exit(int(is_free(path)))
        assert os.waitpid(other, 0)[1] == 0 and writer.held


@pytest.mark.parametrize("code", [errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP])
def test_a_disk_without_locks_gives_a_warning(path, code, monkeypatch):
    def refuse(*_):
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr("fcntl.flock", refuse)
    with pytest.warns(StvkWarning, match=r"has no locks. Make sure that no other run writes there"), OneWriter(path) as writer:
        assert writer.held


def test_damaged_files_of_the_lock_holder_do_no_harm(path):
    with OneWriter(path):
        note = path / ".writer" if path.is_dir() else path.with_name(f".{path.name}.writer")
        assert json.loads(note.read_text())["process"] == os.getpid()
        for text in ("", "[]", "{}", '{"process": "x", "host": 1, "since": []}', "\x00"):
            note.write_text(text)
            with pytest.raises(StvkError, match="is being written by another process"):
                OneWriter(path).__enter__()
