"""Runner of the studies of elements."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from time import perf_counter

from rich.console import Console

from skfem_stvk.terminal import WIDTH

from ..statics.study import Study
from .costs import costs
from .flag import flag_of_quadratic_triangles
from .hard import hard_cases
from .orders import orders
from .peers import peers
from .solvers import solvers
from .work_precision import work_precision

Several = Iterable[Study]


def run(names: Sequence[str], quick: bool, out: str | None) -> int:
    """Run the named studies, print them and write pictures to the folder `out`. The exit code is 0 if all claims hold."""
    studies: dict[str, Callable[[bool], Several]] = {
        "orders": orders,
        "work-precision": lambda quick: work_precision(quick, None if out is None else Path(out)),
        "turek-hron": flag_of_quadratic_triangles,
        "costs": costs,
        "solvers": solvers,
        "hard": hard_cases,
        "peers": peers,
    }
    console, failed, claims = Console(width=WIDTH, highlight=False), [], 0
    for name in names:
        start = perf_counter()
        for study in studies[name](quick):
            console.print(study.rendered())
            failed += [] if study.passed else [study.name]
            claims += 1
        console.print(f"{name}: {perf_counter() - start:.1f} s\n")
    console.print(f"DOES NOT HOLD: {', '.join(failed)}" if failed else f"all {claims} claims hold")
    return 1 if failed else 0
