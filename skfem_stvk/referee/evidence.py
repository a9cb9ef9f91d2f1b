"""Values of the candidate in strained states, with which hypotheses are compared."""

from __future__ import annotations

import copy
from collections.abc import Callable
from contextlib import suppress
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import csr_matrix, issparse
from scipy.sparse.linalg import LinearOperator

from ..arguments import Array
from ..errors import StvkError
from .case import STRETCH, Case
from .implementations import ContractViolation, Implementation

#: States in which hypotheses are compared with the candidate. All have large strains; the last one has inverted elements.
STATES = ("rotated strained", "translated strained", STRETCH, "35 % compression", "large random")
#: Residuals below VANISHES count as zero. Errors of single precision lie between VANISHES and COARSE.
VANISHES, COARSE = 1e-8, 1e-4
Values = dict[str, Any]
#: Function of displacements (ndofs,) and the requested quantities that returns those of W, F and K.
Model = Callable[[Array, str], Values]


class Evidence:
    """Values of the candidate in strained states, and the errors of models relative to these values.

    Attributes
    ----------
    quantities
        The quantities among W, F and K that the candidate returns in any strained state.
    found
        Values by state, for the states in which all values are finite.
    not_finite
        Values in each of all states, including rest and rotation, in which an entry is not finite.
    """

    def __init__(self, case: Case, implementation: Implementation) -> None:
        self.case, self.implementation = case, implementation
        self.found: dict[str, Values] = {}
        self.not_finite: dict[str, Values] = {}
        self._by_products = False
        available = [quantity for quantity in "WFK" if implementation.has(quantity)]
        states = sorted(case.states, key=lambda state: state not in STATES)
        answers = {state: self._answers(available, case.states[state]) for state in states}
        self.quantities = [quantity for quantity in available if any(quantity in answers[s] for s in states if s in STATES)]
        for state, values in answers.items():
            if len(values) < max(len(self.quantities), 1):
                continue
            if not all(np.isfinite(flat(value)).all() for value in values.values()):
                self.not_finite[state] = values
            elif state in STATES:
                self.found[state] = values

    def _answers(self, available: list[str], u: Array) -> Values:
        """Return the candidate's values of the quantities that do not raise."""
        values: Values = {}
        for quantity in available:
            with suppress(ContractViolation):
                values[quantity] = self.value(getattr(self.implementation, quantity)(u))
        return values

    @cached_property
    def largest(self) -> dict[str, float]:
        """Largest absolute entries of the reference's W, F and K of the stretched body."""
        return {quantity: float(np.abs(flat(value)).max()) for quantity, value in self.truth(self.case.states[STRETCH]).items()}

    def values(self, implementation: Implementation, u: Array, quantities: str = "WFK") -> Values:
        """Return the requested values of W, F and K of an implementation, if the candidate has them too.

        An operator is replaced by products.
        """
        return {
            quantity: self.value(getattr(implementation, quantity)(u)) for quantity in self.quantities if quantity in quantities
        }

    def value(self, value: Any) -> Any:
        """Return a value in the form in which it is compared.

        An operator is replaced by its products, and so is every K after the first operator.
        """
        self._by_products |= isinstance(value, LinearOperator)
        if isinstance(value, LinearOperator) or (self._by_products and issparse(value)):
            return self._products(value)
        return value

    def _products(self, K: Any) -> Array:
        """Return products (ndofs, 4) with vectors of random signs, so that K is never made dense."""
        return np.asarray(K @ self.signs(K.shape[1]))

    def signs(self, ndofs: int) -> Array:
        """Return four vectors of random signs, (ndofs, 4)."""
        return self.case.random("hypotheses").choice([-1.0, 1.0], size=(ndofs, 4))

    def column(self, value: Any) -> Array:
        """Return a value as a column of a least-squares problem. A matrix is replaced by its products."""
        return np.asarray(self._products(value) if issparse(value) else value, dtype=float).ravel()

    def of(self, quantity: str) -> Evidence:
        """Return the evidence of one quantity alone."""
        single = copy.copy(self)
        single.quantities = [quantity]
        single.found = {state: {quantity: values[quantity]} for state, values in self.found.items()}
        return single

    def truth(self, u: Array, quantities: str = "WFK") -> Values:
        """Return the values of the reference."""
        return self.values(self.case.reference, u, quantities)

    def error(self, model: Model, most: float = COARSE) -> float:
        """Return the largest relative error of a model in all states, or infinity if the model is not defined.

        The computation stops as soon as an error exceeds `most`. Hence K, which costs most, is only computed if W and F fit.
        """
        largest = 0.0 if self.found else np.inf
        for quantities in ("W", "F", "K"):
            for state, values in self.found.items():
                if quantities not in values:
                    continue
                try:
                    claimed = model(self.case.states[state], quantities)
                except (StvkError, ArithmeticError, np.linalg.LinAlgError, ValueError, IndexError, AssertionError):
                    return np.inf
                error = self.relative_difference(values[quantities], claimed[quantities])
                largest = max(largest, error if np.isfinite(error) else np.inf)
                if largest > most:
                    return largest
        return largest

    def relative_difference(self, value: Any, claimed: Any) -> float:
        """Return the largest difference of two values, relative to the largest entry of the second value."""
        claimed = csr_matrix(claimed) if issparse(value) and not issparse(claimed) else self.value(claimed)
        scale, off = np.abs(flat(claimed)).max(initial=0.0), np.abs(flat(value - claimed)).max(initial=0.0)
        return float(off / scale) if scale else (0.0 if off == 0 else np.inf)


def flat(value: Any) -> Array:
    """Return the entries of a value, for a sparse matrix the stored ones."""
    return np.asarray(value.data if issparse(value) else value, dtype=float).ravel()
