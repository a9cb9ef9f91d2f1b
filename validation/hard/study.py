"""Runner of the hard cases with all methods: prints progress and tables, and saves the tables."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from pathlib import Path
from time import perf_counter

from rich.console import Console
from rich.markup import escape

from skfem_stvk.terminal import WIDTH

from .case import Case
from .judge import Verdict
from .methods import METHODS, OURS, Run
from .methods import run as run_method
from .motion.study import memory, motion
from .pictures import picture
from .table import Row, printed, save, tally

#: Groups that have tables of their own, with functions that return the failed claims.
TABLES: dict[str, Callable[[Console, bool, Path | None], list[str]]] = {"motion": motion, "memory": memory}


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
    begin, rows = perf_counter(), []
    for case in cases(names, quick):
        console.print(f"[dim]{perf_counter() - begin:5.0f} s  {escape(case.name)}[/]")
        rows.append(row_of(case))
    failed = [failure for row in rows for failure in failures(row)]
    lines = [*tally(rows), *(f"[bold red]DOES NOT HOLD[/] {escape(failure)}" for failure in failed)]
    if rows and out is not None:
        lines += [f"written: {path}" for path in (*save(rows, out), picture(rows, out))]
    if rows:
        console.print(printed(rows), *lines, sep="\n")
        console.print(f"{len(rows)} cases in {perf_counter() - begin:.0f} s" + ("" if failed else ": every claim holds"))
    return failed


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
