"""What every solver checks before it works."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ..errors import StateError, StvkError, name_ids
from .solver import Kind, LinearSolver, Solution, Unknowns, Vector


class Newest:
    """Which factors an analysis made last: only those may solve."""

    def __init__(self) -> None:
        self._number = 0

    def next(self) -> int:
        """A number for new factors, which makes all others stale."""
        self._number += 1
        return self._number

    def check(self, number: int) -> None:
        """Refuse factors that are not the newest."""
        if number != self._number:
            raise StvkError(
                "These factors are stale: their analysis has factorised another matrix since. Solve with what factorise() returned last, "
                "or analyse once more for a second set of factors."
            )


def check_kind(solver: LinearSolver, kind: Kind) -> None:
    """Refuse what the solver cannot take, and name those that can."""
    if kind > solver.takes:
        from .choose import SOLVERS
        from .solver import names

        able = names([other for other in SOLVERS if other.takes >= kind])
        raise StvkError(
            f"A {kind} matrix came; '{solver.name}' takes {solver.takes} ones at most. Follower loads make K unsymmetric. Solvers that take it: {able}."
        )


def checked_values(K: Any, unknowns: Unknowns) -> NDArray[np.float64]:
    """(nnz,) the values of K in double precision, not copied if they are; refuse another structure, and NaN."""
    if unknowns.indptr is None or unknowns.indices is None:
        raise StvkError("The unknowns have no indptr and indices; expected the structure of K over the free degrees of freedom.")
    n = unknowns.n
    if not isinstance(K, csr_matrix) or K.shape != (n, n):
        raise StvkError(f"K is a {type(K).__name__} of shape {np.shape(K)}; expected a csr_matrix of shape {(n, n)}.")
    if not _same(K.indptr, unknowns.indptr) or not _same(K.indices, unknowns.indices):
        raise StvkError(
            f"K has {K.nnz} values in another structure than was analysed, of {len(unknowns.indices)} values. Keep its zeros, or analyse anew."
        )
    values = np.ascontiguousarray(K.data, dtype=np.float64)
    if not np.isfinite(values.sum()) and len(bad := np.flatnonzero(~np.isfinite(values))):
        raise StateError(f"K is not finite in {name_ids(bad, 'value')}: did the step before diverge?")
    return values


def checked_vector(b: Any, n: int) -> Vector:
    """`b` in double precision; refuse another shape."""
    b = np.ascontiguousarray(b, dtype=np.float64)
    if b.shape != (n,):
        raise StvkError(f"b has shape {b.shape}; expected ({n},), a value for each free degree of freedom.")
    return b


def checked_start(x0: Any, n: int) -> Vector | None:
    """`x0` in double precision, if there is one; refuse another shape."""
    if x0 is None:
        return None
    x0 = np.ascontiguousarray(x0, dtype=np.float64)
    if x0.shape != (n,):
        raise StvkError(f"x0 has shape {x0.shape}; expected ({n},), a value for each free degree of freedom.")
    return x0


def handed_out(found: Solution, out: Vector | None) -> Solution:
    """What was found, with x in `out` if there is one."""
    if out is None or found.x is out:
        return found
    np.copyto(out, found.x)
    return replace(found, x=out)


def _same(a: Any, b: Any) -> bool:
    return a is b or np.array_equal(a, b)
