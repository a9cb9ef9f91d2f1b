"""Implementations: models under test with W, F and K behind one interface, which validates all that they return."""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_matrix, coo_matrix, csc_matrix, csr_matrix, issparse
from scipy.sparse.linalg import LinearOperator

from ..arguments import Array, shown
from ..errors import StvkError, name_known

Value = TypeVar("Value")

COMPRESSED = {"csr": csr_matrix, "csc": csc_matrix, "bsr": bsr_matrix}
METHODS = {"W": "energy", "F": "internal_force", "K": "tangent"}


class ContractViolation(Exception):
    """Error of an implementation that raises an exception, or returns a value of the wrong kind or shape."""


def guarded(name: str, call: Callable[[], Value]) -> Value:
    """Return the value of a call into a candidate. Raise `ContractViolation` for every exception of the candidate.

    Only `KeyboardInterrupt` passes through, because Ctrl-C cannot be distinguished from a candidate that raises it.
    """
    try:
        return call()
    except (KeyboardInterrupt, ContractViolation):
        raise
    except BaseException as error:  # including SystemExit and exceptions of the candidate's own
        raise ContractViolation(f"{name} raised {type(error).__name__}: {_words(error)}") from error


def make_candidate(name: str, make: Callable[[], Any], more: str = "") -> Any:
    """Return the candidate that a user's class or function makes.

    Raises
    ------
    StvkError
        if `make` raised it, failed otherwise, or returned None. `more` states what was expected.
    """
    try:
        candidate = guarded(name, make)
    except ContractViolation as violation:
        raise (
            violation.__cause__ if isinstance(violation.__cause__, StvkError) else StvkError(f"{violation}.{more}")
        ) from violation
    if candidate is None:
        raise StvkError(f"{name} returned None; expected an object with at least one of {', '.join(METHODS.values())}.")
    return candidate


def users_function(argument: str, given: str) -> Callable[..., Any]:
    """Return a user's function by `module:function` or `file.py:function`. Modules may be in the working folder.

    Raises
    ------
    StvkError
        if there is no such function, or its module raises. The message contains the `argument` that named it.

    Examples
    --------
    >>> users_function("--against", "math:sin")(0.0)
    0.0
    >>> users_function("--against", "math:sine")
    Traceback (most recent call last):
    skfem_stvk.errors.StvkError: --against = 'math:sine': there is no function 'sine' in math; known: ... Did you mean 'sin'?
    """
    module_path, _, name = given.rpartition(":")
    argument_text = f"{argument} = {shown(given)}"
    if not module_path or not name:
        raise StvkError(f"{argument_text}; expected module:function, or file.py:function.")
    try:
        module = guarded(module_path, lambda: _module(module_path))
    except ContractViolation as violation:
        raise StvkError(
            f"{argument_text}: {violation}. Expected module:function, or file.py:function, which can be imported."
        ) from violation
    known = [other for other in vars(module) if not other.startswith("_") and callable(getattr(module, other, None))]
    function = getattr(module, name, None)
    if not callable(function):
        raise StvkError(f"{argument_text}: there is no function {name!r} in {module_path}; {name_known(name, known)}")
    return function


def _module(module_path: str) -> Any:
    if not module_path.endswith(".py"):
        if "" not in sys.path:
            sys.path.insert(0, "")
        return import_module(module_path)
    spec = spec_from_file_location(Path(module_path).stem, module_path)
    if spec is None or spec.loader is None or not Path(module_path).is_file():
        raise ImportError(f"{module_path} is not a Python file")
    module = sys.modules[spec.name] = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _words(error: BaseException) -> str:
    try:
        return str(error)[:500]
    except BaseException:  # so that no error of a candidate ends the report
        return "(its message cannot be read)"


class Implementation:
    """Wrapper of a candidate with any of `energy`, `internal_force`, `tangent`: `W(u)`, `F(u)` and `K(u)` for `u` (ndofs,)."""

    def __init__(self, name: str, model: Any, ndofs: int) -> None:
        self.name, self.model, self.ndofs = name, model, ndofs

    def has(self, quantity: str) -> bool:
        """Return whether the candidate has the method for W, F or K."""
        try:
            return callable(guarded(self.name, lambda: getattr(self.model, METHODS[quantity], None)))
        except ContractViolation:  # a property that raises; the later call reports it
            return True

    def W(self, u: Array) -> float:
        """Return the strain energy [J]."""
        return float(self._numbers("W", u, (), "one number").reshape(()))

    def F(self, u: Array) -> Array:
        """Return the internal force (ndofs,) [N]."""
        return self._numbers("F", u, (self.ndofs,), f"({self.ndofs},)")

    def K(self, u: Array) -> Any:
        """Return the tangent stiffness [N/m] as a copy in `csr_matrix` form, or as an operator whose products are checked."""
        returned = self.call("K", u)
        return guarded(f"The result of {self.name}.tangent(u)", lambda: self._matrix(returned))

    def _matrix(self, returned: Any) -> Any:
        kind, size = type(returned).__name__, (self.ndofs, self.ndofs)
        dense = not issparse(returned) and (isinstance(returned, list | tuple) or hasattr(returned, "__array__"))
        if dense and getattr(returned, "shape", size) == size:  # check before the copy, which may be huge
            returned = _as_array(returned)
        shape = getattr(returned, "shape", None)
        if shape != size:
            raise ContractViolation(
                f"{self.name}.tangent(u) returned {kind} of shape {shown(shape)}; expected a dense or sparse matrix or a "
                f"LinearOperator of shape {size}."
            )
        if np.dtype(getattr(returned, "dtype", float) or float).kind not in "fiu":
            raise ContractViolation(f"{self.name}.tangent(u) returned a matrix of {returned.dtype}; expected real numbers.")
        if issparse(returned):
            return self._sparse(returned)
        if dense:
            return csr_matrix(returned.astype(float))
        return LinearOperator(size, matvec=lambda v: self._product(returned, v), dtype=np.float64)

    def _sparse(self, K: Any) -> csr_matrix:
        """Return a validated copy as `csr_matrix`. The indices are checked first, because compiled routines do not check them."""
        try:
            if K.format in COMPRESSED:
                if not {K.indices.dtype.kind, K.indptr.dtype.kind} <= set("iu"):
                    raise TypeError(f"its indices are of {K.indices.dtype} and {K.indptr.dtype}")
                if (np.diff(K.indptr) < 0).any():  # `check_format` checks no rows if the last row pointer is 0
                    raise ValueError("its row pointers decrease")
                own = COMPRESSED[K.format]((K.data, K.indices, K.indptr), shape=K.shape, copy=True)
                own.check_format(full_check=True)
            else:
                entries = K.tocoo()
                own = coo_matrix((entries.data, (entries.row, entries.col)), shape=K.shape)  # raises if an index is out of range
            return csr_matrix(own, dtype=float)
        except (ValueError, TypeError, IndexError) as error:
            raise ContractViolation(
                f"{self.name}.tangent(u) returned a {type(K).__name__} that is inconsistent: {error}."
            ) from error

    def _product(self, operator: Any, v: Array) -> Array:
        name = f"The product of {self.name}.tangent(u) with a vector"
        product = guarded(name, lambda: np.array(operator @ v.copy()))
        if product.dtype.kind not in "fiu" or product.shape != v.shape:
            raise ContractViolation(f"{name} has shape {product.shape} and dtype {product.dtype}; expected {v.shape} real numbers.")
        return product.astype(float, copy=False)

    def _numbers(self, quantity: str, u: Array, shape: tuple[int, ...], expected: str) -> Array:
        """Return the candidate's result as a copy, because the candidate may reuse its buffer.

        Raise `ContractViolation` for a wrong shape or type.
        """
        returned, name = self.call(quantity, u), f"{self.name}.{METHODS[quantity]}(u)"

        def copied() -> NDArray[Any]:
            if isinstance(returned, np.ndarray) and not _fits(returned.shape, shape):  # check before the copy, which may be huge
                raise ContractViolation(f"{name} returned shape {returned.shape}; expected {expected}.")
            return _as_array(returned)

        array = guarded(f"The result of {name}", copied)
        if array.dtype.kind not in "fiu":
            kind = type(returned).__name__ if array.dtype == object else f"{type(returned).__name__} of {array.dtype}"
            raise ContractViolation(f"{name} returned a {kind}; expected real numbers.")
        if not _fits(array.shape, shape):
            raise ContractViolation(f"{name} returned shape {array.shape}; expected {expected}.")
        return array.astype(float, copy=False)

    def call(self, quantity: str, u: Array) -> Any:
        """Return the unchecked result of the candidate."""
        name = METHODS[quantity]
        return guarded(f"{self.name}.{name}(u)", lambda: getattr(self.model, name)(u.copy()))


def _fits(shape: tuple[int, ...], expected: tuple[int, ...]) -> bool:
    """Return whether the shape is the expected one. For one number, any shape with one entry is accepted."""
    return shape == expected if expected else all(n == 1 for n in shape)


def _as_array(returned: Any) -> NDArray[Any]:
    """Return a copy as an array. Masked entries become nan, and ragged lists an object array."""
    try:
        if isinstance(returned, np.ma.MaskedArray) and returned.dtype.kind in "fiu":
            return np.array(np.ma.filled(returned.astype(float), np.nan))
        return np.array(returned)
    except ValueError:
        return np.array(None)
