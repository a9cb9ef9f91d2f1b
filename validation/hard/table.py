"""Table of hard cases: in a terminal, as Markdown and as CSV."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from textwrap import wrap
from time import perf_counter
from typing import Any, NamedTuple

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from skfem_stvk import System
from skfem_stvk.terminal import grid

from .case import Case
from .judge import Verdict
from .methods import METHODS, Run

COLUMNS = ("method", "steps", "iterations", "time [s]", "status", "right?", "why not")
SHORT = ("method", "steps", "iter.", "s", "status", "right?", "why not")
STYLE = {Verdict.RIGHT: "green", Verdict.WRONG: "bold red", Verdict.REPORTED: "yellow"}
#: Widths of the first column, of the status, and of the last column [characters].
NARROW, STATUS, LAST = 34, 24, 18


@dataclass(frozen=True)
class Row:
    """Case with the results of the methods; `system` has no volume term."""

    case: Case
    system: System
    runs: Sequence[Run]

    @property
    def size(self) -> str:
        mesh = self.system.mesh
        cells = "quadratic " * (mesh.element.degree == 2) + {1: "segments", 2: "triangles", 3: "tets"}[mesh.k]
        return f"{self.system.mesh.nt} {cells}, {self.system.ndofs} dofs"

    @property
    def truth(self) -> str:
        """Source of the right outcome, and the sources with the volume term and of the invertible law if they differ."""
        case = self.case
        others = {"with the volume term": case.with_volume, "invertible": case.invertible or case.truth}
        differ = [f"{name}: {truth.source}" for name, truth in others.items() if truth.source != case.truth.source]
        return "; ".join([case.truth.source, *differ])


class Style(NamedTuple):
    """Title and file name of a table, its methods, and whether the last column says why a result is wrong."""

    title: str
    name: str
    methods: tuple[str, ...]
    reasons: bool = True


AT_REST = Style("Hard cases", "hard-cases", tuple(METHODS))


def shown(
    console: Console,
    cases: Sequence[Any],
    row_of: Callable[[Any], Row],
    failures: Callable[[Row], Iterator[str]],
    style: Style,
    out: Path | None,
) -> list[str]:
    """Run the cases, print progress and the table, save it in the folder `out`, and return the failed claims."""
    begin, rows = perf_counter(), []
    for case in cases:
        console.print(f"[dim]{perf_counter() - begin:5.0f} s  {escape(case.name)}[/]")
        rows.append(row_of(case))
    failed = [failure for row in rows for failure in failures(row)]
    lines = [*tally(rows, style.methods), *(f"[bold red]DOES NOT HOLD[/] {escape(failure)}" for failure in failed)]
    if out is not None:
        lines += [f"written: {path}" for path in save(rows, out, style)]
    console.print(printed(rows, style), *lines, sep="\n")
    console.print(f"{len(rows)} cases in {perf_counter() - begin:.0f} s" + ("" if failed else ": every claim holds"))
    return failed


def printed(rows: Sequence[Row], style: Style = AT_REST) -> Table:
    """Return the table for a rich console. Name, size and right outcome are left of the methods."""
    shown = len(SHORT) if style.reasons else len(SHORT) - 1
    table = grid(style.title, "case, size, truth", *SHORT[:shown], right=SHORT[1:4])
    for row in rows:
        head = [f"[dim]{escape(line)}[/]" for line in wrap(f"{row.size}; {row.truth}", NARROW)]
        lines = zip_longest([escape(line) for line in wrap(row.case.name, NARROW)] + head, map(_cells, row.runs))
        for left, cells in lines:
            table.add_row(left or "", *(cells or ())[:shown])
        table.add_section()
    for column in table.columns:
        column.no_wrap = True
    return table


def _cells(run: Run) -> tuple[str, ...]:
    why = _why(run)
    verdict = f"[{STYLE[run.verdict]}]{run.verdict}[/]"
    numbers = str(run.steps), str(run.iterations), f"{run.seconds:.2f}"
    return run.method, *numbers, escape(_cut(run.status, STATUS)), verdict, escape(_cut(why, LAST))


def _cut(text: str, most: int) -> str:
    return text if len(text) <= most else text[: most - 1] + "…"


def tally(rows: Sequence[Row], methods: Iterable[str]) -> Iterator[str]:
    """Yield the numbers of right, reported and wrong outcomes of each method."""
    for method in methods:
        verdicts = [run.verdict for row in rows for run in row.runs if run.method == method]
        yield f"{method:<24}  " + ", ".join(f"{verdicts.count(verdict):2d} {verdict.value.lower()}" for verdict in Verdict)


def save(rows: Sequence[Row], folder: Path, style: Style = AT_REST) -> tuple[Path, Path]:
    """Write NAME.md, one line per case, and NAME.csv, one line per run with its complete message."""
    folder.mkdir(parents=True, exist_ok=True)
    head = ("case", "size", "truth")
    lines = [(row, run) for row in rows for run in row.runs]
    methods, markdown, table = style.methods, folder / f"{style.name}.md", folder / f"{style.name}.csv"
    with markdown.open("w", encoding="utf-8") as file:
        for cells in ([*head, *methods], ["---"] * (len(head) + len(methods)), *(_marked(row, methods) for row in rows)):
            file.write("| " + " | ".join(cells) + " |\n")
    with table.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([*head, *COLUMNS, "message"])
        for row, run in lines:
            numbers = run.steps, run.iterations, f"{run.seconds:.2f}", run.status, str(run.verdict)
            writer.writerow([row.case.name, row.size, row.truth, run.method, *numbers, _why(run), run.message])
    return markdown, table


def _marked(row: Row, methods: Sequence[str]) -> list[str]:
    """Return a line of Markdown with the verdict, steps, iterations and time of each method."""
    runs = {run.method: run for run in row.runs}
    return [row.case.name, row.size, row.truth, *(_marked_run(runs[method]) if method in runs else "-" for method in methods)]


def _marked_run(run: Run) -> str:
    verdict = f"**{run.verdict}**: {_why(run)}" if run.verdict is Verdict.WRONG else f"{run.verdict} ({run.status})"
    steps = f"{run.steps} step{'s' * (run.steps != 1)}"
    return f"{verdict}; {steps}, {run.iterations} it., {run.seconds:.2f} s".replace("right (converged)", "right").replace(
        "right (finished)", "right"
    )


def _why(run: Run) -> str:
    return run.judgement.why if run.verdict is Verdict.WRONG else ""
