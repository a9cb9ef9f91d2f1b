"""Calls of every public function with hostile values of each argument: an error names the argument, or the result is correct."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from skfem_stvk.errors import AnalysisError, StvkError

from .call import Call
from .case import Case, Verdict, Wrong
from .comparison import comparable, same
from .values import DISGUISED, EVERY, NOTHING, Hostile

#: Modules with a function `calls()`.
TABLES = ("table_of_bodies", "table_of_systems", "table_of_solves", "table_of_motions", "table_of_results")
#: Expressions for the words by which messages name these arguments, in all functions.
CALLED = {
    "path": r"\bpath\b|does not end in|is a folder|The folder",
    "fields": "fields?",
    "mesh": r"mesh|\b[pt] (=|has)",
    "save": r"\bsave\b|path|does not end in",
}


def cases() -> Iterator[Case]:
    """Yield all calls with all hostile values."""
    for table in TABLES:
        yield from cases_of_calls(calls_of(table))


def calls_of(table: str) -> list[Call]:
    """Return the calls of a table."""
    found: list[Call] = import_module(f".{table}", __package__).calls()
    return found


def cases_of_calls(calls: Iterable[Call], costly: bool = True) -> Iterator[Case]:
    """Yield a case for each hostile value of each argument of each call.

    If `costly` is false, leave out the successful cases of costly calls.
    """
    for call in calls:
        for argument, good in call.make()[1].items():
            legal = call.legal.get(argument, ())
            for value in EVERY:
                skipped = not costly and call.costly and (value in DISGUISED or value.name in legal)
                if value.make(good) is not NOTHING and not skipped:
                    yield case_of(call, argument, value)


def case_of(call: Call, argument: str, value: Hostile) -> Case:
    """Return the case of a call with a hostile value for one argument."""

    def attempt(folder: Path) -> Any:
        function, good = call.make()
        given = value.make(good[argument])
        with np.errstate(all="ignore"):
            return comparable(function(**good | {argument: given}))

    return Case(
        f"{call.name}({argument}={value.name})",
        attempt,
        partial(_judge, call, argument, value),
        partial(_refused, re.compile(call.called.get(argument, CALLED.get(argument, rf"\b{argument}\b")))),
        quick=value.name == "1j",
    )


def _refused(names: re.Pattern[str], error: BaseException) -> bool:
    """Return whether an error of this package names the argument, or Python itself refuses the call."""
    known = isinstance(error, StvkError) and not isinstance(error, AnalysisError)
    return (known and names.search(str(error)) is not None) or (isinstance(error, TypeError) and _raised_at_the_call(error))


def _raised_at_the_call(error: BaseException) -> bool:
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    return trace is not None and trace.tb_frame.f_code.co_filename == __file__


def _judge(call: Call, argument: str, value: Hostile, result: Any) -> None:
    """Accept a result if the value is legal, or if a plain value of the same meaning gives the same result; else raise `Wrong`."""
    if value.name in call.legal.get(argument, ()):
        return
    function, good = call.make()
    plain = value.plain(good[argument])
    if plain is NOTHING:
        raise Wrong(Verdict.SILENT, f"accepted: {result!r:.200}")
    expected = comparable(function(**good | {argument: plain}))
    if not same(result, expected):
        raise Wrong(Verdict.SILENT, f"{result!r:.200} instead of {expected!r:.200}")
