"""Precomputed response: interpolation errors between the points of a table, evaluations per second, and costs."""

from __future__ import annotations

import time
from itertools import pairwise

import numpy as np
from rich.console import Console
from rich.table import Table

from skfem_stvk import PrecomputedResponse, StVK, System
from skfem_stvk.arguments import Array
from skfem_stvk.mesh import box

#: Largest displacement of the end of a bar of length 4 along y and z, and duration of the timing [s].
REACH, SECONDS = 1.0, 2.0
#: Cells across the bar, and points per axis of the table; the last case has a realistic size.
STUDIES = ((3, (3, 5, 9, 17)), (12, (5,)))
#: Evaluations per second that are enough for a smooth haptic response.
ENOUGH = 1000


def main(quick: bool = False) -> int:
    """Measure errors between points, evaluations per second, time and memory of tables of a bar bent by hand."""
    table = Table(box=None, header_style="bold")
    headings = (
        "tets",
        "table",
        "solves",
        "vectors",
        "force wrong by",
        "u wrong by",
        "work lost round a cell",
        "answers/s",
        "made in",
    )
    for heading in headings:
        table.add_column(heading, justify="right")
    slowest = np.inf
    for cells, counts in ((2, (3, 5)),) if quick else STUDIES:
        for n in counts:
            row, rate = _measured(_bar(cells), n)
            table.add_row(*row)
            slowest = min(slowest, rate)
    console = Console(highlight=False, width=132)
    console.print(table)
    console.print(
        "Errors: the largest at midpoints of cells, relative to the largest value. Work lost: work of the force around a cell at "
        "the side of the table, relative to the largest work on the bar."
    )
    return 0 if quick or slowest >= ENOUGH else 1


def _bar(cells: int) -> System:
    return System(box((4.0, 1.0, 1.0), (4 * cells, cells, cells)), StVK(young=1e5, poisson=0.3), fixed={"left": "xyz"})


def _measured(body: System, n: int) -> tuple[list[str], float]:
    """Return a row of the table, and the evaluations per second."""
    axis = np.linspace(-REACH, REACH, n)
    begin = time.perf_counter()
    answers = PrecomputedResponse(body, "right", ([0.0], axis, axis), checks=8, quiet=True)
    made, error = time.perf_counter() - begin, answers.error
    rate = _rate(answers)
    row = [f"{body.mesh.nt}", f"{n} x {n}", f"{n * n + len(error.points)}", f"{answers.rank}"]
    row += [f"{error.largest_force:.1e}", f"{error.largest_u:.1e}", f"{_lost(answers):.1e}", f"{rate:.0f}", f"{made:.0f} s"]
    return row, rate


def _rate(answers: PrecomputedResponse) -> float:
    """Return the evaluations per second, of force and displacements of all nodes."""
    points = REACH * np.random.default_rng(0).uniform(-1, 1, (997, 3)) * [0, 1, 1]
    begin, count = time.perf_counter(), 0
    while time.perf_counter() - begin < SECONDS:
        answers(points[count % len(points)])
        count += 1
    return count / (time.perf_counter() - begin)


def _lost(answers: PrecomputedResponse) -> float:
    """Return the work of the force around the last cell, relative to the largest work; zero for a conservative force."""
    y, z = answers.axes[1:]
    low, high = z[len(z) // 2], z[len(z) // 2 + 1]
    corners = [(y[-2], low), (y[-1], low), (y[-1], high), (y[-2], high), (y[-2], low)]
    around = sum(_work(answers, a, b) for a, b in pairwise(corners))
    return abs(around) / abs(_work(answers, (0.0, 0.0), (y[-1], z[-1])))


def _work(answers: PrecomputedResponse, start: tuple[float, float], end: tuple[float, float]) -> float:
    """Return the work of the force along a straight line, by Gauss points on pieces that each lie in one cell."""
    a, way = np.array([0.0, *start]), np.array([0.0, *end]) - [0.0, *start]
    points, weights = np.polynomial.legendre.leggauss(6)
    pieces: Array = np.linspace(0, 1, 2 * len(answers.axes[1]) - 1)
    work = 0.0
    for low, high in pairwise(pieces):
        at = low + (points + 1) / 2 * (high - low)
        work += (high - low) / 2 * sum(w * float(answers(a + s * way)[0] @ way) for s, w in zip(at, weights, strict=True))
    return work
