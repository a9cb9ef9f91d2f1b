"""Cost of a step: explicit steps in internal forces, implicit steps by part."""

from __future__ import annotations

from typing import Any

import numpy as np
import skfem
from numpy.typing import ArrayLike, NDArray

from skfem_stvk import Gravity, StVK, System
from skfem_stvk.solvers.dynamics import ForwardEuler, LinearBackwardEuler, VelocityVerlet, simulate
from skfem_stvk.solvers.dynamics.ledger_rows import LedgerLocations, LedgerWriter, column_names
from skfem_stvk.solvers.dynamics.motion import Motion
from skfem_stvk.solvers.dynamics.record import MOST, MotionState
from skfem_stvk.solvers.runs.ledger import Ledger
from skfem_stvk.terms.loads.load import Time

from ..statics.study import Study
from .scenes import Array, reached
from .swing import clock

#: Cells along each side, 6 n^3 tetrahedra; the claim is for meshes of at least `CLAIMED` tetrahedra.
SIZES, QUICK_SIZES, CLAIMED = (5, 12, 19, 35), (12,), 10_000
#: Steps and forces alternate in blocks of `BLOCK`. A round lasts from one check of a constant bound to the next. Numbers of timed
#: rounds.
BLOCK, ROUND, ROUNDS, QUICK_ROUNDS = MOST // 4, MOST, 9, 2
#: Largest time of a step, in times of an internal force.
FORCES = 1.5
DT = 1e-6


class Interleaved(System):
    """System that evaluates a block of forces after every block of steps, so that other load on the machine slows down both.

    Attributes
    ----------
    times
        (n, 2) durations of a block of steps and of the block of forces after it [s]; the first steps include the start.
    """

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self.begin()

    def begin(self) -> None:
        """Clear the times."""
        self.times: list[tuple[float, float]] = []
        self._forces, self._since = 0, clock()

    def energy_and_force(self, u: ArrayLike, out: NDArray[Any] | None = None, t: Time = 0.0) -> tuple[float, NDArray[Any]]:
        if self._forces % BLOCK == 0:
            begin = clock()
            for _ in range(BLOCK):
                super().energy_and_force(u, out, t)
            end = clock()
            self.times.append((begin - self._since, end - begin))
            self._since = end
        self._forces += 1
        return super().energy_and_force(u, out, t)


def explicit_cost(quick: bool) -> Study:
    """Time steps and internal forces alternately."""
    rows, failures = [], []
    for n in QUICK_SIZES if quick else SIZES:
        mesh = skfem.MeshTet.init_tensor(*[np.linspace(0, 1, n + 1)] * 3)
        material = StVK(young=1e5, poisson=0.3, density=1000.0)
        system = Interleaved(mesh, [material, Gravity((0, 0, -9.81))], fixed={lambda x: x[2] == 0: "xyz"})
        for integrator in (VelocityVerlet(dt=DT), ForwardEuler(dt=DT)):
            first, rounds = _rounds(system, integrator, QUICK_ROUNDS if quick else ROUNDS)
            ratios = rounds[:, 0] / rounds[:, 1]
            ratio = float(np.median(ratios))
            step, force = 1e9 * np.median(rounds, axis=0) / system.mesh.nt
            beyond = 1e6 * float(np.median(rounds[:, 0] - rounds[:, 1]))
            each = (
                f"{force:.1f}",
                f"{step:.1f}",
                f"{beyond:.0f}",
                f"{ratio:.2f}",
                f"{ratios.min():.2f} - {ratios.max():.2f}",
                f"{first:.2f}",
            )
            rows.append((integrator.name, str(system.mesh.nt), *each))
            if ratio > FORCES and system.mesh.nt >= CLAIMED and not quick:
                failures.append(
                    f"{integrator.name}, {system.mesh.nt} tetrahedra: a step takes {ratio:.2f} times as long as an internal force"
                )
    return Study(
        "Explicit steps",
        "" if quick else f"from {CLAIMED} tetrahedra on, a step takes at most {FORCES:g} times as long as an internal force",
        ("integrator", "tetrahedra", "F, ns per tet", "step, ns per tet", "beyond F, us", "x", "of rounds", f"first {ROUND}, x"),
        tuple(rows),
        tuple(failures),
        (
            f"one thread; including ledger, blow-up check and critical-step check; {BLOCK} steps and {BLOCK} "
            f"forces alternate, medians of rounds of {ROUND} each",
        ),
    )


def _rounds(system: Interleaved, integrator: VelocityVerlet | ForwardEuler, count: int) -> tuple[float, Array]:
    """Return the time of the first steps in internal forces, and the mean times (count, 2) of a later step and a force [s]."""
    simulate(system, integrator, until=10 * DT, quiet=True)  # creates the data of the first use
    system.begin()
    simulate(system, integrator, until=(ROUND * (count + 2) + 1) * DT, quiet=True)
    times, blocks = np.array(system.times), ROUND // BLOCK
    first = times[: blocks + 1].sum(axis=0) / (ROUND, ROUND + BLOCK)  # the start has one more block of forces
    later = times[2 * blocks + 1 :][: count * blocks].reshape(count, blocks, 2)
    return float(first[0] / first[1]), later.sum(axis=1) / ROUND


def split(system: System, integrator: LinearBackwardEuler, v: Array) -> Study:
    """Measure the parts of the time of a step of eq. 9."""
    reached(system, integrator, until=3 * integrator.dt, v0=v)
    runs = [reached(system, integrator, until=1.0, v0=v) for _ in range(3)]
    run = min(runs, key=lambda run: sum(run.seconds.values()))
    steps, total = run.ledger.steps - 1, sum(run.seconds.values())
    books = LedgerWriter(Motion(system, "lumped", None), LedgerLocations(), Ledger(column_names(system)), run.dt)
    state = MotionState.at(0.0, run.u, run.v)
    ledger = min(_once(books, state) for _ in range(100)) * steps
    parts = {
        "F and K": run.seconds["assemble"],
        "preconditioner": run.seconds["factor"],
        "conjugate gradients": run.seconds["solve"],
        "ledger": ledger,
        "rest": run.seconds["other"] - ledger,
    }
    rows = tuple((name, f"{1e3 * seconds / steps:.3f}", f"{seconds / total:.0%}") for name, seconds in parts.items())
    return Study(
        "A step of eq. 9",
        "all of the time is accounted for",
        ("part", "ms", "share"),
        (*rows, ("all", f"{1e3 * total / steps:.3f}", "100%")),
        () if min(parts.values()) > 0 else ("a part takes no time",),
        (
            f"{system.mesh.nt} tetrahedra, {run.iterations / steps:.0f} iterations of conjugate gradients a step of "
            f"{1e3 * integrator.dt:.3g} ms",
        ),
    )


def _once(books: LedgerWriter, state: MotionState) -> float:
    begin = clock()
    books.append_row(state, 0.0)
    return clock() - begin
