"""The part of the tangent that is due to the tensions at the beginning of a step."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix

from ..arguments import Array
from ..edges import NONE, Tensions
from ..system import System, TangentOperator
from ..terms.load import Time


class StartTensions:
    """`sum t_i(u_0) Lap_i`, the difference of two tangents at `u_0`: one with the tensions that are kept, one without any.

    It is computed when it is first asked for in a step, on arrays that are kept.
    """

    def __init__(self, system: System) -> None:
        self._system, self._u0 = system, np.zeros(system.ndofs)
        self._matrices: list[csr_matrix | None] = [None, None]
        self._operators: list[TangentOperator] = []
        self._valued: Tensions | None = None
        self._prepared: Tensions | None = None

    def begin(self, u0: Array) -> None:
        """A step from `u0` (ndofs,)."""
        np.copyto(self._u0, u0)
        self._valued = self._prepared = None

    def values(self, t: Time, kept: Tensions) -> Array:
        """Of a matrix of the system's pattern."""
        difference, without = self._matrices
        if self._valued != kept or difference is None:
            difference = self._system.jacobian(self._u0, t, out=difference, kept=kept)
            without = self._system.jacobian(self._u0, t, out=without, kept=NONE)
            difference.data -= without.data
            self._matrices, self._valued = [difference, without], kept
        values: Array = difference.data
        return values

    def operators(self, kept: Tensions) -> list[tuple[float, TangentOperator]]:
        """As `TangentOperator.scale_and_add` takes them."""
        if not self._operators:
            self._operators = [self._system.linear_operator(self._u0, kept=which) for which in (kept, NONE)]
        elif self._prepared != kept:
            for operator, which in zip(self._operators, (kept, NONE), strict=True):
                operator.prepare(self._u0, kept=which)
        self._prepared = kept
        return list(zip((1.0, -1.0), self._operators, strict=True))
