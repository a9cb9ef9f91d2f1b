"""Result of a study: the claim, the measured rows, and whether the claim holds; and the runner of all groups of studies."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from inspect import signature
from pathlib import Path
from time import perf_counter
from typing import Any

from rich.console import Console, Group, RenderableType
from rich.markup import escape

from skfem_stvk.terminal import WIDTH, grid

_recorded: list[list[Study]] = []


@contextmanager
def recording() -> Iterator[list[Study]]:
    """Collect the studies that are rendered within the `with` block, for a report."""
    _recorded.append([])
    try:
        yield _recorded[-1]
    finally:
        _recorded.pop()


@dataclass(frozen=True)
class Study:
    """Claim with the measured rows.

    Parameters
    ----------
    name, claim
        In words. The claim is "" if times are only measured, as in quick runs, which must not fail on a busy machine.
    columns
        Headings of the table.
    rows
        Cells of the table as text. Words are aligned left, numbers right.
    failures
        Contradictions to the claim, in words; the claim holds if there are none.
    notes
        Remarks below the table.
    pictures
        Paths of the pictures.
    """

    name: str
    claim: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    failures: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    pictures: tuple[Path, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether the claim holds and there is at least one row."""
        return bool(self.rows) and not self.failures

    def rendered(self) -> RenderableType:
        """Return the study as a rich renderable, and add it to the lists of `recording`."""
        for studies in _recorded:
            studies.append(self)
        right = tuple(column for i, column in enumerate(self.columns) if all(_is_number(row[i]) for row in self.rows))
        table = grid(self.name, *self.columns, right=right)
        for row in self.rows:
            table.add_row(*map(escape, row))
        verdict = "[bold green]holds[/]" if self.passed else "[bold red]DOES NOT HOLD[/]"
        claim = f"{verdict}: {escape(self.claim)}" if self.claim or not self.passed else "measured, without a claim"
        lines = [claim, *map(escape, self.failures if self.rows else ("nothing was measured",))]
        return Group(table, *lines, *map(escape, self.notes), *(f"picture: {path}" for path in self.pictures), "")


def _is_number(text: str) -> bool:
    return not text or text[0].isdigit() or (text[0] in "-+." and text[1:2].isdigit()) or text.startswith("nan")


def measured(group: str, where: str, quick: bool, folder: Path | None) -> Iterable[Study]:
    """Return the studies of a function. `where` is its module in the package `group` and its name, "hertz.stiffness".

    Its arguments are `quick` and, if it draws, the folder for pictures. It returns a study or several.
    """
    module, name = where.split(".")
    function = getattr(import_module(f"{group}.{module}"), name)
    options: dict[str, Any] = {"folder": folder} if "folder" in signature(function).parameters else {}
    found: Study | Iterable[Study] = function(quick, **options)
    return (found,) if isinstance(found, Study) else found


def run(group: str, studies: Mapping[str, str], names: Sequence[str], quick: bool, out: str | None = None) -> int:
    """Run the named studies of a group, print them and write pictures to the folder `out`. Return 0 if all claims hold."""
    folder = None if out is None else Path(out)
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
    console, claims, failed = Console(width=WIDTH, highlight=False), 0, []
    for name in names:
        start = perf_counter()
        for study in measured(group, studies[name], quick, folder):
            console.print(study.rendered())
            claims += bool(study.claim)
            failed += [] if study.passed else [study.name]
        console.print(f"{name}: {perf_counter() - start:.1f} s\n")
    console.print(f"DOES NOT HOLD: {', '.join(failed)}" if failed else f"all {claims} claims hold")
    return 1 if failed else 0
