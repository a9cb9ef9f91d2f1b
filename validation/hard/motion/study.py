"""Runner of all scenes with all methods: prints progress and tables, and saves the tables."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from rich.console import Console

from .. import table
from ..judge import Verdict
from ..methods import Run
from ..table import Row
from . import SCENES
from .methods import METHODS, OURS
from .methods import run as run_method
from .scene import Scene

IN_MOTION = table.Style("Hard cases in motion", "hard-cases-in-motion", tuple(METHODS), reasons=False)


def motion(console: Console, quick: bool, out: Path | None) -> list[str]:
    """Print the table of bodies in motion, and return the failed claims."""
    return table.shown(console, scenes(quick), row_of, failures, IN_MOTION, out)


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


__all__ = ["Run", "failures", "motion", "row_of", "scenes"]
