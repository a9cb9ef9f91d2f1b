"""Runner of all scenes with all methods, and of runs of very many steps: prints progress and tables, and saves the tables."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from time import perf_counter

from rich.console import Console
from rich.markup import escape

from skfem_stvk.terminal import grid

from ..judge import Verdict
from ..methods import Run
from ..pictures import START, picture
from ..table import Row, printed, save, tally
from . import SCENES
from .memory import LONG, Growth, grown
from .methods import METHODS, OURS
from .methods import run as run_method
from .scene import Scene

NAME = "hard-cases-in-motion"
#: Pictures: names of scenes, and the method whose last state is drawn.
SHOWN = (
    ("drop a block from 0.2 m", "energy-momentum"),
    ("drop a block from 0.2 m", "energy-momentum + volume"),
    ("let a bar swing, in steps of 1/30 s", "energy-momentum"),
    ("drop a block from 1 m", "eq. 9"),
    ("drop a block from 1 m", "energy-momentum + volume"),
    ("crack a whip", "energy-momentum"),
    ("stretch a bar by 30 % and let go", "plain eq. 9"),
    ("stretch a bar by 30 % and let go", "energy-momentum + volume"),
    ("kick a core of 1e9 Pa between ends of 1e2 Pa, in steps of 1/30 s", "energy-momentum"),
    ("start from random positions, damped", START),
    ("start from random positions, damped", "eq. 9 + volume"),
    ("throw a block of 1e9 Pa that flips, in steps of 1/30 s", "energy-momentum"),
)


def motion(console: Console, quick: bool, out: Path | None) -> list[str]:
    """Print the table of bodies in motion, and return the failed claims."""
    begin, rows = perf_counter(), []
    for scene in scenes(quick):
        console.print(f"[dim]{perf_counter() - begin:5.0f} s  {escape(scene.name)}[/]")
        rows.append(row_of(scene))
    failed = [failure for row in rows for failure in failures(row)]
    lines = [*tally(rows, METHODS), *(f"[bold red]DOES NOT HOLD[/] {escape(failure)}" for failure in failed)]
    if out is not None:
        lines += [f"written: {path}" for path in (*save(rows, out, NAME, METHODS), picture(rows, out, NAME, SHOWN))]
    console.print(printed(rows, "Hard cases in motion", reasons=False), *lines, sep="\n")
    console.print(f"{len(rows)} scenes in {perf_counter() - begin:.0f} s" + ("" if failed else ": every claim holds"))
    return failed


def scenes(quick: bool) -> list[Scene]:
    """Return all scenes; `quick` omits the slow ones."""
    return [scene for make in SCENES for scene in make() if scene.quick or not quick]


def row_of(scene: Scene) -> Row:
    """Run all methods of a scene."""
    return Row(scene, scene.body().system(volume=False), [run_method(scene, method) for method in scene.methods or METHODS])


def failures(row: Row) -> Iterator[str]:
    """Yield the contradictions to the claims.

    This package is never wrong without a warning, and right in the scenes that require it.
    """
    scene = row.case
    assert isinstance(scene, Scene)
    for run in row.runs:
        ending = scene.truth_of(run.volume)
        if run.method in OURS and run.verdict is Verdict.WRONG:
            yield f"{scene.name}, {run.method}: reported as success, but {run.judgement.why}"
        elif run.method in scene.right and ending.error is not None and run.verdict is not Verdict.RIGHT:
            yield f"{scene.name}, {run.method}: a right motion exists; got: {run.judgement.why}"


def memory(console: Console, quick: bool, out: Path | None) -> list[str]:
    """Print the table of long runs, and return the failed claims."""
    columns = "steps", "s", "ledger, MB", "other, MB", "process, MB", "energy off by"
    table = grid("Long runs", "integrator", *columns, right=columns)
    found = [grown(integrator, few if quick else many) for integrator, few, many in LONG]
    for one in found:
        sizes = f"{one.ledger / 1e6:.1f}", f"{one.other / 1e6:.3f}", f"{one.process / 1e6:.1f}"
        table.add_row(one.name, f"{one.steps:.0e}", f"{one.seconds:.0f}", *sizes, f"{one.energy:.1e}")
    console.print(table)
    return [failure for one in found for failure in _failures(one)]


def _failures(one: Growth) -> Iterator[str]:
    if not one.holds:
        yield f"{one.name}: {one.steps} steps left {one.other / 1e6:.3f} MB without the ledger, energy off by {one.energy:.1e}"


__all__ = ["Run", "failures", "memory", "motion", "row_of", "scenes"]
