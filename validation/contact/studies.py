"""Runner of the studies of contact."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from time import perf_counter

from rich.console import Console

from skfem_stvk.terminal import WIDTH

from ..statics.study import Study
from .between import balls, ironing
from .hard import hard
from .hertz import hertz, stiffness
from .motions import bar, bounce, slope
from .pairs import collision, pair
from .precision import precision
from .pressed import capstan, patch

STUDIES: dict[str, Callable[[bool], Study]] = {
    "patch": patch,
    "hertz": hertz,
    "stiffness": stiffness,
    "capstan": capstan,
    "slope": slope,
    "bar": bar,
    "bounce": bounce,
    "pair": pair,
    "balls": balls,
    "ironing": ironing,
    "collision": collision,
    "precision": precision,
    "hard": hard,
}


def run(names: Sequence[str], quick: bool) -> int:
    """Run the studies with these names and print them. Return 0 if all claims hold."""
    console, failed = Console(width=WIDTH, highlight=False), []
    for name in names:
        start = perf_counter()
        study = STUDIES[name](quick)
        console.print(study.rendered(), f"{name}: {perf_counter() - start:.1f} s\n")
        failed += [] if study.passed else [study.name]
    console.print(f"DOES NOT HOLD: {', '.join(failed)}" if failed else f"all {len(names)} claims hold")
    return 1 if failed else 0
