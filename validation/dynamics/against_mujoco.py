"""MuJoCo on the same bar: what a step takes there, and whether it moves alike."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from skfem_stvk import System
from skfem_stvk.dynamics import ForwardEuler
from skfem_stvk.peers import PEERS
from skfem_stvk.peers.mujoco import Moving, MuJoCoMotion

from ..statics.study import Study
from .scenes import Array
from .swing import GRAVITY, POISSON, REPEATS, RTOL, YOUNG, bar, clock, eq9, push, timed

#: Cells across the bar, and by how much motions may differ.
COMPARED, QUICK_COMPARED, AGREE = (8, 12), (4,), 1e-2


def against_mujoco(quick: bool) -> Iterator[Study]:
    """The same bar in MuJoCo, if that is installed."""
    if PEERS["MuJoCo"].version() is None:
        return
    rows, failures = [], []
    for n in QUICK_COMPARED if quick else COMPARED:
        for name, ours, steps in (
            ("discrete", eq9(60), 12),
            ("discrete", eq9(1000), 60),
            ("Euler", ForwardEuler(dt=1e-4), 200),
        ):
            system, v, dt = bar(n), push(n), float(ours.dt or 0)
            found = timed(system, ours, v, steps * dt)
            theirs, u = _their_step(system, v, Moving(system.mass().vertex, _held(system), GRAVITY, dt, name, RTOL), steps)
            off = float(np.abs(u - found.run.u).max() / np.abs(u).max())
            rows.append(
                (
                    name,
                    f"{1e3 * dt:.3g}",
                    str(12 * n**3),
                    f"{1e3 * theirs:.2f}",
                    f"{1e3 * found.seconds:.2f}",
                    f"{theirs / found.seconds:.1f}",
                    f"{off:.1e}",
                )
            )
            if off > AGREE:
                failures.append(f"MuJoCo's {name}, {12 * n**3} tetrahedra, dt = {dt:g} s: motions differ by {off:.1e}")
    yield Study(
        "MuJoCo",
        f"the same motion to {AGREE:g}, after {', '.join(str(steps) for steps in (12, 60, 200))} steps",
        ("integrator", "dt, ms", "tetrahedra", "MuJoCo, ms", "ours, ms", "x", "motions differ by"),
        tuple(rows),
        tuple(failures),
        (
            "a step on one thread; 'discrete' is MuJoCo's implicit integrator for flexes, which is eq. 9 with K clamped element "
            f"by element, rtol = {RTOL:g} on both sides; 'implicit' and 'implicitfast' refuse flexes since 4.0",
        ),
    )


def _their_step(system: System, v: Array, moving: Moving, steps: int) -> tuple[float, Array]:
    """MuJoCo's best wall time of a step [s], averaged over the motion, and where it ends."""
    best = np.inf
    for _ in range(REPEATS):
        peer = MuJoCoMotion(system.mesh.p, system.mesh.t, YOUNG, POISSON, moving)
        peer.begin(0 * v, v)
        begin = clock()
        for _ in range(steps):
            peer.step()
        best = min(best, clock() - begin)
    return best / steps, peer.displacements()


def _held(system: System) -> Array:
    return np.unique(system.supports.held // 3)
