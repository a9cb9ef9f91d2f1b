"""Peers in another environment, run by a process of another Python with only NumPy, SciPy and the peer's package.

Questions and answers are NPZ files in pipes. Each is preceded by its length in eight bytes.
"""

from __future__ import annotations

import io
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from threading import Event, Timer
from typing import IO, Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, issparse

from ..arguments import Array, shown
from ..arguments import path as checked_path
from ..errors import StvkError
from ..npz import NotArrays, arrays_of

Answer = TypeVar("Answer")

METHODS = ("energy", "internal_force", "tangent")
#: Program of the other Python. It loads the files of this package from their location here, and imports only the peers.
START = """
import importlib.util, sys
folder = sys.argv[1]
spec = importlib.util.spec_from_file_location("skfem_stvk", folder + "/__init__.py", submodule_search_locations=[folder])
package = sys.modules["skfem_stvk"] = importlib.util.module_from_spec(spec)
spec.loader.exec_module(package)
from skfem_stvk.peers.elsewhere import serve
serve()
"""
#: Seconds that the other process has to end by itself after the last question.
PATIENCE = 5.0
#: Seconds that the other process has for an answer. The first answer may include a compilation.
LONGEST_ANSWER = 600.0
#: Largest size of a question or answer, size of an answer in addition to 16 bytes per entry of a full K, and size that is read at
#: once [bytes].
LONGEST, OVERHEAD, PIECE = 2**33, 2**20, 2**20


class Elsewhere:
    """Peer whose package is installed in another environment. Call `close` after use, or use it in a `with` statement.

    Parameters
    ----------
    python
        Path of the other environment's Python, 3.10 or later.
    peer
        Name of the peer.
    p, t, young, poisson
        Arguments of `Peer`, as there.

    Attributes
    ----------
    name, version
        Name and version of the code.
    methods
        Names of its methods among `energy`, `internal_force` and `tangent`, which are methods of this object as well.

    Raises
    ------
    StvkError
        if there is no such Python, or it cannot make the peer. Methods raise it if the process ends or does not answer.
    """

    def __init__(self, python: str | Path, peer: str, p: Array, t: NDArray[np.int32], young: float, poisson: float) -> None:
        checked_path("python", python, "the path of another Python")
        self._python = str(python)
        self._longest = min(LONGEST, OVERHEAD + 16 * p.size**2)
        self._said: Any = tempfile.TemporaryFile()  # noqa: SIM115 - closed by `close`
        command = [self._python, "-I", "-B", "-c", START, str(Path(__file__).parent.parent)]
        try:
            self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._said)
        except OSError as error:
            self._said.close()
            raise StvkError(
                f"{shown(self._python)} cannot be run: {error.strerror}. Expected the path of another Python."
            ) from error
        try:
            question = {"peer": np.array(peer), "p": p, "t": t, "constants": np.array([young, poisson])}
            self.name, self.version, self.methods = self._ask(question, _introduced)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Elsewhere:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def __getattr__(self, name: str) -> Any:
        if name in METHODS and name in self.__dict__.get("methods", ()):
            return partial(self._called, name)
        raise AttributeError(f"{type(self).__name__} has no {name}")

    def close(self) -> None:
        """End the other process."""
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with suppress(OSError), _broken_pipes_raise():  # unsent data of a process that has ended
                    pipe.close()
        try:
            self._process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._said.close()

    def _called(self, method: str, u: Array) -> Any:
        return self._ask({"method": np.array(method), "u": u}, _value)

    def _ask(self, question: dict[str, Array], understood: Callable[[dict[str, Array]], Answer]) -> Answer:
        answer = self._answer(question)
        if "error" in answer:
            raise StvkError(f"{self._python}: {str(answer['error'])[:1000]}")
        try:
            return understood(answer)
        except (KeyError, ValueError, TypeError) as error:
            raise self._is_no_peer(error) from error

    def _answer(self, question: dict[str, Array]) -> dict[str, Array]:
        assert self._process.stdin is not None and self._process.stdout is not None
        too_long = Event()

        def end_it() -> None:
            too_long.set()
            self._process.kill()

        limit = Timer(LONGEST_ANSWER, end_it)
        limit.daemon = True
        limit.start()
        try:
            with _broken_pipes_raise():
                _send(self._process.stdin, question)
            answer = _receive(self._process.stdout, self._longest)
        except OSError:  # a broken pipe
            answer = None
        except NotArrays as error:
            raise self._is_no_peer(error) from error
        finally:
            limit.cancel()
        if answer is None and too_long.is_set():
            raise StvkError(
                f"The process of {self._python} gave no answer within {LONGEST_ANSWER:g} s, and was ended. Its peer hangs, or the "
                "mesh is too large for it: take a smaller one."
            )
        if answer is None:
            raise StvkError(f"The process of {self._python} has ended, with exit code {self._process.wait()}: {self._last_words()}")
        return answer

    def _is_no_peer(self, error: Exception) -> StvkError:
        return StvkError(
            f"The process of {self._python} gave an invalid answer ({shown(error)}). Check that it is a "
            "Python interpreter with this package."
        )

    def _last_words(self) -> str:
        self._said.seek(0)
        return " ".join(self._said.read()[-2000:].decode("utf-8", "replace").split())[-500:] or "it printed nothing"


def _introduced(answer: dict[str, Array]) -> tuple[str, str, list[str]]:
    """Return name, version and methods of the new peer."""
    return str(answer["name"]), str(answer["version"]), [name for name in METHODS if name in answer["methods"].tolist()]


def _value(answer: dict[str, Array]) -> Any:
    """Return the energy, force or matrix of an answer. The matrix is validated, because compiled routines do not check it."""
    if "indptr" not in answer:
        return answer["value"]
    rows = answer["indptr"]
    K = csr_matrix((answer["data"], answer["indices"], rows), shape=tuple(answer["shape"].tolist()))
    if (np.diff(rows) < 0).any():  # `check_format` checks no rows if the last row pointer is 0
        raise ValueError("the row pointers of its matrix decrease")
    K.check_format(full_check=True)
    return K


def serve() -> None:
    """Answer the questions on standard input until it ends. Output that the peer prints goes to standard error."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    model: Any = None
    while (question := _receive(sys.stdin.buffer)) is not None:
        try:
            if model is None:
                model, answer = _made(question)
            else:
                answer = _answer(getattr(model, str(question["method"]))(question["u"]))
        except Exception as error:
            answer = {"error": np.array(f"{type(error).__name__}: {str(error)[:500]}")}
        _send(answers, answer)


def _made(question: dict[str, Array]) -> tuple[Any, dict[str, Array]]:
    from . import PEERS, load

    name = str(question["peer"])
    options = {"any_version": True} if PEERS[name].least else {}
    young, poisson = question["constants"].tolist()
    model: Any = load(name)(question["p"], question["t"], young, poisson, **options)
    there = [method for method in METHODS if hasattr(model, method)]
    return model, {"name": np.array(model.name), "version": np.array(model.version), "methods": np.array(there)}


def _answer(value: Any) -> dict[str, Array]:
    if issparse(value):
        K = csr_matrix(value)
        return {"data": K.data, "indices": K.indices, "indptr": K.indptr, "shape": np.array(K.shape)}
    return {"value": np.asarray(value)}


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
