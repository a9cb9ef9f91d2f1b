"""Runner of the studies of static solves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter

from rich.console import Console

from skfem_stvk.terminal import WIDTH

from .elastica import elastica
from .homogeneous import homogeneous
from .large import large
from .manufactured import manufactured
from .speed import speed
from .study import Study
from .turek_hron import turek_hron
from .work_precision import work_precision


def run(names: Sequence[str], quick: bool, out: str | None) -> int:
    """Run the named studies, print them and write pictures to the folder `out`. The exit code is 0 if all claims hold."""
    studies: dict[str, Callable[[bool], Study]] = {
        "homogeneous": homogeneous,
        "turek-hron": turek_hron,
        "manufactured": manufactured,
        "elastica": elastica,
        "work-precision": lambda quick: work_precision(quick, None if out is None else Path(out)),
        "speed": speed,
        "large": large,
    }
    console, failed = Console(width=WIDTH, highlight=False), []
    for name in names:
        start = perf_counter()
        study = studies[name](quick)
        console.print(study.rendered(), f"{perf_counter() - start:.1f} s\n")
        failed += [] if study.passed else [study.name]
    console.print(f"DOES NOT HOLD: {', '.join(failed)}" if failed else f"all {len(names)} claims hold")
    return 1 if failed else 0
