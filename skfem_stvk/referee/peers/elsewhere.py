"""Peers in another environment, run by a process of another Python with only NumPy, SciPy and the peer's package."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, issparse

from ...arguments import Array, shown
from ...arguments import path as checked_path
from ...errors import StvkError
from ...npz import NotArrays
from .process import LONGEST, AnsweringProcess, NoAnswer, answer_questions

Answer = TypeVar("Answer")

METHODS = ("energy", "internal_force", "tangent")
#: Seconds that the other process has for an answer. The first answer may include a compilation.
LONGEST_ANSWER = 600.0
#: Size of an answer in addition to 16 bytes per entry of a full K [bytes].
OVERHEAD = 2**20


class Elsewhere(AnsweringProcess):
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
        try:
            super().__init__(self._python, "elsewhere")
        except OSError as error:
            raise StvkError(
                f"{shown(self._python)} cannot be run: {error.strerror}. Expected the path of another Python."
            ) from error
        try:
            question = {"peer": np.array(peer), "p": p, "t": t, "constants": np.array([young, poisson])}
            self.name, self.version, self.methods = self._understood(question, _introduced)
        except BaseException:
            self.close()
            raise

    def __getattr__(self, name: str) -> Any:
        if name in METHODS and name in self.__dict__.get("methods", ()):
            return partial(self._called, name)
        raise AttributeError(f"{type(self).__name__} has no {name}")

    def _called(self, method: str, u: Array) -> Any:
        return self._understood({"method": np.array(method), "u": u}, _value)

    def _understood(self, question: dict[str, Array], understand: Callable[[dict[str, Array]], Answer]) -> Answer:
        try:
            answer = self.ask(question, LONGEST_ANSWER, self._longest)
            if "error" not in answer:
                return understand(answer)
        except NoAnswer as error:
            hint = ". Its peer hangs, or the mesh is too large for it: take a smaller one." if error.too_long else ""
            raise StvkError(f"The process of {self._python} {error}{hint}") from error
        except (NotArrays, KeyError, ValueError, TypeError) as error:
            raise StvkError(
                f"The process of {self._python} gave an invalid answer ({shown(error)}). Check that it is a "
                "Python interpreter with this package."
            ) from error
        raise StvkError(f"{self._python}: {str(answer['error'])[:1000]}")


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
    """Answer the questions on standard input until it ends. The first one makes the peer."""
    model: Any = None

    def answer_to(question: dict[str, Array]) -> dict[str, Array]:
        nonlocal model
        if model is None:
            model, answer = _made(question)
            return answer
        return _answer(getattr(model, str(question["method"]))(question["u"]))

    answer_questions(answer_to)


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
