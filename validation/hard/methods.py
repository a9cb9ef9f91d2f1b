"""Methods of the table, and a run of a method on a case."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from functools import partial
from time import perf_counter
from typing import NamedTuple

import numpy as np

from skfem_stvk import SupportError, solve_static

from . import plain_newton
from .case import Array, Case
from .judge import Judgement, Verdict, judged


class Run(NamedTuple):
    """Result of a method on a case.

    Attributes
    ----------
    method, volume
        Name of the method, and whether the volume term is in the system.
    steps, iterations, seconds
        Counts and time of the solve; steps are the completed ones.
    status
        In a word.
    message
        Complete message with warnings.
    u
        (ndofs,) displacements of the last state [m].
    judgement
        Verdict on the result.
    unsaid
        Patterns of the case that are missing from message and warnings.
    """

    method: str
    volume: bool
    steps: int
    iterations: int
    seconds: float
    status: str
    message: str
    u: Array
    judgement: Judgement
    unsaid: tuple[str, ...]

    @property
    def verdict(self) -> Verdict:
        return self.judgement.verdict


class Answer(NamedTuple):
    """Answer of a method: displacements, whether it reports them as the answer at t = 1, counts, status and message."""

    u: Array
    claims_success: bool
    steps: int
    iterations: int
    status: str
    message: str


def _newton(case: Case, clamped: bool) -> Answer:
    body = case.body()
    found = plain_newton.solve(body.system(volume=False), case.steps, body.u0, clamped)
    status = "converged" if found.converged else "not converged"
    return Answer(found.u, found.converged, found.steps, found.iterations, status, found.message)


def _default(case: Case, volume: bool) -> Answer:
    body = case.body()
    system = body.system(volume)
    try:
        result = solve_static(system, case.steps, u0=body.u0, solver=case.solver, quiet=True, raise_on_failure=False)
    except SupportError as error:
        return Answer(np.zeros(system.ndofs), False, 0, 0, "SupportError", str(error))
    history = result.history
    return Answer(result.u, result.success, len(history), history.iterations, result.status.name.lower(), result.message)


class Method(NamedTuple):
    """Solver of a case, whether the volume term is in the system, and whether its law is `InvertibleStVK`."""

    solve: Callable[[Case], Answer]
    volume: bool
    invertible: bool = False

    def case(self, case: Case) -> Case:
        """Return the case that this method solves."""
        return case.of_invertible() if self.invertible else case


#: Methods by name, in the order of the table; the methods of this package are last.
METHODS = {
    "plain Newton": Method(partial(_newton, clamped=False), volume=False),
    "Newton, clamped": Method(partial(_newton, clamped=True), volume=False),
    "default": Method(partial(_default, volume=False), volume=False),
    "default + volume": Method(partial(_default, volume=True), volume=True),
    "default, invertible": Method(partial(_default, volume=False), volume=False, invertible=True),
}
OURS = ("default", "default + volume", "default, invertible")


def run(case: Case, method: str) -> Run:
    """Run a method on a case, and judge its answer."""
    chosen = METHODS[method]
    case, volume = chosen.case(case), chosen.volume
    truth = case.truth_of(volume)
    begin = perf_counter()
    with warnings.catch_warnings(record=True) as caught, np.errstate(all="ignore"):
        warnings.simplefilter("always")
        answer = chosen.solve(case)
    seconds = perf_counter() - begin
    said = " ".join([answer.message, *(str(one.message) for one in caught)])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        judgement = judged(case.body().system(volume), answer.u, answer.claims_success, answer.message, truth)
    asked = truth.says if method in OURS and not (truth.refused and answer.claims_success) else ()
    unsaid = tuple(pattern for pattern in asked if not re.search(pattern, said))
    return Run(method, volume, answer.steps, answer.iterations, seconds, answer.status, said, answer.u, judgement, unsaid)
