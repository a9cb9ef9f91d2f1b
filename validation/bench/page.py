"""Output of a run: in a terminal, as the page of the docs, and as files."""

from __future__ import annotations

import json
import textwrap
from pathlib import Path

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table as RichTable
from rich.text import Text

from skfem_stvk.terminal import as_text, grid

from .results import Benchmark
from .tables import FigureTable, tables

WIDTH = 132
NAME = "benchmark"
PICTURES = {
    "speed-error": "Time of a call against its error: down and to the left is better",
    "size": "Time of a call per tetrahedron, against the size of the mesh",
}
INTRODUCTION = """\
Look up the time, memory and errors of W, F, K and K v, compared with other codes and with the limits of the machine. This command
measures them in a checkout of the project and writes this page:

    {command}

{warning}It ran on {date}, on this machine and with these versions:

{head}"""
NEXT = """Next: [how the kernels work, and what was tried](speed.md), [a program](../programs/speed.py), and
[all records](index.md)."""
METHOD = """\
Boxes are grids with six tetrahedra per cell, in scikit-fem's order. Parts are a bracket meshed by Gmsh (`pip install gmsh`).
Half of all tetrahedra have negative orientation. Poisson's ratio is 0.3, strains are about 0.6. Compared calls alternate.
Each round makes one untimed call, which fills the caches, and five timed calls. Without the untimed call a CSR product took
twice as long here, after other work. The tables show the best time and the median. All calls run on one thread unless a
table says otherwise. K is written into the CSR matrix that the solver takes (`tangent(u, out=K)`). The CSR product is scipy's, with
the same K. The C loop is a plain element loop of this project (`validation/bench/control.c`). It is compiled with `-O3
-march=native -ffast-math` if there is a compiler. scikit-fem's forms are optimised: they use one quadrature point, and all constant
parts are computed in advance. The textbook form is the edge form with `zeta = |p|^2 - |P|^2` from positions, in NumPy and sparse
products. The peers are timed with the functions that their codes offer for the same law and element (`skfem_stvk/referee/peers`).

The memory limit counts these bytes, each read or written once:

- F: vertices, coefficients and coordinates of the tetrahedra, u and F.
- K: the tetrahedra with the ids of their edges, their positions in K, and the values of K. The blocks of the edges are written and
  read again.
- K v: the blocks and vertices of the edges, and both vectors.

The tables of memory count the same arrays and the scratch arrays of the threads.

The benchmark does not measure time in a solver, I/O, more than two threads, second-order elements or other laws. It does not
measure the memory of scikit-fem and the peers. scikit-fem has no single precision."""


def rendered(results: Benchmark) -> RenderableType:
    """Return the run for a rich console: head, tables, missing results, and the targets at the end."""
    shown = tables(results)
    order = [*shown[1:], *shown[:1]] if shown and shown[0].title == "Targets" else shown
    parts: list[RenderableType] = [Text(head(results))]
    for table in order:
        parts += [grid_of(table, escape(table.title)), *([Text(table.note, style="dim")] if table.note else []), Text()]
    return Group(*parts, _last_line(results))


def head(results: Benchmark) -> str:
    """Return the lines that describe the machine, its bandwidth and the versions of packages."""
    machine, versions = results.header["machine"], results.header["versions"]
    bandwidth = "" if results.bandwidth is None else f", a copy reads and writes {results.bandwidth / 1e9:.1f} GB/s on one thread"
    named = ", ".join(f"{name} {version}" for name, version in versions.items() if version != "not installed")
    return "\n".join([f"{machine['processor']}, {machine['cores']} cores{bandwidth}", *textwrap.wrap(named, WIDTH - 8)])


def grid_of(table: FigureTable, title: str = "") -> RichTable:
    """Return the table for a rich console, in the style of this package's tables."""
    shown = grid(title, *map(escape, table.columns))
    for column in shown.columns[table.words :]:
        column.justify, column.no_wrap = "right", True
    for row in table.rows:
        shown.add_row(*(cell if isinstance(cell, Text) else Text(cell) for cell in row))
    return shown


def _last_line(results: Benchmark) -> Text:
    words = f"{results.plan.name} run, {results.seconds:.0f} s"
    if results.interrupted:
        words += ", interrupted; the tables show what was measured before"
    return Text(words, style="yellow" if results.interrupted or results.failures else "")


def save(results: Benchmark, folder: str | Path) -> None:
    """Write benchmark.json, benchmark.md and its pictures."""
    from .plots import speed_against_error, time_against_size

    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{NAME}.json").write_text(json.dumps(results.as_dict(), indent=1) + "\n", encoding="utf-8")
    drawn = {"speed-error": speed_against_error(results), "size": time_against_size(results)}
    for picture, figure in drawn.items():
        figure.savefig(folder / f"{NAME}-{picture}.png", dpi=140)
    (folder / f"{NAME}.md").write_text(page(results), encoding="utf-8")


def page(results: Benchmark) -> str:
    """Return the run as a page in Markdown."""
    quick = "" if results.plan.name == "full" else f" --{results.plan.name}"
    command = f"python -m validation bench{quick} --out docs/measurements"
    warning = "**Interrupted**: the tables show what was measured before.\n\n" if results.interrupted else ""
    intro = INTRODUCTION.format(command=command, warning=warning, date=results.header["date"][:10], head=_indented(head(results)))
    parts = [f"# The benchmark\n\n{intro}"]
    shown = tables(results)
    parts += [_section(table) for table in shown[:1]]
    parts += [f"![{words}](benchmark-{picture}.png)" for picture, words in PICTURES.items()]
    parts += ["## How it is measured\n\n" + METHOD]
    return "\n\n".join([*parts, *(_section(table) for table in shown[1:]), NEXT]) + "\n"


def _section(table: FigureTable) -> str:
    note = f"{textwrap.fill(table.note, WIDTH)}\n\n" if table.note else ""
    return f"## {table.title}\n\n{note}{_indented(as_text(grid_of(table), WIDTH - 4))}"


def _indented(text: str) -> str:
    return "\n".join(f"    {line}".rstrip() for line in text.splitlines())
