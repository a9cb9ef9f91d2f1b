"""A process of another Python that answers questions, one after the other, with only this package's files and NumPy.

Questions and answers are NPZ files in pipes. Each is preceded by its length in eight bytes. A question that the process cannot
answer, because it ends or takes too long, raises `NoAnswer`. When the process ends, all processes that it has started are ended,
because they may keep the pipes open.
"""

from __future__ import annotations

import io
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Event, Thread, Timer
from typing import IO, Any, TypeVar

import numpy as np

from ...arguments import Array
from ...npz import NotArrays, arrays_of

Self = TypeVar("Self", bound="AnsweringProcess")

#: Program of the process. It loads the files of this package from their location here. Its arguments are this location, the module
#: whose `serve` answers the questions, and further folders in which modules are found.
START = """
import importlib, importlib.util, sys
folder, module, *folders = sys.argv[1:]
sys.path += folders
spec = importlib.util.spec_from_file_location("skfem_stvk", folder + "/__init__.py", submodule_search_locations=[folder])
package = sys.modules["skfem_stvk"] = importlib.util.module_from_spec(spec)
spec.loader.exec_module(package)
importlib.import_module("skfem_stvk.referee.peers." + module).serve()
"""
#: Seconds that the process has to end by itself after the last question.
PATIENCE = 5.0
#: Largest size of a question or answer, and size that is read at once [bytes].
LONGEST, PIECE = 2**33, 2**20
#: Size of the end of the output that is kept [bytes].
KEPT = 2**16


class NoAnswer(Exception):
    """Error of a process that has ended, or was ended because it took too long. The message is a clause on the process.

    `too_long` is whether it took too long.
    """

    def __init__(self, clause: str, too_long: bool = False) -> None:
        super().__init__(clause)
        self.too_long = too_long


class AnsweringProcess:
    """Process of another Python that answers questions. Call `close` after use, or use it in a `with` statement.

    Parameters
    ----------
    python
        Path of the Python, 3.10 or later.
    module
        Module of this folder whose `serve` answers the questions.
    folders
        Folders in which the process finds modules, in addition to its own.
    environment
        Environment variables, by default those of this process.

    Raises
    ------
    OSError
        if the Python cannot be run.
    """

    def __init__(self, python: str, module: str, folders: Sequence[str] = (), environment: dict[str, str] | None = None) -> None:
        command = [python, "-I", "-B", "-c", START, str(Path(__file__).parents[2]), module, *folders]
        pipes: dict[str, Any] = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
        self._process = subprocess.Popen(command, env=environment, start_new_session=True, **pipes)
        self._said = b""
        self._listener = Thread(target=self._listen, daemon=True)
        self._listener.start()
        Thread(target=self._end_the_group, daemon=True).start()

    def __enter__(self: Self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """End the process."""
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with suppress(OSError), _broken_pipes_raise():  # unsent data of a process that has ended
                    pipe.close()
        try:
            self._process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._listener.join(PATIENCE)

    def _end_the_group(self) -> None:
        """Wait until the process has ended, and end the processes that it has started."""
        self._process.wait()
        if hasattr(os, "killpg"):
            with suppress(OSError):  # none of them runs
                os.killpg(self._process.pid, signal.SIGKILL)

    def _listen(self) -> None:
        """Read the output of the process, and keep its end."""
        output: Any = self._process.stderr
        with output:
            while piece := output.read1(KEPT):
                self._said = (self._said + piece)[-KEPT:]

    def ask(self, question: dict[str, Array], seconds: float, longest: int = LONGEST) -> dict[str, Array]:
        """Return the answer, of at most `longest` bytes and within `seconds`.

        Raises
        ------
        NoAnswer
            if the process has ended or is too slow. Then it does not run any more.
        NotArrays
            if the answer is invalid.
        """
        assert self._process.stdin is not None and self._process.stdout is not None
        too_long = Event()

        def end_it() -> None:
            too_long.set()
            self._process.kill()

        limit = Timer(seconds, end_it)
        limit.daemon = True
        limit.start()
        try:
            with suppress(OSError), _broken_pipes_raise():  # a process that has ended may have left an answer
                _send(self._process.stdin, question)
            answer = _receive(self._process.stdout, longest)
        finally:
            limit.cancel()
        if answer is not None:
            return answer
        if too_long.is_set():
            raise NoAnswer(f"gave no answer within {seconds:g} s, and was ended", too_long=True)
        end = _end(self._process.wait())
        self._listener.join(PATIENCE)
        last_words = " ".join(self._said.decode("utf-8", "replace").split())[-500:] or "it printed nothing"
        raise NoAnswer(f"has ended, with {end}: {last_words}")


def answer_questions(answer_to: Callable[[dict[str, Array]], dict[str, Array]]) -> None:
    """Answer the questions on standard input until it ends. Other output goes to standard error.

    An exception of `answer_to` becomes the answer `error`.
    """
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    while (question := _receive(sys.stdin.buffer)) is not None:
        try:
            answer = answer_to(question)
        except Exception as error:
            answer = {"error": np.array(f"{type(error).__name__}: {str(error)[:500]}")}
        _send(answers, answer)


def _end(code: int) -> str:
    """Return in words how a process ended: its exit code, or the signal that ended it."""
    try:
        return signal.Signals(-code).name
    except ValueError:
        return f"exit code {code}"


@contextmanager
def _broken_pipes_raise() -> Iterator[None]:
    """Block SIGPIPE, so that writing to a process that has ended raises an OSError.

    Otherwise SIGPIPE may end this process, for example after Gmsh's `initialize`.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGPIPE})
    try:
        yield
    finally:
        if signal.SIGPIPE not in before and signal.SIGPIPE in signal.sigpending():
            signal.sigwait({signal.SIGPIPE})
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _send(pipe: IO[bytes], arrays: dict[str, Array]) -> None:
    file = io.BytesIO()
    named: dict[str, Any] = dict(arrays)
    np.savez(file, **named)
    content = file.getvalue()
    pipe.write(len(content).to_bytes(8, "big"))
    pipe.write(content)
    pipe.flush()


def _receive(pipe: IO[bytes], longest: int = LONGEST) -> dict[str, Array] | None:
    """Return the received arrays, or None if the pipe ends too early. The memory is limited by the number of bytes sent.

    Raise NotArrays if the announced length exceeds `longest`.
    """
    head = pipe.read(8)
    length = int.from_bytes(head, "big")
    if length > longest:
        raise NotArrays(f"an answer of {length} bytes; expected at most {longest}")
    content = io.BytesIO()
    while content.tell() < length and (piece := pipe.read(min(PIECE, length - content.tell()))):
        content.write(piece)
    if len(head) < 8 or content.tell() < length:
        return None
    return arrays_of(content)
