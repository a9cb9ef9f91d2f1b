"""Checks of all solvers: of the matrix and the right-hand side before the solve, and of the residual after a direct solve."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import wraps
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ..arguments import number, shown, vector
from ..errors import StateError, StvkError, name_ids
from ..kernels.threads import CopyableLock
from ..space import ONE_PROCESS
from .solver import Kind, LinearSolver, Outcome, Solution, Unknowns, Vector, structure_of

Method = TypeVar("Method", bound=Callable[..., Any])


class LatestFactors:
    """The `number` of the latest factors of an analysis. Only these may solve. Python threads hold its `lock` during calls."""

    def __init__(self) -> None:
        self.number, self.lock = 0, CopyableLock()

    def next(self) -> int:
        """Return a number for new factors, which makes all others stale."""
        self.number += 1
        return self.number


def latest_only(method: Method) -> Method:
    """Decorate a method of factors: it waits for the lock, and refuses to run if the factors are not the latest."""

    @wraps(method)
    def waiting(self: Any, *arguments: Any, **named: Any) -> Any:
        with self._latest.lock:
            if self._number != self._latest.number:
                raise StvkError(
                    "These factors are stale: their analysis has factorised another matrix since. Solve with the factors that "
                    "factorise() returned last, or call analyse() again for a second set of factors."
                )
            return method(self, *arguments, **named)

    return cast(Method, waiting)


def checked_kind(kind: Any) -> None:
    """Refuse a value that is not a `Kind`."""
    if not isinstance(kind, Kind):
        raise StvkError(f"kind = {shown(kind)}; expected one of {', '.join(f'Kind.{one.name}' for one in Kind)}.")


def check_kind(solver: LinearSolver, kind: Kind) -> None:
    """Refuse a kind of matrix that the solver does not support."""
    checked_kind(kind)
    if kind > solver.takes:
        raise StvkError(
            f"kind = {kind}; expected at most {solver.takes} for solver='{solver.name}'. Follower loads make K unsymmetric. "
            "Direct solvers take every kind: solver='superlu', 'pardiso' or 'auto'."
        )


def checked_values(K: Any, unknowns: Unknowns) -> NDArray[np.float64]:
    """Return the values (nnz,) of K in double precision, copied only if necessary. Refuse another structure, and NaN."""
    indptr, indices = structure_of(unknowns)
    n = unknowns.n
    if not isinstance(K, csr_matrix) or K.shape != (n, n):
        raise StvkError(f"K = {shown(K)}; expected a csr_matrix of shape {(n, n)}.")
    same_rows = K.indptr is indptr or np.array_equal(K.indptr, indptr)
    if not same_rows or not (K.indices is indices or np.array_equal(K.indices, indices)):
        analysed = f"the structure that was analysed, of {len(indices)} values"
        raise StvkError(
            f"K has {K.nnz} values in another structure; expected {analysed}. Keep the zeros of K, or call analyse() again."
        )
    values = np.ascontiguousarray(K.data, dtype=np.float64)
    with (ONE_PROCESS if unknowns.space is None else unknowns.space.comm).together():
        if not np.isfinite(values.sum()) and len(bad := np.flatnonzero(~np.isfinite(values))):
            raise StateError(f"K is not finite in {name_ids(bad, 'value')}: did the previous step diverge?")
    return values


def checked_right(b: Any, n: int, rtol: Any, x0: Any, out: Any) -> tuple[Vector, float, Vector | None]:
    """Return the right-hand side, the tolerance and the start vector of a solve.

    Refuse other shapes, and an `out` that is not writeable. Vectors may contain NaN or infinity, because the outcome of the solve
    reports them.
    """
    if out is not None:
        own = isinstance(out, np.ndarray) and out.dtype == np.float64 and out.shape == (n,) and out.flags.writeable
        if not own or isinstance(out, np.ma.MaskedArray):
            raise StvkError(f"out = {shown(out)}; expected an array of double precision ({n},) that can be written to.")
    rtol = number("rtol", rtol, "a number between 0 and 1, such as 1e-10", 0.0, 1.0)
    each = "free degree of freedom"
    start = None if x0 is None else vector("x0", x0, n, each).astype(np.float64, copy=False)
    return vector("b", b, n, each).astype(np.float64, copy=False), rtol, start


def checked_unknowns(unknowns: Any) -> Unknowns:
    """Refuse a value that is not an `Unknowns`."""
    if not isinstance(unknowns, Unknowns):
        raise StvkError(f"unknowns = {shown(unknowns)}; expected Unknowns(vertex, component, indptr, indices).")
    return unknowns


def written_to(found: Solution, out: Vector | None) -> Solution:
    """Return the solution, with x in `out` if that is not None."""
    if out is None or found.x is out:
        return found
    np.copyto(out, found.x)
    return replace(found, x=out)


@np.errstate(over="ignore", invalid="ignore")  # overflow is reported as an outcome
def solve_checked(product: Callable[[Vector], Vector], inverse: Callable[[Vector], Vector], b: Vector, rtol: float) -> Solution:
    """Return `x = inverse(b)`, refined once to `x += inverse(b - K x)` if `|b - K x| > rtol |b|` and the refined x is better."""
    size = float(np.linalg.norm(b))
    if not np.isfinite(size):
        return Solution.none(b, Outcome.NOT_FINITE)
    if size == 0:
        return Solution(np.zeros_like(b), 0, 0.0, Outcome.SOLVED)
    x = inverse(b)
    if not np.isfinite(x).all():
        return Solution.none(b, Outcome.SINGULAR)
    r = b - product(x)
    residual, refined = float(np.linalg.norm(r)) / size, 0
    if residual > rtol:
        y = x + inverse(r)
        better = float(np.linalg.norm(b - product(y))) / size
        if better < residual:
            x, residual, refined = y, better, 1
    if not np.isfinite(residual):
        return Solution.none(b, Outcome.NOT_FINITE)
    return Solution(x, refined, residual, Outcome.SOLVED if residual <= rtol else Outcome.INACCURATE)
