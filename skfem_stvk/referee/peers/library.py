"""Code in C or C++ as a candidate: functions of a shared library, which a process of its own calls with one thread."""

from __future__ import annotations

import os
import sys
from collections import Counter
from functools import partial
from hashlib import sha256
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import LinearOperator

from ...arguments import THREAD_LIMITS, Array
from ...arguments import path as checked_path
from ...errors import StvkError
from ...mesh import ElementMesh
from ...npz import NotArrays
from .process import AnsweringProcess, NoAnswer

#: Roles of functions that return values; `body` sets the mesh.
ROLES = ("energy", "force", "tangent", "product")
#: Seconds that a function has for a call, and number of calls that may take longer before a function is not called any more.
LONGEST_CALL, MOST_ENDLESS = 30.0, 3


class SharedLibrary:
    """Shared library whose functions compute W, F and K. Call `close` after use, or use it in a `with` statement.

    A call that ends its process or takes longer than `LONGEST_CALL` seconds raises a StvkError, and is not repeated in the same
    state. The next call gets a new process.

    Parameters
    ----------
    file
        Path of the library.
    functions
        Names of its functions by role: `body`, `energy`, `force`, and `tangent` or `product`. Their arguments are those of
        `docs/candidate/candidate.h`.

    Raises
    ------
    StvkError
        if the library cannot be loaded, lacks one of the functions, or no function returns values.
    """

    def __init__(self, file: str | Path, functions: dict[str, str]) -> None:
        self._file = checked_path("library", file, "the path of a shared library").absolute()
        self._functions = functions
        if not any(role in functions for role in ROLES):
            raise StvkError(f"library = {file}; expected the name of at least one of its functions: {', '.join(ROLES)}.")
        if "tangent" in functions and "product" in functions:
            raise StvkError(
                f"library = {file} with a tangent and a product; expected one of them. Check the other in a second run."
            )
        if not self._file.is_file():
            raise StvkError(f"library = {file}; expected a shared library, but there is no such file. Has it been built?")
        self._process: AnsweringProcess | None = None
        self._body: dict[str, Array] | None = None
        self._ended: dict[tuple[str, bytes], StvkError] = {}
        self._endless: Counter[str] = Counter()
        self._start()

    def __enter__(self) -> SharedLibrary:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.close()
        self._process = self._body = None

    def candidate(self, mesh: ElementMesh, young: ArrayLike, poisson: ArrayLike) -> SimpleNamespace:
        """Return an object with the methods `energy`, `internal_force` and `tangent` for which there are functions.

        Its body is set at once, and again before a call if another body has been set since.

        Raises
        ------
        StvkError
            if the function of the body fails.
        """
        constants = {name: np.full(mesh.nt, value, dtype=float) for name, value in (("young", young), ("poisson", poisson))}
        nodes, elements = np.ascontiguousarray(mesh.p.T), np.ascontiguousarray(mesh.t.T, dtype=np.int64)
        body = {"nodes": nodes, "elements": elements, **constants}
        self._set(body)
        value = {
            "energy": ("energy", self._called),
            "force": ("internal_force", self._called),
            "tangent": ("tangent", self._matrix),
            "product": ("tangent", self._operator),
        }
        methods = {role: of for role, of in value.items() if role in self._functions}
        return SimpleNamespace(**{method: partial(call, body, role) for role, (method, call) in methods.items()})

    def _called(self, body: dict[str, Array], role: str, u: Array, **others: Array) -> Any:
        self._set(body)
        return self._ask(role, self._functions[role], {"u": u, **others})["value"]

    def _matrix(self, body: dict[str, Array], role: str, u: Array) -> coo_matrix:
        self._set(body)
        triplets = self._ask(role, self._functions[role], {"u": u})
        return coo_matrix((triplets["values"], (triplets["rows"], triplets["columns"])), shape=(u.size, u.size))

    def _operator(self, body: dict[str, Array], role: str, u: Array) -> LinearOperator:
        return LinearOperator((u.size, u.size), matvec=lambda v: self._called(body, role, u, v=v.ravel()), dtype=np.float64)

    def _set(self, body: dict[str, Array]) -> None:
        if self._process is None:
            self._start()
        if self._body is not body and "body" in self._functions:
            self._ask("body", self._functions["body"], body)
            self._body = body

    def _start(self) -> None:
        one_thread = {**os.environ, **dict.fromkeys(THREAD_LIMITS, "1")}
        self._process = AnsweringProcess(sys.executable, "library_calls", [folder for folder in sys.path if folder], one_thread)
        names = {role: np.array(name) for role, name in self._functions.items()}
        self._ask("library", self._file.name, {"path": np.array(str(self._file)), **names})

    def _ask(self, role: str, name: str, given: dict[str, Array]) -> dict[str, Array]:
        """Return the answer of a function to the arrays. Raise StvkError if there is none."""
        assert self._process is not None
        call = role, sha256(next(iter(given.values())).tobytes()).digest()
        if call in self._ended:
            raise self._ended[call]
        if self._endless[name] >= MOST_ENDLESS:
            raise StvkError(f"{name} was not called: {MOST_ENDLESS} calls before took longer than {LONGEST_CALL:g} s.")
        try:
            answer = self._process.ask({"role": np.array(role), **given}, LONGEST_CALL)
        except (NoAnswer, NotArrays) as error:
            self.close()
            self._endless[name] += isinstance(error, NoAnswer) and error.too_long
            self._ended[call] = StvkError(f"{name}: the process of the library {error}.")
            raise self._ended[call] from error
        if "failed" in answer:
            if role == "library":
                self.close()
            raise StvkError(f"{name} {answer['failed']}.")
        return answer
