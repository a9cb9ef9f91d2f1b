"""Execution of families of hostile inputs, with a table of their verdicts."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Sequence
from time import perf_counter

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from skfem_stvk.errors import name_known
from skfem_stvk.terminal import WIDTH, grid

from . import FAMILIES
from .case import Verdict
from .runner import Job, Outcome, jobs, outcomes

#: Length of the message about a wrong case, and about a case that the user named [characters].
SHORT, LONG = 300, 20_000


def run(families: Sequence[str], names: Sequence[str], quick: bool) -> int:
    """Run these families, or only the cases with these names, and print the verdicts. Return the exit code, 1 if any is wrong."""
    console, begin = Console(width=WIDTH, highlight=False), perf_counter()
    todo = jobs({family: FAMILIES[family] for family in families}, quick and not names)
    if names:
        todo = [job for name in names for job in _named(name, todo)]
    done = []
    for outcome in outcomes(todo):
        done.append(outcome)
        if names:
            console.print(_story(outcome, LONG), soft_wrap=True)
        elif outcome.verdict.wrong:
            console.print(f"[dim]{perf_counter() - begin:5.0f} s[/]  {_story(outcome, SHORT)}", soft_wrap=True)
    wrong = sorted(outcome for outcome in done if outcome.verdict.wrong)
    console.print(table(done))
    for outcome in wrong if not names else ():
        console.print(f"[bold red]{outcome.verdict.value}[/]  {escape(_command(outcome))}", soft_wrap=True)
    console.print(
        f"{len(done)} cases in {perf_counter() - begin:.0f} s: " + (f"{len(wrong)} WRONG" if wrong else "none is wrong"),
        soft_wrap=True,
    )
    return 1 if wrong else 0


def table(done: Sequence[Outcome]) -> Table:
    """Return the table of the counts by family."""
    shown = [verdict for verdict in Verdict if verdict is not Verdict.NOT_RUN or any(o.verdict is verdict for o in done)]
    heads = ("cases", *(verdict.value for verdict in shown), "slowest [s]")
    counts = grid("Verdicts on hostile inputs", "family", *heads, right=heads)
    counts.columns[0].no_wrap = True
    for family in dict.fromkeys(outcome.family for outcome in done):
        _row(counts, family, [outcome for outcome in done if outcome.family == family], shown)
    counts.add_section()
    _row(counts, "all", done, shown)
    return counts


def _row(counts: Table, name: str, done: Sequence[Outcome], shown: Sequence[Verdict]) -> None:
    tally = Counter(outcome.verdict for outcome in done)
    cells = [f"[bold red]{tally[v]}[/]" if v.wrong and tally[v] else str(tally[v]) for v in shown]
    counts.add_row(name, str(len(done)), *cells, f"{max((outcome.seconds for outcome in done), default=0.0):.1f}")


def _named(name: str, todo: Sequence[Job]) -> list[Job]:
    """Return the case with this name, "FAMILY/CASE"."""
    found = [job for job in todo if f"{job.family}/{job.case.name}" == name]
    if not found:
        raise SystemExit(f"There is no case {name!r}; {name_known(name, [f'{job.family}/{job.case.name}' for job in todo])[-300:]}")
    return found


def _story(outcome: Outcome, most: int) -> str:
    style = "bold red" if outcome.verdict.wrong else "green"
    why = outcome.why if most == LONG else " ".join(outcome.why.split())[-most:]
    return f"[{style}]{outcome.verdict.value}[/]  {escape(f'{outcome.family}/{outcome.case}')}  {escape(why)}"


def _command(outcome: Outcome) -> str:
    return f"python -m validation hostile --case {shlex.quote(f'{outcome.family}/{outcome.case}')}"
