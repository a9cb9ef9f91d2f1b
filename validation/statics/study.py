"""What a study found: a claim, the rows that were measured, and whether the claim holds."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from rich.console import Group, RenderableType
from rich.markup import escape

from skfem_stvk.terminal import grid

_recorded: list[list[Study]] = []


@contextmanager
def recording() -> Iterator[list[Study]]:
    """The studies that are rendered within: a report has them as they are, besides what is printed."""
    _recorded.append([])
    try:
        yield _recorded[-1]
    finally:
        _recorded.pop()


@dataclass(frozen=True)
class Study:
    """A claim and what was measured for it.

    Parameters
    ----------
    name, claim : in words; "" where times are measured and none is claimed, as by quick runs, which a busy machine must not fail.
    columns : heads of the table.
    rows : the table; words to the left, numbers (as text) to the right.
    failures : what contradicts the claim, in words; it holds if there is none.
    notes : what a reader of the table should know.
    pictures : files that were written.
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
        """Whether the claim holds, of at least one row."""
        return bool(self.rows) and not self.failures

    def rendered(self) -> RenderableType:
        """The study for a rich console."""
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
