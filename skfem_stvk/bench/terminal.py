"""A run in a terminal, and as plain text."""

from __future__ import annotations

import io
import textwrap

from rich.console import Console, Group, RenderableType
from rich.markup import escape
from rich.table import Table as RichTable
from rich.text import Text

from ..referee.terminal import grid
from .results import Benchmark
from .tables import Table, tables

WIDTH = 132


def rendered(results: Benchmark) -> RenderableType:
    """For a rich console: head, tables, what is missing, and the targets at the end, where they are seen."""
    shown = tables(results)
    order = [*shown[1:], *shown[:1]] if shown and shown[0].title == "Targets" else shown
    parts: list[RenderableType] = [Text(head(results))]
    for table in order:
        parts += [grid_of(table, escape(table.title)), *([Text(table.note, style="dim")] if table.note else []), Text()]
    return Group(*parts, _last_line(results))


def head(results: Benchmark) -> str:
    """Machine, bandwidth and versions."""
    machine, versions = results.header["machine"], results.header["versions"]
    bandwidth = "" if results.bandwidth is None else f", a copy reads and writes {results.bandwidth / 1e9:.1f} GB/s on one thread"
    named = ", ".join(f"{name} {version}" for name, version in versions.items() if version != "not installed")
    return "\n".join([f"{machine['processor']}, {machine['cores']} cores{bandwidth}", *textwrap.wrap(named, WIDTH - 8)])


def grid_of(table: Table, title: str = "") -> RichTable:
    """In the house style."""
    shown = grid(title, *map(escape, table.columns))
    for column in shown.columns[table.words :]:
        column.justify, column.no_wrap = "right", True
    for row in table.rows:
        shown.add_row(*(cell if isinstance(cell, Text) else Text(cell) for cell in row))
    return shown


def as_text(renderable: RenderableType, width: int = WIDTH) -> str:
    """Plain text, without blanks at the ends of lines."""
    buffer = io.StringIO()
    Console(file=buffer, width=width, no_color=True, highlight=False).print(renderable)
    return "\n".join(line.rstrip() for line in buffer.getvalue().splitlines()).strip("\n")


def _last_line(results: Benchmark) -> Text:
    words = f"{results.plan.name} run, {results.seconds:.0f} s"
    if results.interrupted:
        words += ", interrupted: what was measured until then"
    return Text(words, style="yellow" if results.interrupted or results.failures else "")
