"""Runner of the hard cases with all methods: prints progress and tables, and saves the tables."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from pathlib import Path

from rich.console import Console

from skfem_stvk.terminal import WIDTH

from . import table
from .case import Case
from .judge import Verdict
from .methods import METHODS, OURS, Run
from .methods import run as run_method
from .motion.study import motion
from .table import Row

#: Groups that have tables of their own, with functions that return the failed claims.
TABLES: dict[str, Callable[[Console, bool, Path | None], list[str]]] = {"motion": motion}


def run(names: Sequence[str], quick: bool, out: str | None) -> int:
    """Run the named groups, print the tables, and save them with pictures in the folder `out`; return 0 if no claim failed."""
    console, folder = Console(width=WIDTH, highlight=False), None if out is None else Path(out)
    failed = at_rest(console, [name for name in names if name not in TABLES], quick, folder)
    for name in names:
        if name in TABLES:
            failed += TABLES[name](console, quick, folder)
    return 1 if failed else 0


def at_rest(console: Console, names: Sequence[str], quick: bool, out: Path | None) -> list[str]:
    """Print the table of these groups, and return the failed claims."""
    todo = cases(names, quick)
    return table.shown(console, todo, row_of, failures, table.AT_REST, out) if todo else []


def group(name: str) -> list[Case]:
    """Return the cases of a group. The file of this name has a function of the same name."""
    made: list[Case] = getattr(import_module(f".{name}", __package__), name)()
    return made


def cases(names: Sequence[str], quick: bool) -> list[Case]:
    """Return the cases of these groups; `quick` omits the slow ones."""
    return [case for name in names if name not in TABLES for case in group(name) if case.quick or not quick]


def row_of(case: Case) -> Row:
    """Run all methods on a case."""
    return Row(case, case.body().system(volume=False), [run_method(case, method) for method in case.methods or METHODS])


def failures(row: Row) -> Iterator[str]:
    """Yield the contradictions to the claims.

    The default is never wrong without a warning, right if it must be, and its message contains the required patterns.
    """
    for run in row.runs:
        if run.method not in OURS:
            continue
        truth = METHODS[run.method].case(row.case).truth_of(run.volume)
        name = f"{row.case.name}, {run.method}"
        if run.verdict is Verdict.WRONG:
            yield f"{name}: reported as success, but {run.judgement.why}"
        elif run.verdict is Verdict.REPORTED and truth.error is not None and not truth.refused:
            yield f"{name}: a right state exists; got: {run.message}"
        if run.unsaid:
            yield f"{name}: not said: {', '.join(run.unsaid)}; message: {run.message}"


__all__ = ["Run", "cases", "failures", "group", "row_of", "run"]
