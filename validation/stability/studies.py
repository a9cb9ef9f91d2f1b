"""Execution of the studies of stability."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter

from rich.console import Console

from skfem_stvk.terminal import WIDTH

from ..statics.study import Study
from .arch import arch
from .column import column
from .corotated import corotated
from .dome import dome
from .ellipticity import ellipticity
from .law import law
from .not_found import NotFoundError
from .picture import DrawnStudy, draw
from .post_buckling import post_buckling
from .snap_through import snap_through


def run(names: Sequence[str], quick: bool, out: str | None) -> int:
    """Run the studies with these names, print them and save a picture of their paths in `out`. Return 0 if all claims hold."""
    studies: dict[str, Callable[[bool], Study]] = {
        "snap-through": snap_through,
        "arch": arch,
        "dome": dome,
        "column": column,
        "corotated": corotated,
        "post-buckling": post_buckling,
        "law": law,
        "ellipticity": ellipticity,
    }
    console, failed, panels = Console(width=WIDTH, highlight=False), [], []
    for name in names:
        start = perf_counter()
        study = _found(studies[name], quick)
        console.print(study.rendered(), f"{perf_counter() - start:.1f} s\n")
        failed += [] if study.passed else [study.name]
        panels += [study.panel] if isinstance(study, DrawnStudy) and study.panel is not None else []
    if out is not None and panels:
        console.print(f"picture: {draw([panel() for panel in panels], Path(out) / 'stability.png')}")
    console.print(f"DOES NOT HOLD: {', '.join(failed)}" if failed else f"all {len(names)} claims hold")
    return 1 if failed else 0


def _found(study: Callable[[bool], Study], quick: bool) -> Study:
    """Return the study. If its subject was not found, return a study that does not hold."""
    try:
        return study(quick)
    except NotFoundError as error:
        return Study(study.__name__, str(study.__doc__), ("study",), ((study.__name__,),), (str(error),))
