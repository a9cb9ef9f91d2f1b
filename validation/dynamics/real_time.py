"""Speed of motions: the largest bar in real time.

Times are those of `simulate`, including ledger and checks, over the whole motion, and the best of a few runs. On one thread they
are CPU times, without the work of other processes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numba

from skfem_stvk.solvers.dynamics import VelocityVerlet

from ..bench.costs import threads as on_threads
from ..study import Study
from .scenes import expected
from .swing import LENGTH, POISSON, PUSH, RTOL, SIDE, TANGENT, YOUNG, Timed, bar, eq9, push, timed

#: Smallest and largest number of cells across the bar: 12 n^3 tetrahedra.
FEWEST, MOST = 2, 18
#: Cells across the bar of the quick version.
QUICK = 4
FRAME = 1 / 60


class Pace(NamedTuple):
    """Real-time requirement: a time budget and a way to measure a bar.

    Attributes
    ----------
    name
        In words.
    seconds
        Wall time available for a step, or for a frame.
    trial
        Function of the number of cells across that returns the run of the bar and its wall time.
    target
        Least number of tetrahedra on one thread.
    """

    name: str
    seconds: float
    trial: Callable[[int], Timed]
    target: int = 0

    def row(self, threads: int, n: int) -> tuple[tuple[str, ...], list[str]]:
        """Return a row of the table, and the contradictions to the claim."""
        count = 12 * n**3
        failures = [f"{self.name}: {count} tetrahedra, expected {self.target}"] if threads == 1 and count < self.target else []
        if n == 0:
            return (self.name, str(threads), "0", "", "", ""), failures
        found = self.trial(n)
        explicit = found.run.integrator.explicit
        iterations, steps = ("", f"{FRAME / found.run.dt:.0f}") if explicit else (f"{found.iterations:.0f}", "1")
        return (self.name, str(threads), str(count), f"{1e3 * found.seconds:.2f}", iterations, steps), failures

    def largest(self) -> int:
        """Return the largest number of cells across that meets the budget, by bisection; 0 if there is none."""
        low, high = FEWEST - 1, MOST + 1
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if self.trial(middle).seconds <= self.seconds else (low, middle)
        while low >= FEWEST and self.trial(low).seconds > self.seconds:  # repeated, because a bar may have met the budget by chance
            low -= 1
        return low if low >= FEWEST else 0


def speed(quick: bool = False, folder: Path | None = None) -> Sequence[Study]:
    """Measure the largest bar in real time."""
    with on_threads(1), expected():
        return (_real_time(quick),)


def _paces() -> tuple[Pace, ...]:
    return (
        Pace("eq. 9, 60 steps/s", FRAME, partial(_steps, 60, 1.0), 20_000),
        Pace("eq. 9, 1000 steps/s", 1e-3, partial(_steps, 1000, 0.2), 1000),
        Pace("Verlet, 60 frames/s", FRAME, _frames),
    )


def _steps(rate: int, until: float, n: int, young: float = YOUNG, rtol: float = RTOL) -> Timed:
    """Time steps of `1/rate`."""
    return timed(bar(n, young), eq9(rate, rtol), push(n), until)


def _frames(n: int) -> Timed:
    """Time frames with Verlet's automatic steps."""
    found = timed(bar(n), VelocityVerlet(), push(n), 15 * FRAME)
    return Timed(found.run, found.seconds * found.steps / 15)


def _real_time(quick: bool) -> Study:
    """Find the largest bars in real time."""
    rows, failures = [], []
    for threads in (1,) if quick else sorted({1, min(2, numba.config.NUMBA_NUM_THREADS)}):  # type: ignore[attr-defined]
        with on_threads(threads):
            for pace in _paces():
                row, wrong = pace.row(threads, QUICK if quick else pace.largest())
                rows.append(row)
                failures += [] if quick else wrong
    targets = ", ".join(f"{pace.target} at {pace.name}" for pace in _paces() if pace.target)
    return Study(
        "Real time",
        "" if quick else f"at least so many tetrahedra on one thread: {targets}",
        ("bar" if quick else "largest bar", "threads", "tetrahedra", "ms", "iterations", "steps a frame"),
        tuple(rows),
        tuple(failures),
        (
            f"soft tissue, E = {YOUNG:g} Pa, nu = {POISSON:g}, {1e2 * LENGTH:g} x {1e2 * SIDE:g} x {1e2 * SIDE:g} cm, hanging, "
            f"initial speed {PUSH:g} m/s",
            f"eq. 9: LinearBackwardEuler(tangent='{TANGENT}', rtol={RTOL:g}), its default solver, conjugate "
            "gradients on one thread in all cases",
            "with steps of 1 ms and less, which lose little energy, a few elements at the clamped corners invert; this is accepted",
            "ms: time per step, or per frame of 1/60 s with Verlet's automatic steps; 12 n^3 tetrahedra with integer n",
        ),
    )
