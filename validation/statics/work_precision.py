"""Tip error against wall time: linear elements by edges and by scikit-fem, and quadratic elements of scikit-fem."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from skfem_stvk.about import write_machine

from ..slopes import draw_slope
from ..study import Study
from . import with_edges, with_scikit_fem
from .cantilever import Array, Run, cantilever
from .linear_solvers import direct

#: Cells across the beam, by program.
SIZES = {"edges P1": (2, 4, 6, 8, 12, 16, 24), "scikit-fem P1": (2, 4, 6, 8), "scikit-fem P2": (1, 2, 3, 4)}
QUICK = {"edges P1": (2, 4, 6), "scikit-fem P1": (2, 4), "scikit-fem P2": (1,)}
FINEST, QUICK_FINEST = 6, 2
AGREEMENT, GOALS = 1e-6, (0.05, 0.02, 0.01)
STYLES = (("#0072B2", "o"), ("#D55E00", "s"), ("#009E73", "^"))  # Okabe and Ito's colours


class Point(NamedTuple):
    """Run on a mesh of `n` cells across, with its error relative to the reference."""

    n: int
    run: Run
    error: float


def work_precision(quick: bool = False, folder: Path | None = None) -> Study:
    """Measure tip error against time of linear elements, with quadratic elements for comparison."""
    with_edges.warm_up("auto")
    factors = with_edges.solve(cantilever(2))[1].history.t
    sizes = QUICK if quick else SIZES
    reference = _reference(QUICK_FINEST if quick else FINEST)
    points = {name: [_point(name, n, reference, factors) for n in several] for name, several in sizes.items()}
    notes = [
        f"reference: scikit-fem P2, {QUICK_FINEST if quick else FINEST} cells across, tip {reference[2]:.5f} m; "
        "scikit-fem: PARDISO, load steps of the edge form"
    ]
    notes += [_to_reach(goal, points) for goal in GOALS]
    return Study(
        "Work and precision",
        f"edges give the same result as linear elements (to {AGREEMENT:g})"
        + ("" if quick else " in less time than scikit-fem's assembly"),
        ("program", "cells across", "unknowns", "tip [m]", "error", "iterations", "seconds"),
        tuple(_row(name, point) for name, several in points.items() for point in several),
        tuple(_failures(points, times=not quick)),
        tuple(notes),
        () if folder is None else (_picture(points, folder),),
    )


def _reference(n: int) -> Array:
    """Return the displacement of the end on the finest mesh of quadratic elements."""
    return with_scikit_fem.solve(cantilever(n), "P2", direct, factors=np.array([0.5, 1.0])).tip


def _point(name: str, n: int, reference: Array, factors: Array) -> Point:
    mesh = cantilever(n)
    run = with_edges.solve(mesh)[0] if name == "edges P1" else with_scikit_fem.solve(mesh, name[-2:], direct, factors)
    return Point(n, run, float(np.linalg.norm(run.tip - reference) / np.linalg.norm(reference)))


def seconds_to_reach(goal: float, points: list[Point]) -> float:
    """Return the time for an error of `goal` by linear interpolation on logarithmic scales; NaN outside the measured errors."""
    errors, seconds = [point.error for point in points], [point.run.total for point in points]
    if not min(errors) <= goal <= max(errors):
        return float("nan")
    order = np.argsort(errors)
    return float(np.exp(np.interp(np.log(goal), np.log(errors)[order], np.log(seconds)[order])))


def _to_reach(goal: float, points: dict[str, list[Point]]) -> str:
    times = {name: seconds_to_reach(goal, several) for name, several in points.items()}
    return f"for an error of {goal:.0%}: " + ", ".join(f"{name} {time:.2g} s" for name, time in times.items() if time > 0)


def _row(name: str, point: Point) -> tuple[str, ...]:
    run = point.run
    return name, str(point.n), str(run.ndofs), f"{run.tip[2]:.5f}", f"{point.error:.2%}", str(run.iterations), f"{run.total:.2f}"


def _failures(points: dict[str, list[Point]], times: bool) -> Iterator[str]:
    theirs = {point.n: point.run for point in points["scikit-fem P1"]}
    for ours in points["edges P1"]:
        if ours.n not in theirs:
            continue
        tip, time = theirs[ours.n].tip, theirs[ours.n].total
        if not np.linalg.norm(ours.run.tip - tip) <= AGREEMENT * np.linalg.norm(tip):
            yield f"{ours.n} cells across: edges {ours.run.tip}, scikit-fem {tip}"
        if times and not ours.run.total < time:
            yield f"{ours.n} cells across: edges {ours.run.total:.2f} s, scikit-fem {time:.2f} s"


def _picture(points: dict[str, list[Point]], folder: Path) -> Path:
    """Plot error against time of each program."""
    figure = Figure(figsize=(6, 4.2), layout="constrained")
    axes = figure.subplots()
    for (name, several), (colour, marker) in zip(points.items(), STYLES, strict=True):
        axes.loglog([p.run.total for p in several], [p.error for p in several], marker=marker, color=colour, label=name)
        for p in several:
            axes.annotate(f"{p.run.ndofs / 1000:.3g} k", (p.run.total, p.error), (4, 4), textcoords="offset points", fontsize=8)
        if name != "scikit-fem P1":
            exponent = Fraction(-4, 3) if name == "scikit-fem P2" else Fraction(-2, 3)
            draw_slope(axes, [p.run.total for p in several[:3]], [p.error for p in several[:3]], exponent)
    axes.set(
        xlabel="wall time of the whole solve [s]",
        ylabel="error of the tip's displacement",
        title="Cantilever 5 x 1 x 1, P L²/EI = 2; numbers: thousands of unknowns",
    )
    axes.title.set_fontsize(9)
    axes.grid(True, which="both", alpha=0.3)
    axes.margins(0.08)
    axes.legend(fontsize=9, frameon=False)
    write_machine(figure)
    path = folder / "statics-work-precision.png"
    figure.savefig(path, dpi=150)
    return path
