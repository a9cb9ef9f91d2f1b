"""Execution of the studies of reduced models, membranes and cables."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from time import perf_counter

from rich.console import Console

from skfem_stvk.terminal import WIDTH

from ..statics.study import Study
from .against_full import at_rest, conserved_energy, in_motion
from .cables import cable_net, hanging_cable, inflated_sphere
from .costs import costs
from .membranes import clamped_disc, sheared_sheet

#: Functions by name. Each yields studies; its arguments are `quick` and the folder for pictures, or None without pictures.
STUDIES: dict[str, Callable[[bool, Path | None], Iterable[Study]]] = {
    "statics": at_rest,
    "motion": in_motion,
    "energy": conserved_energy,
    "costs": costs,
    "cable": hanging_cable,
    "net": cable_net,
    "sphere": inflated_sphere,
    "disc": clamped_disc,
    "wrinkles": sheared_sheet,
}


def run(names: Sequence[str], quick: bool, out: str | None) -> int:
    """Run the studies with these names, print them and save pictures in the folder `out`. Return 0 if all claims hold."""
    folder = None if out is None else Path(out)
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
    console, failed = Console(width=WIDTH, highlight=False), []
    for name in names:
        start = perf_counter()
        for study in STUDIES[name](quick, folder):
            console.print(study.rendered())
            failed += [] if study.passed else [study.name]
        console.print(f"{name}: {perf_counter() - start:.1f} s\n")
    console.print(f"DOES NOT HOLD: {', '.join(failed)}" if failed else "all claims hold")
    return 1 if failed else 0
