"""Error against wall time of the whole solve: all elements of this package, and scikit-fem's linear and quadratic tetrahedra."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from skfem_stvk.about import write_machine
from skfem_stvk.arguments import Array

from ..slopes import draw_slope
from ..study import Study
from .families import P2
from .programs import OURS, THEIRS, Solved, ours, theirs
from .trials import BENT, SHEARED, TRIALS, TWISTED, Trial

#: Cells across the body by program; `FINEST`: those of the reference, which has quadratic tetrahedra.
BOXES_ACROSS = (2, 4, 8)
SIZES: dict[str, dict[str, tuple[int, ...]]] = {
    BENT.name: {
        "P1": (2, 4, 8, 12, 16, 20),
        "P2": (1, 2, 3, 4),
        "hexahedra": (*BOXES_ACROSS, 12),
        "hexahedra, 1 point": (*BOXES_ACROSS, 12),
        "scikit-fem P1": (2, 4),
        "scikit-fem P2": (1, 2, 3),
    },
    TWISTED.name: {
        "P1": (2, 4, 8, 12),
        "P2": (1, 2, 3),
        "hexahedra": BOXES_ACROSS,
        "hexahedra, 1 point": BOXES_ACROSS,
        "scikit-fem P1": (2, 4),
        "scikit-fem P2": (1, 2),
    },
    SHEARED.name: {
        "P1": (2, 4, 8, 12),
        "P2": (1, 2, 3, 4),
        "hexahedra": BOXES_ACROSS,
        "hexahedra, 1 point": BOXES_ACROSS,
        "scikit-fem P1": (2, 4),
        "scikit-fem P2": (1, 2),
    },
}
FINEST = {BENT.name: 7, TWISTED.name: 6, SHEARED.name: 6}
QUICK = {name: (2,) if name != "P2" else (1, 2) for name in (*OURS, *THEIRS)}
QUICK_FINEST = 3
GOALS = (0.05, 0.02, 0.01)
#: Relative tolerance between scikit-fem's results and ours with the same elements.
AGREEMENT = 1e-6
#: Number of repetitions of solves shorter than `SHORT` seconds; the shortest time is used.
REPEATED, SHORT = 3, 3.0
#: Target factors by which quadratic elements are faster than scikit-fem's quadratic and this package's linear elements, on the bent
#: cantilever for an error of 1 %.
TARGETS = {"scikit-fem P2": 10.0, "P1": 50.0}
STYLES = {
    "P1": ("#0072B2", "o", "-"),
    "P2": ("#009E73", "^", "-"),
    "hexahedra": ("#CC79A7", "s", "-"),
    "hexahedra, 1 point": ("#E69F00", "D", "-"),
    "scikit-fem P1": ("#0072B2", "o", ":"),
    "scikit-fem P2": ("#009E73", "^", ":"),
}


class Reached(NamedTuple):
    """Solve on a mesh of `n` cells across, with its error relative to the reference."""

    n: int
    solved: Solved
    error: float


Found = dict[str, list[Reached]]


def work_precision(quick: bool = False, folder: Path | None = None) -> Sequence[Study]:
    """Measure error against time of all elements on three bodies."""
    trials = TRIALS[:1] if quick else TRIALS
    _warm_up(trials)
    studies: list[Study] = []
    every: dict[str, Found] = {}
    for trial in trials:
        found, finest, reference = _of(trial, quick)
        every[trial.name] = found
        pictures = (_picture(every, folder),) if folder is not None and trial is trials[-1] else ()
        times = [_to_reach(goal, found) for goal in GOALS]
        factor = _factors(found) if trial is BENT else ""
        studies.append(
            Study(
                f"Work and precision: {trial.name}",
                f"scikit-fem's elements give the same result (to {AGREEMENT:g})",
                ("program", "cells across", "unknowns", "error", "iterations", "seconds"),
                tuple(_row(name, one) for name, several in found.items() for one in several),
                tuple(_failures(found)),
                (
                    f"reference: quadratic tetrahedra, {finest} cells across, {np.array2string(reference, precision=6)}",
                    *times,
                    factor,
                ),
                pictures,
            )
        )
    return studies


def _warm_up(trials: Sequence[Trial]) -> None:
    """Compile the kernels and load the libraries, so that neither is timed."""
    for family in OURS.values():
        for trial in trials:
            ours(trial, family, 2)


def _of(trial: Trial, quick: bool) -> tuple[Found, int, Array]:
    sizes, finest = (QUICK, QUICK_FINEST) if quick else (SIZES[trial.name], FINEST[trial.name])
    reference = ours(trial, P2, finest).result
    factors = ours(trial, P2, 1).factors
    found: Found = {}
    for name, several in sizes.items():
        found[name] = []
        for n in several:
            solved = _shortest(trial, name, n, factors, 1 if quick else REPEATED)
            found[name].append(Reached(n, solved, float(np.linalg.norm(solved.result - reference) / np.linalg.norm(reference))))
    return found, finest, reference


def _shortest(trial: Trial, name: str, n: int, factors: Array, repeated: int) -> Solved:
    def once() -> Solved:
        return ours(trial, OURS[name], n) if name in OURS else theirs(trial, THEIRS[name], n, factors)

    runs = [once()]
    while len(runs) < repeated and runs[0].seconds < SHORT:
        runs.append(once())
    return min(runs, key=lambda run: run.seconds)


def seconds_to_reach(goal: float, several: Sequence[Reached]) -> float:
    """Return the time for an error of `goal` by linear interpolation on logarithmic scales; NaN outside the measured errors."""
    several = [one for one in several if one.error == one.error]
    errors, seconds = [one.error for one in several], [one.solved.seconds for one in several]
    if not errors:
        return float("nan")
    if not min(errors) <= goal <= max(errors):
        return float("nan")
    order = np.argsort(errors)
    return float(np.exp(np.interp(np.log(goal), np.log(errors)[order], np.log(seconds)[order])))


def _to_reach(goal: float, found: Found) -> str:
    times = {name: seconds_to_reach(goal, several) for name, several in found.items()}
    return f"for an error of {goal:.0%}: " + ", ".join(f"{name} {time:.2g} s" for name, time in times.items() if time > 0)


def _factors(found: Found) -> str:
    """Return a remark on the speed of quadratic elements relative to others at an error of 1 %."""
    own = seconds_to_reach(GOALS[-1], found["P2"])
    times = {name: seconds_to_reach(GOALS[-1], found[name]) / own for name in TARGETS}
    shown = [f"{times[name]:.0f} x faster than {name} (target {target:g} x)" for name, target in TARGETS.items() if times[name] > 0]
    return f"for an error of {GOALS[-1]:.0%} P2 is " + ", ".join(shown) if shown else ""


def _row(name: str, one: Reached) -> tuple[str, ...]:
    run = one.solved
    error = f"{one.error:.2%}" if one.error == one.error else f"({run.said})"
    return name, str(one.n), str(run.ndofs), error, str(run.iterations), f"{run.seconds:.3f}"


def _failures(found: Found) -> Iterator[str]:
    for name, element in THEIRS.items():
        theirs = {one.n: one.solved.result for one in found[name]}
        for mine in found[element]:
            if mine.n not in theirs or mine.error != mine.error:
                continue
            off = np.linalg.norm(mine.solved.result - theirs[mine.n]) / np.linalg.norm(theirs[mine.n])
            if not off <= AGREEMENT:
                yield f"{element}, {mine.n} cells across: {mine.solved.result}, scikit-fem {theirs[mine.n]}"


def _picture(every: dict[str, Found], folder: Path) -> Path:
    """Plot error against time of each program, one panel per trial."""
    figure = Figure(figsize=(max(2.3 * len(every), 4.0), 3.9), layout="constrained")
    panels = np.atleast_1d(np.array(figure.subplots(1, len(every))))
    for axes, (title, found) in zip(panels, every.items(), strict=True):
        for name, several in found.items():
            colour, marker, line = STYLES[name]
            hollow = "none" if line == ":" else colour
            axes.loglog(
                [one.solved.seconds for one in several],
                [one.error for one in several],
                line,
                marker=marker,
                ms=5,
                color=colour,
                mfc=hollow,
                label=name,
            )
        for name, exponent, below in (("P1", Fraction(-2, 3), 2.0), ("P2", Fraction(-4, 3), 0.5)):
            first = found[name][:3]
            draw_slope(axes, [one.solved.seconds for one in first], [one.error for one in first], exponent, below=below)
        axes.axhline(GOALS[-1], color="#888888", lw=0.8, ls="--")
        axes.set(xlabel="wall time [s]", title=title.replace(", ", ",\n", 1))
        axes.title.set_fontsize(9)
        axes.tick_params(labelsize=9)
        axes.grid(True, alpha=0.25)
        axes.margins(0.1)
    panels[0].set_ylabel("relative error")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=3, fontsize=9, frameon=False)
    write_machine(figure)
    path = folder / "elements-work-precision.png"
    figure.savefig(path, dpi=130)
    return path
