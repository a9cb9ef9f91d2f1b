"""Runner of the studies of motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter

from rich.console import Console

from skfem_stvk.terminal import WIDTH

from ..statics.study import Study
from .blow_ups import blow_ups
from .csm3 import csm3
from .fast_swings import fast_swings
from .flight import flight
from .independent import independent
from .large_steps import large_steps
from .limit import limit
from .real_time import speed
from .step_solvers import step_solvers
from .tangents import tangents
from .vibrations import vibrations
from .work_precision import work_precision


def run(names: Sequence[str], quick: bool, out: str | None) -> int:
    """Run the named studies, print them and write pictures to the folder `out`. The exit code is 0 if all claims hold."""
    studies: dict[str, Callable[[bool, Path | None], Sequence[Study]]] = {
        "independent": independent,
        "csm3": csm3,
        "flight": flight,
        "vibrations": vibrations,
        "limit": limit,
        "large-steps": large_steps,
        "fast-swings": fast_swings,
        "blow-ups": blow_ups,
        "tangents": tangents,
        "work-precision": work_precision,
        "speed": speed,
        "step-solvers": step_solvers,
    }
    folder = None if out is None else Path(out)
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
    console, claims, failed = Console(width=WIDTH, highlight=False), 0, []
    for name in names:
        start = perf_counter()
        for study in studies[name](quick, folder):
            console.print(study.rendered())
            claims += bool(study.claim)
            failed += [] if study.passed else [study.name]
        console.print(f"{perf_counter() - start:.1f} s\n")
    console.print(f"DOES NOT HOLD: {', '.join(failed)}" if failed else f"all {claims} claims hold")
    return 1 if failed else 0
