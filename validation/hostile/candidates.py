"""Candidates that misbehave: the referee must report each as failed or could not run, and the report must be complete."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import skfem
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import LinearOperator

from skfem_stvk import Report, StVK, System, verify
from skfem_stvk.referee.results import CheckOutcome

from .case import Case, Verdict, Wrong

YOUNG, POISSON = 2.0, 0.3


class Own(BaseException):
    """Exception outside Python's class `Exception`."""


class RaisingMessage(Exception):
    """Exception whose message raises another exception."""

    def __str__(self) -> str:
        raise Own


class Candidate:
    """Correct candidate, except for the methods in `wrong`; each of them is a function of the body and `u`."""

    def __init__(self, body: System, **wrong: Callable[[System, Any], Any]) -> None:
        self.body, self.wrong = body, wrong

    def __getattr__(self, name: str) -> Any:
        if name not in ("energy", "internal_force", "tangent"):
            raise AttributeError(name)
        return partial(self.wrong[name], self.body) if name in self.wrong else getattr(self.body, name)


def raising(error: BaseException) -> Callable[[System, Any], Any]:
    """Return a method that raises `error`."""

    def call(body: System, u: Any) -> Any:
        raise error

    return call


def changed(**arrays: Callable[[Any], Any]) -> Callable[[System, Any], csr_matrix]:
    """Return a `tangent` that replaces arrays of K's CSR form without the checks of the constructor."""

    def tangent(body: System, u: Any) -> csr_matrix:
        K = body.tangent(u).copy()
        for name, change in arrays.items():
            object.__setattr__(K, name, change(getattr(K, name).copy()))
        return K

    return tangent


def entry(index: int, value: int) -> Callable[[Any], Any]:
    """Return a function that changes one entry of an array."""

    def change(array: Any) -> Any:
        array[index] = value
        return array

    return change


class Unchecked(csr_matrix):
    """Matrix whose own check accepts any indices."""

    def check_format(self, full_check: bool = True) -> None:
        """Accept the matrix without a check."""


def unchecked(body: System, u: Any) -> Unchecked:
    """Return K with a column far out of range, in a class whose own check accepts it."""
    K = Unchecked(body.tangent(u))
    K.indices = entry(0, 10**8)(K.indices.copy())
    return K


def operator(product: Callable[[Any], Any]) -> Callable[[System, Any], LinearOperator]:
    """Return a `tangent` that gives K as an operator with this product."""
    return lambda body, u: LinearOperator((body.ndofs,) * 2, matvec=product, dtype=float)


def quits(v: Any) -> Any:
    """Raise SystemExit."""
    raise SystemExit(3)


def own(v: Any) -> Any:
    """Raise an exception outside `Exception`."""
    raise Own("from within")


class Product:
    """Object with a shape and a product."""

    dtype = np.dtype(float)

    def __init__(self, body: System, product: Callable[[Any], Any]) -> None:
        self.shape, self.product = (body.ndofs,) * 2, product

    def __matmul__(self, v: Any) -> Any:
        return self.product(v)


class Array:
    """Object that raises SystemExit when NumPy converts it to an array."""

    def __array__(self, *arguments: Any, **named: Any) -> Any:
        raise SystemExit(4)


class Properties:
    """Candidate whose methods raise an exception on access."""

    @property
    def energy(self) -> Any:
        """Raise SystemExit."""
        raise SystemExit(5)

    @property
    def internal_force(self) -> Any:
        """Raise an exception outside `Exception`."""
        raise Own

    def __getattr__(self, name: str) -> Any:
        raise RuntimeError(name)


def wrong_every_third_time(body: System) -> Candidate:
    """Return a candidate with a relative error of 1e-6 in every third force."""
    calls = iter(range(10**9))
    return Candidate(body, internal_force=lambda body, u: body.internal_force(u) * (1 + 1e-6 * (next(calls) % 3 == 2)))


def overwrites_u(body: System) -> Candidate:
    """Return a candidate that overwrites `u` with NaN after use."""

    def force(body: System, u: Any) -> Any:
        F = body.internal_force(u)
        u[:] = np.nan
        return F

    return Candidate(body, internal_force=force)


def reusing(body: System) -> Candidate:
    """Return a candidate that writes each result into the same array of F or K."""
    K, F = body.tangent(np.zeros(body.ndofs)), np.zeros(body.ndofs)

    def force(body: System, u: Any) -> Any:
        F[:] = body.internal_force(u)
        return F

    return Candidate(body, tangent=lambda body, u: body.tangent(u, out=K), internal_force=force)


#: Correct candidates that reuse or overwrite arrays. They must pass.
RIGHT: dict[str, Callable[[System], Any]] = {
    "overwrites u": overwrites_u,
    "one buffer for all calls": reusing,
}


def wrong_of(name: str, **methods: Callable[[System, Any], Any]) -> tuple[str, Callable[[System], Any]]:
    """Return a name and a candidate with these wrong methods."""
    return name, lambda body: Candidate(body, **methods)


NOTHING: tuple[Any, ...] = (None, "K", b"K", {}, set(), [], [[1.0], [1.0, 2.0]], object(), 1 + 1j, np.nan, print, Array(), 10**400)

#: Candidates that must not pass.
WRONG: dict[str, Callable[[System], Any]] = dict(
    [
        *(
            wrong_of(f"{method} raises {type(error).__name__}", **{method: raising(error)})
            for method in ("energy", "internal_force", "tangent")
            for error in (
                SystemExit(3),
                Own("own"),
                GeneratorExit(),
                RaisingMessage(),
                MemoryError(),
                RecursionError(),
                StopIteration(),
            )
        ),
        *(
            wrong_of(f"{method} returns {value!r:.20}", **{method: lambda body, u, value=value: value})
            for method in ("energy", "internal_force", "tangent")
            for value in NOTHING
        ),
        wrong_of("columns far outside", tangent=changed(indices=entry(0, 10**8))),
        wrong_of("negative columns", tangent=changed(indices=entry(0, -5))),
        wrong_of("row pointers far outside", tangent=changed(indptr=entry(-1, 10**9))),
        wrong_of("row pointers that go back", tangent=changed(indptr=entry(2, 0))),
        wrong_of("too few row pointers", tangent=changed(indptr=lambda a: a[:-3])),
        wrong_of("too few values", tangent=changed(data=lambda a: a[: len(a) // 2])),
        wrong_of("values of text", tangent=changed(data=lambda a: a.astype(str))),
        wrong_of("values of objects", tangent=changed(data=lambda a: a.astype(object))),
        wrong_of("columns that are no whole numbers", tangent=changed(indices=lambda a: a + 0.5)),
        wrong_of("a matrix that lies", tangent=unchecked),
        wrong_of("K of a huge shape", tangent=lambda body, u: csr_matrix((10**6, 10**6))),
        wrong_of("K dense and not finite", tangent=lambda body, u: np.full((body.ndofs,) * 2, np.inf)),
        wrong_of("K masked", tangent=lambda body, u: np.ma.masked_all((body.ndofs,) * 2)),
        wrong_of("an operator that quits", tangent=operator(quits)),
        wrong_of("an operator that raises its own", tangent=operator(own)),
        wrong_of("an operator with a short product", tangent=operator(lambda v: v[:-1])),
        wrong_of("an operator with a product of text", tangent=operator(lambda v: "Kv")),
        wrong_of("a product that quits", tangent=lambda body, u: Product(body, quits)),
        wrong_of("a product of another shape", tangent=lambda body, u: Product(body, lambda v: np.ones((v.size, v.size)))),
        wrong_of("a product of nothing", tangent=lambda body, u: Product(body, lambda v: None)),
        wrong_of("F of a huge shape", internal_force=lambda body, u: np.broadcast_to(1.0, (10**7, 10**7))),
        wrong_of("W of a huge shape", energy=lambda body, u: np.broadcast_to(1.0, (10**7, 10**7))),
        wrong_of("F masked", internal_force=lambda body, u: np.ma.masked_greater(body.internal_force(u), -np.inf)),
        wrong_of("F masked in one place", internal_force=lambda body, u: np.ma.masked_array(body.internal_force(u), u == u[0])),
        wrong_of("F as a column", internal_force=lambda body, u: body.internal_force(u)[:, None]),
        ("methods that raise when looked up", lambda body: Properties()),
        ("every third force is off", wrong_every_third_time),
    ]
)


def cases() -> Iterator[Case]:
    """Yield a case for each candidate."""
    for name, make in WRONG.items():
        yield Case(name, partial(attempt, make=make), partial(judge, right=False), quick=name in QUICK)
    for name, make in RIGHT.items():
        yield Case(name, partial(attempt, make=make), partial(judge, right=True), quick=name in QUICK)


QUICK = ("columns far outside", "an operator that quits", "F of a huge shape", "one buffer for all calls")


def body() -> System:
    """Return a body of a few tetrahedra."""
    return System(skfem.MeshTet().refined(1), StVK(young=YOUNG, poisson=POISSON))


def attempt(folder: Path, make: Callable[[System], Any]) -> Report:
    """Return the report on a candidate, and save it."""
    right = body()
    report = verify(right.mesh, young=YOUNG, poisson=POISSON, candidate=make(right), quiet=True)
    report.save(folder / "report")
    return report


def judge(report: Report, right: bool) -> None:
    """Raise `Wrong` unless the candidate passed as expected, the report is complete and no other subject failed."""
    outcomes = {r.outcome for r in report.results if r.subject == "candidate"}
    if report.passed is not right:
        raise Wrong(Verdict.SILENT, "passed" if report.passed else f"not passed: {sorted(o.value for o in outcomes)}")
    if report.interrupted or any(
        r.outcome in (CheckOutcome.FAILED, CheckOutcome.COULD_NOT_RUN) for r in report.results if r.subject != "candidate"
    ):
        raise Wrong(Verdict.LOSS, "the report is incomplete, or contains failures of other subjects")
