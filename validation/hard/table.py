"""The table of hard cases: in a terminal, as Markdown and as CSV."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from textwrap import wrap

from rich.markup import escape
from rich.table import Table

from skfem_stvk import System
from skfem_stvk.referee.terminal import grid

from .case import Case
from .judge import Verdict
from .methods import METHODS, Run

COLUMNS = ("method", "steps", "iterations", "time [s]", "status", "right?", "why not")
SHORT = ("method", "steps", "iter.", "s", "status", "right?", "why not")
STYLE = {Verdict.RIGHT: "green", Verdict.WRONG: "bold red", Verdict.SAID_SO: "yellow"}
#: Characters of the first column, and of the last.
NARROW, LAST = 34, 18


@dataclass(frozen=True)
class Row:
    """A case and what the methods made of it; `system` is the one without the volume term."""

    case: Case
    system: System
    runs: Sequence[Run]

    @property
    def size(self) -> str:
        return f"{self.system.mesh.nt} tets, {self.system.ndofs} dofs"

    @property
    def truth(self) -> str:
        """Where the right outcome comes from, without and with the volume term."""
        without, with_volume = self.case.truth.source, self.case.with_volume.source
        return without if without == with_volume else f"{without}; with the volume term: {with_volume}"


def printed(rows: Sequence[Row]) -> Table:
    """The table for a rich console: a block of lines a case, its name, size and truth beside the methods."""
    table = grid("Hard cases", "case, size, truth", *SHORT, right=SHORT[1:4])
    for row in rows:
        head = [f"[dim]{escape(line)}[/]" for line in wrap(f"{row.size}; {row.truth}", NARROW)]
        lines = zip_longest([escape(line) for line in wrap(row.case.name, NARROW)] + head, map(_cells, row.runs))
        for left, cells in lines:
            table.add_row(left or "", *(cells or ()))
        table.add_section()
    for column in table.columns:
        column.no_wrap = True
    return table


def _cells(run: Run) -> tuple[str, ...]:
    why = run.judgement.why if run.verdict is Verdict.WRONG else ""
    verdict = f"[{STYLE[run.verdict]}]{run.verdict}[/]"
    short = why if len(why) <= LAST else why[: LAST - 1] + "…"
    return run.method, str(run.steps), str(run.iterations), f"{run.seconds:.2f}", run.status, verdict, escape(short)


def tally(rows: Sequence[Row]) -> Iterator[str]:
    """How often each method was right, said that it was not, and was wrong without a word."""
    for method in METHODS:
        verdicts = [run.verdict for row in rows for run in row.runs if run.method == method]
        yield f"{method:<16}  " + ", ".join(f"{verdicts.count(verdict):2d} {verdict.value.lower()}" for verdict in Verdict)


def save(rows: Sequence[Row], folder: Path) -> tuple[Path, Path]:
    """Write hard-cases.md and hard-cases.csv; the messages in full are in the latter."""
    folder.mkdir(parents=True, exist_ok=True)
    head = ("case", "size", "truth", *COLUMNS)
    lines = [
        (
            row.case.name,
            row.size,
            row.truth,
            run.method,
            run.steps,
            run.iterations,
            f"{run.seconds:.2f}",
            run.status,
            str(run.verdict),
        )
        for row in rows
        for run in row.runs
    ]
    whys = [(run.judgement.why if run.verdict is Verdict.WRONG else "", run.message) for row in rows for run in row.runs]
    markdown, table = folder / "hard-cases.md", folder / "hard-cases.csv"
    marked = [head, ["---"] * len(head), *((*line, why) for line, (why, _) in zip(lines, whys, strict=True))]
    markdown.write_text("".join("| " + " | ".join(map(str, line)) + " |\n" for line in marked), encoding="utf-8")
    with table.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([(*head, "message"), *((*line, *why) for line, why in zip(lines, whys, strict=True))])
    return markdown, table
