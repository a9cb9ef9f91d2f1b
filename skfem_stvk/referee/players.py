"""A player: anybody's W, F and K behind one face. What it returns is not trusted."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, issparse

Array = NDArray[np.float64]

METHODS = {"W": "energy", "F": "internal_force", "K": "tangent"}


class Foul(Exception):
    """A player raised an exception, or returned something of the wrong kind or shape."""


class Player:
    """`W(u)`, `F(u)`, `K(u)` of a candidate that has any of `energy`, `internal_force`, `tangent`.

    Parameters
    ----------
    name : how reports call it.
    model : the candidate.
    ndofs : length of `u`.
    """

    def __init__(self, name: str, model: Any, ndofs: int) -> None:
        self.name, self.model, self.ndofs = name, model, ndofs

    def has(self, quantity: str) -> bool:
        """Whether the candidate has the method for W, F or K."""
        try:
            return callable(getattr(self.model, METHODS[quantity], None))
        except Exception:  # a property that raises: the call will say so
            return True

    def W(self, u: Array) -> float:
        """Strain energy [J]."""
        value = self._numbers("W", u)
        if value.size != 1:
            raise Foul(f"{self.name}.energy(u) returned shape {value.shape}; expected one number.")
        return float(value.reshape(()))

    def F(self, u: Array) -> Array:
        """Internal force (ndofs,) [N]."""
        force = self._numbers("F", u)
        if force.shape != (self.ndofs,):
            raise Foul(f"{self.name}.internal_force(u) returned shape {force.shape}; expected ({self.ndofs},).")
        return force

    def K(self, u: Array) -> Any:
        """Tangent stiffness [N/m]: a `csr_matrix`, or what else can be multiplied with a vector."""
        matrix = self._call("K", u)
        if getattr(matrix, "shape", None) != (self.ndofs, self.ndofs):
            raise Foul(
                f"{self.name}.tangent(u) returned {type(matrix).__name__} of shape {getattr(matrix, 'shape', None)}; "
                f"expected a dense or sparse matrix or a LinearOperator of shape {(self.ndofs, self.ndofs)}."
            )
        if np.dtype(getattr(matrix, "dtype", float) or float).kind not in "fiu":
            raise Foul(f"{self.name}.tangent(u) returned a matrix of {matrix.dtype}; expected real numbers.")
        return csr_matrix(matrix, dtype=float) if issparse(matrix) or isinstance(matrix, np.ndarray) else matrix

    def _numbers(self, quantity: str, u: Array) -> Array:
        """What the candidate returned, as a copy of its own: the candidate may use its buffer again."""
        returned = self._call(quantity, u)
        try:
            array = np.array(returned)
        except ValueError:
            array = np.array(None)
        if array.dtype.kind not in "fiu":
            kind = type(returned).__name__ if array.dtype == object else f"{type(returned).__name__} of {array.dtype}"
            raise Foul(f"{self.name}.{METHODS[quantity]}(u) returned a {kind}; expected real numbers.")
        return array.astype(float, copy=False)

    def _call(self, quantity: str, u: Array) -> Any:
        try:
            return getattr(self.model, METHODS[quantity])(u.copy())
        except (Exception, SystemExit) as error:
            raise Foul(f"{self.name}.{METHODS[quantity]}(u) raised {type(error).__name__}: {error}") from error
