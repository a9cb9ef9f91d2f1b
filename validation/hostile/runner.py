"""Execution of families of hostile inputs in this process, with limits of time and memory, and the table of their verdicts."""

from __future__ import annotations

import os
import shlex
import traceback
import warnings
from collections import Counter
from collections.abc import Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any, NamedTuple

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from skfem_stvk.terminal import WIDTH, grid

from ..limits import Hang, at_most, limited
from . import FAMILIES
from .case import Case, Verdict, Wrong

#: Length of the message about a wrong case, and about a case that the user named [characters].
SHORT, LONG = 300, 20_000


class Outcome(NamedTuple):
    """Verdict on a case."""

    family: str
    case: str
    verdict: Verdict
    why: str
    seconds: float


def cases_of(family: str) -> dict[str, Case]:
    """Return the cases of a family by name."""
    named: dict[str, Case] = {}
    for case in import_module(FAMILIES[family]).cases():
        if case.name in named:
            raise ValueError(f"{family} has two cases with the name {case.name!r}; expected unique names.")
        named[case.name] = case
    return named


def outcome(family: str, case: Case) -> Outcome:
    """Run a case in an empty folder and return its verdict with the reason."""
    begin, here = perf_counter(), Path.cwd()
    with TemporaryDirectory(prefix="hostile-") as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        os.chdir(folder)
        try:
            with at_most(case.gigabytes):
                verdict, why = limited(partial(_judged, case, Path(folder)), case.seconds)
        except Wrong as fault:
            verdict, why = fault.verdict, fault.why
        except Exception:
            verdict, why = Verdict.TRACEBACK, f"the judge failed: {traceback.format_exc()}"
        finally:
            os.chdir(here)
    return Outcome(family, case.name, verdict, why[:LONG], perf_counter() - begin)


def _judged(case: Case, folder: Path) -> tuple[Verdict, str]:
    begin = perf_counter()
    try:
        result: Any = case.attempt(folder)
    except Wrong:
        raise
    except BaseException as error:
        if isinstance(error, Hang) or perf_counter() - begin > case.seconds:  # `Hang` may be the cause of another error
            return Verdict.HANG, f"no end within {case.seconds:g} s: {_last_lines()}"
        if _out_of_memory(error):
            return Verdict.MEMORY, f"more than {case.gigabytes:g} GB: {_last_lines()}"
        if case.refused(error):
            return Verdict.REFUSED, f"{type(error).__name__}: {error}"
        return Verdict.TRACEBACK, _last_lines()
    case.judge(result)
    return Verdict.RIGHT, ""


def _out_of_memory(error: BaseException | None) -> bool:
    """Return whether the error is a `MemoryError`, or was caused by one."""
    while error is not None:
        if isinstance(error, MemoryError):
            return True
        error = error.__cause__ or error.__context__
    return False


def _last_lines() -> str:
    return traceback.format_exc()[-LONG // 2 :]


def run(families: Sequence[str], names: Sequence[str], quick: bool) -> int:
    """Run these families, or only the cases with these names, and print the verdicts. Return the exit code, 1 if any is wrong."""
    console, begin, done = Console(width=WIDTH, highlight=False), perf_counter(), []
    todo = [(family, case) for family in families for case in cases_of(family).values() if names or case.quick or not quick]
    if names:
        todo = [(family, case) for family, case in todo if f"{family}/{case.name}" in names]
        if len(todo) < len(names):
            raise SystemExit(f"There is no case {' or '.join(names)!r}; `--only` lists the families.")
    for family, case in todo:
        done.append(outcome(family, case))
        if names or done[-1].verdict.wrong:
            console.print(_story(done[-1], LONG if names else SHORT), soft_wrap=True)
    wrong = [one for one in done if one.verdict.wrong]
    console.print(table(done))
    for one in wrong if not names else ():
        command = f"python -m validation hostile --case {shlex.quote(f'{one.family}/{one.case}')}"
        console.print(f"[bold red]{one.verdict.value}[/]  {escape(command)}", soft_wrap=True)
    end = f"{len(wrong)} WRONG" if wrong else "none is wrong"
    console.print(f"{len(done)} cases in {perf_counter() - begin:.0f} s: {end}", soft_wrap=True)
    return 1 if wrong else 0


def table(done: Sequence[Outcome]) -> Table:
    """Return the table of the counts by family."""
    heads = ("cases", *(verdict.value for verdict in Verdict), "slowest [s]")
    counts = grid("Verdicts on hostile inputs", "family", *heads, right=heads)
    counts.columns[0].no_wrap = True
    for family in [*dict.fromkeys(one.family for one in done), "all"]:
        here = [one for one in done if family in ("all", one.family)]
        tally = Counter(one.verdict for one in here)
        cells = [f"[bold red]{tally[v]}[/]" if v.wrong and tally[v] else str(tally[v]) for v in Verdict]
        counts.add_row(family, str(len(here)), *cells, f"{max((one.seconds for one in here), default=0.0):.1f}")
    return counts


def _story(one: Outcome, most: int) -> str:
    style = "bold red" if one.verdict.wrong else "green"
    why = one.why if most == LONG else " ".join(one.why.split())[-most:]
    return f"[{style}]{one.verdict.value}[/]  {escape(f'{one.family}/{one.case}')}  {escape(why)}"
